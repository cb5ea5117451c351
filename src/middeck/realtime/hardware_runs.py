"""Experiments on a simulated test article as on a real one: settle, record, stop where a limit is passed.

A run begins at rest: the gyros' biases are measured, the law is switched on with its states at zero, and
``settle`` unrecorded periods of the excitation go by before the recorded ones.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.realtime.events import EventCounter, StopRule, find_stop, stop_limits
from middeck.realtime.hardware_rig import (
    HardwareRig,
    connect_law,
    cut_blocks,
    law_on_rig,
    measure_bias,
    simulate_rig,
)
from middeck.realtime.hybrid_state import HybridBlock, HybridState, cut_block
from middeck.realtime.law import Law
from middeck.realtime.linear_view import gyro_sums, linearise_rig
from middeck.realtime.rig import Run, close_sampled_loop
from middeck.realtime.sensors import Gyro
from middeck.signals.record import Record
from middeck.systems.simulation import simulate
from middeck.systems.stability import is_stable
from middeck.systems.statespace import SampledStateSpace

REST_S = 30.0
"""Rest before a run [s]: white rate noise of 2e-4 rad/s/sqrt(Hz) leaves the bias known to 4e-5 rad/s."""
LEAST = 1e-9  # part of the largest below which a motion has no steady state of its own: the sum of a gyro
LOOK_BACK_S = 4.0  # of a stopped run, to find what was growing


def run_hardware_open_loop(
    rig: HardwareRig,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
    settle: int = 2,
    rest_s: float = REST_S,
    stops: Sequence[StopRule] = (),
    steady: bool = False,
) -> Run:
    """``periods`` periods of the response to a repeated ``excitation``, after ``settle`` from rest.

    ``control`` of the run is zero. See `run_hardware_closed_loop`.
    """
    return run_hardware_closed_loop(
        rig, None, excitation, periods=periods, rng=rng, settle=settle, rest_s=rest_s, stops=stops,
        steady=steady,
    )  # fmt: skip


def run_hardware_closed_loop(
    rig: HardwareRig,
    law: Law | None,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
    settle: int = 2,
    rest_s: float = REST_S,
    stops: Sequence[StopRule] = (),
    steady: bool = False,
) -> Run:
    """``periods`` periods of the loop under a repeated ``excitation`` added to the law's commands.

    With ``steady``, which no hardware can, it begins where the linear loop would be in its steady state, if
    that is stable, so that less has to settle. A rig that drifts is of the same age at the beginning of every
    run's rest; its record is called periodic, as on hardware: nobody has told the experimenter.
    The record holds excitation and measured outputs, from each gyro's angle its ramp taken out (see
    `remove_ramps`). A run that passes a stop, or overflows, has a cause and no record; ``partial`` is what
    was taken until then, settling included. Raises `ConfigError` for no period, an unknown output, or a law
    as `place_law`.
    """
    if periods < 1 or settle < 0 or len(excitation) < 1:
        raise ConfigError(
            f"{periods} periods of {len(excitation)} samples after {settle} to settle",
            hint="one or more after zero or more",
        )
    u = np.asarray(excitation, dtype=float)
    limits = stop_limits(stops, rig.outputs)
    placed = law_on_rig(rig, law)
    taken = _Taken(rig, placed)
    try:
        begin = measure_bias(rig, placed, rest_s, rng)
        begin = find_steady_start(rig, placed, u, begin) if steady else begin
        taken.before = begin.issued[-1]
        repeated = (block for _ in range(settle + periods) for block in cut_blocks(u))
        for block in simulate_rig(rig, placed, repeated, rng, begin):
            stop = find_stop(block.measured, limits)
            taken.add(block if stop is None else cut_block(block, stop[0] + 1))
            if stop is not None:
                return _stopped(rig, u, taken, stop[1])
    except NumericalError as error:
        return Run(
            record=None,
            control=None,
            cause=f"diverged: {error}",
            events=taken.counter.total(),
            partial=taken.partial(u),
        )
    measured, control, torque = (
        x[settle * len(u) :].reshape(periods, len(u), x.shape[1]) for x in taken.joined()
    )
    gyro = np.array([isinstance(s, Gyro) for s in rig.sensors], dtype=bool)
    y = remove_ramps(measured, gyro)
    repeated = np.broadcast_to(u, (periods, *u.shape))
    record = Record(
        sample_hz=rig.sample_hz,
        u=repeated[None],
        y=y[None],
        inputs=rig.inputs,
        outputs=rig.outputs,
        periodic=True,
        held=True,
    )
    return Run(record=record, control=control, cause="", torque=torque, events=taken.counter.total())


def remove_ramps(
    y: Float[np.ndarray, "period sample output"], which: np.ndarray
) -> Float[np.ndarray, "period sample output"]:
    """``y`` without mean and, of several periods, without the slope by which an output's period means rise.

    What repeats has one mean in every period, so that its slope is the drift's and nothing of the response.

    >>> ramp = np.arange(8.0).reshape(2, 4, 1)
    >>> remove_ramps(ramp, np.array([True])).ravel().tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    periods, samples, _ = y.shape
    means = y.mean(axis=1)
    place = np.arange(periods) - 0.5 * (periods - 1)
    weight = place / np.sum(place**2) if periods > 1 else place
    slope = weight @ means / samples  # per sample
    time = np.arange(periods * samples).reshape(periods, samples, 1) - 0.5 * (periods * samples - 1)
    return np.where(which, y - means.mean(axis=0) - time * slope, y)


