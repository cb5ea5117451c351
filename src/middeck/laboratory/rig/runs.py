"""Experiments on a rig as on hardware: settle, record, stop where a limit is passed.

A run begins at rest: the gyros' biases are measured, the compensator is switched on with its states at zero,
and ``settle`` unrecorded periods of the excitation go by before the recorded ones.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.laboratory.rig.linear_view import close_rig, gyro_sums
from middeck.laboratory.rig.parts.computer import place_law
from middeck.laboratory.rig.plant.ageing import check_life
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.run_events import EventCounter, RunEvents, StopRule, find_stop, stop_limits
from middeck.laboratory.rig.ticks.simulate_rig import (
    BLOCK,
    DivergedError,
    check_excitation,
    cut_blocks,
    linear_state,
    simulate_rig,
    switch_on,
)
from middeck.laboratory.rig.ticks.state import RigBlock, RigState, cut_block
from middeck.signals.record import Record
from middeck.systems.poles.stability import growth_rates
from middeck.systems.poles.verdict import is_stable
from middeck.systems.sampling.simulation import find_periodic_state
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

REST_S = 30.0
"""Rest before a run [s]: white rate noise of 2e-4 rad/s/sqrt(Hz) leaves the bias known to 4e-5 rad/s."""
LOOK_BACK_S = 4.0  # last part of a stopped run, in which to find what was growing


@record(kw_only=True)
class RigRun:
    """Result of an experiment in open or closed loop.

    Attributes:
        record: The excitation (not the whole torque) and the measured outputs; None for a run without a good
            end.
        control: Commands of the compensator in the same samples; None likewise, as is ``torque``.
        cause: Why there is no record: which mode diverges, or which output passed its stop; empty for a good
            run.
        torque: Torque of the motors for compensator and excitation together.
        events: Limits reached, and how often; None where nothing was run.
        partial: Record until the stop, if the run was stopped, settling included.
    """

    record: Record | None = None
    control: Float[np.ndarray, "period sample input"] | None = None
    cause: str = ""
    torque: Float[np.ndarray, "period sample input"] | None = None
    events: RunEvents | None = None
    partial: Record | None = None


@named_kinds
def run_open_loop(
    rig: Rig,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
    settle: int = 2,
    rest_s: float = REST_S,
    stops: Sequence[StopRule] = (),
    steady: bool = False,
) -> RigRun:
    """``periods`` periods of the response to a repeated ``excitation``, after ``settle`` from rest.

    ``control`` of the run is zero. See `run_closed_loop`.
    """
    return run_closed_loop(
        rig, None, excitation, periods=periods, rng=rng, settle=settle, rest_s=rest_s, stops=stops,
        steady=steady,
    )  # fmt: skip


@named_kinds
def run_closed_loop(
    rig: Rig,
    law: Compensator | None,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
    settle: int = 2,
    rest_s: float = REST_S,
    stops: Sequence[StopRule] = (),
    steady: bool = False,
) -> RigRun:
    """``periods`` periods of the loop under a repeated ``excitation`` added to the commands of ``law``.

    With ``steady``, which no hardware can, it begins where the linear loop would be in its steady state, if
    that loop is stable, so that less has to settle; where it is not, the run begins at rest. A rig that
    drifts is of the same age at the beginning of every run's rest. The record is called periodic, as on
    hardware: whether ``settle`` was enough shows when periods are compared (`estimate_response`). It holds
    excitation and measured outputs, from each gyro's angle its ramp taken out (see `remove_ramps`).

    A run that passes a stop, or overflows, has a cause and no record. Where nothing is switched on, a loop
    that is unstable by its eigenvalues is not run at all, and its cause is the mode that diverges.

    Raises `ConfigError` for no period, an unknown output, as `place_law`, or drifts that bring a
    frequency to zero before the end; `DataError` for an excitation that is not finite; `NumericalError` for
    ``steady`` where the excitation drives a rigid-body mode on and on, and for joints' torques that do not
    settle within a substep.
    """
    u = check_excitation(excitation, len(rig.inputs))
    whole = int(periods), int(settle)
    if whole != (periods, settle) or periods < 1 or settle < 0 or len(u) < 1:
        raise ConfigError(
            f"{periods} periods of {len(u)} samples after {settle} to settle",
            hint="one or more after zero or more, whole numbers",
        )
    periods, settle = whole
    limits = stop_limits(stops, rig.outputs)
    loop = close_rig(rig, place_law(law, rig.inputs, rig.outputs, rig.period_s))
    holds = is_stable(loop)
    if rig.linear and not holds:
        return RigRun(cause=_explain(loop))
    if rig.ageing is not None:
        check_life(rig.ageing, round(rest_s * rig.sample_hz) + (settle + periods) * len(u))
    begin = switch_on(rig, law, rest_s, rng)
    begin = find_steady_start(rig, loop, u, begin) if steady and holds else begin
    taken = _Taken(rig, begin)
    size = len(u) if rig.linear else BLOCK
    repeated = (block for _ in range(settle + periods) for block in cut_blocks(u, size))
    try:
        for block in simulate_rig(rig, law, repeated, rng, begin):
            stop = find_stop(block.measured, limits)
            taken.add(block if stop is None else cut_block(block, stop[0] + 1))
            if stop is not None:
                return _stopped(rig, u, taken, stop[1])
    except DivergedError as error:
        return RigRun(cause=f"diverged: {error}", events=taken.counter.total(), partial=taken.partial(u))
    measured, control, torque = (
        x[settle * len(u) :].reshape(periods, len(u), x.shape[1]) for x in taken.joined()
    )
    y = remove_ramps(measured, rig.readout.summed)
    given = np.broadcast_to(u, (periods, *u.shape))
    record = _record(rig, given[None], y[None], periodic=True)
    return RigRun(record=record, control=control, torque=torque, events=taken.counter.total())


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
    rig: Rig, loop: SampledStateSpace, u: Float[np.ndarray, "sample input"], rested: RigState
) -> RigState:
    """``rested`` with the states of the linear ``loop`` at the start of a steady period of ``u``.

    Joints' elements are where a motion to the angle of this start leaves them. Raises `NumericalError` where
    there is no such state.
    """
    x = find_periodic_state(loop, np.hstack([u, np.zeros((len(u), len(rig.outputs)))]))
    rows = gyro_sums(rig)
    sums = np.zeros(0) if rows is None else rows @ x[: len(rested.x) + rested.issued.size]
    steady = linear_state(rested, x, sums)
    angles, states = (rig.plant.angle @ steady.x).tolist(), iter(rested.joints.tolist())
    joints = [
        part.resist(angle, next(states))[1]
        for joint, angle in zip(rig.joints, angles, strict=True)
        for part in joint.elements
    ]
    return dataclasses.replace(steady, joints=np.array(joints))


class _Taken:
    """The part of a run that is taken so far."""

    def __init__(self, rig: Rig, begin: RigState) -> None:
        self.counter = EventCounter(rig)
        self.rig, self.before = rig, begin.issued[-1]
        self.rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, block: RigBlock) -> None:
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
        return _record(self.rig, given, measured[None, None], periodic=False)


def _record(rig: Rig, u: np.ndarray, y: np.ndarray, *, periodic: bool) -> Record:
    hz, inputs, outputs = rig.sample_hz, rig.inputs, rig.outputs
    return Record(sample_hz=hz, u=u, y=y, inputs=inputs, outputs=outputs, periodic=periodic, held=True)


def _explain(loop: SampledStateSpace) -> str:
    """Frequency and growth of the mode that diverges."""
    rates = growth_rates(loop)
    worst = rates[int(np.argmax(np.real(rates)))]
    return (
        f"diverged: {abs(worst.imag) / (2.0 * np.pi):.3g} Hz grows by a factor e in {1.0 / worst.real:.3g} s"
    )


def _stopped(rig: Rig, u: np.ndarray, taken: _Taken, output: int) -> RigRun:
    """The run until ``output`` passed its stop, and what was growing then."""
    measured = taken.joined()[0]
    time_s, port = (len(measured) - 1) / rig.sample_hz, rig.outputs[output]
    where = measured[-round(LOOK_BACK_S * rig.sample_hz) :, output]
    cause = (
        f"stopped: {port.name} at {where[-1]:.3g} {port.unit} after {time_s:.3g} s, mostly at "
        f"{_strongest_hz(where, rig.sample_hz):.3g} Hz"
    )
    return RigRun(cause=cause, events=taken.counter.total(time_s), partial=taken.partial(u))


def _strongest_hz(x: Float[np.ndarray, " sample"], sample_hz: float) -> float:
    """Frequency of the peak of a tapered piece's spectrum, its mean and slope taken out."""
    time = np.linspace(-1.0, 1.0, len(x))
    flat = x - x.mean() - time * (x @ time) / max(float(time @ time), 1e-300)
    samples = 8 * len(x)
    spectrum = np.abs(np.fft.rfft(flat * np.hanning(len(x)), samples))
    return float(np.argmax(spectrum) * sample_hz / samples)