def find_steady_start(
    rig: HardwareRig, law: SampledStateSpace | None, u: Float[np.ndarray, "sample input"], rested: HybridState
) -> HybridState:
    """``rested`` with the states of the linear loop at the start of a steady period of ``u``.

    An unstable loop has none: ``rested`` itself. Where a gyro's sum is a state of its own it may have any
    constant: of all steady states the smallest is taken.
    """
    linear = linearise_rig(rig).sampled
    p = len(rig.outputs)
    loop = linear if law is None else close_sampled_loop(linear, law)
    if not is_stable(loop):
        return rested
    drive = u if law is None else np.hstack([u, np.zeros((len(u), p))])
    _, end = simulate(loop, drive)
    left = np.eye(len(loop.A)) - np.linalg.matrix_power(loop.A, len(u))
    x = np.linalg.lstsq(left, end, rcond=LEAST)[0]
    states, own = len(rested.x), len(rested.x) + rested.issued.size
    rows = gyro_sums(rig)
    sums = x[own:own] if rows is None else rows @ x[:own]
    return dataclasses.replace(
        rested,
        x=x[:states],
        issued=x[states:own].reshape(rested.issued.shape)[::-1],
        computer=np.concatenate([sums, x[own:]]),
    )


class _Taken:
    """What has been taken of a run so far."""

    def __init__(self, rig: HardwareRig, law: SampledStateSpace | None) -> None:
        inertia = {i: m.rotor.inertia for i, m in enumerate(rig.motors) if m.rotor is not None}
        self.counter = EventCounter(connect_law(rig, law), inertia, 1.0 / rig.sample_hz)
        self.rig, self.before = rig, np.zeros(len(rig.inputs))
        self.rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, block: HybridBlock) -> None:
        self.counter.add(block, self.before)
        self.before = block.torque[-1]
        # The measured outputs are a view of all the computer's numbers.
        self.rows.append((block.measured.copy(), block.control.copy(), block.torque))

    def joined(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Measured, control and torque, sample by sample."""
        measured, control, torque = zip(*self.rows, strict=True)
        return np.concatenate(measured), np.concatenate(control), np.concatenate(torque)

    def partial(self, u: np.ndarray) -> Record | None:
        """The record so far, settling included; None of nothing."""
        if not self.rows:
            return None
        measured = self.joined()[0]
        given = np.resize(u, (1, 1, len(measured), u.shape[1]))
        rig = self.rig
        return Record(
            sample_hz=rig.sample_hz,
            u=given,
            y=measured[None, None],
            inputs=rig.inputs,
            outputs=rig.outputs,
            periodic=False,
            held=True,
        )


def _stopped(rig: HardwareRig, u: np.ndarray, taken: _Taken, output: int) -> Run:
    """The run until ``output`` passed its stop, and what was growing then."""
    measured = taken.joined()[0]
    time_s, port = (len(measured) - 1) / rig.sample_hz, rig.outputs[output]
    where = measured[-round(LOOK_BACK_S * rig.sample_hz) :, output]
    cause = (
        f"stopped: {port.name} at {where[-1]:.3g} {port.unit} after {time_s:.3g} s, mostly at "
        f"{_strongest_hz(where, rig.sample_hz):.3g} Hz"
    )
    return Run(
        record=None, control=None, cause=cause, events=taken.counter.total(time_s), partial=taken.partial(u)
    )


def _strongest_hz(x: Float[np.ndarray, " sample"], sample_hz: float) -> float:
    """Frequency of the peak of a tapered piece's spectrum, its mean and slope taken out."""
    time = np.linspace(-1.0, 1.0, len(x))
    flat = x - x.mean() - time * (x @ time) / max(float(time @ time), 1e-300)
    samples = 8 * len(x)
    spectrum = np.abs(np.fft.rfft(flat * np.hanning(len(x)), samples))
    return float(np.argmax(spectrum) * sample_hz / samples)
