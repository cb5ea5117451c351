"""Length and step of simulations of loops with slipping joints."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import cast

import numpy as np
from jaxtyping import Float
from scipy.fft import next_fast_len

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.joints.sliding_loops import GIVEN
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.state_space.feedback import close_static
from middeck.updating.promise.plan import Plan, weights_of
from middeck.updating.promise.slip import DrawnSlips
from middeck.updating.promise.slip_loops import (
    SlipPorts,
    around_sliders,
    evaluate_open,
    law_response,
    noise_response,
    solve_poles,
)
from middeck.values import record

MEMORIES, SETTLED = 15.0, 5.0
"""Record, and settling before it, over the time constant of the slowest mode that counts."""
LONGEST_S = 1000.0
COUNTS = 1e-2
"""Share of the mean square of the performance from which a mode counts."""
BEYOND = 2.0
"""Over the highest mode: where all is sought that may count."""
ABOVE = 1e-3
"""Share of the mean square of any output that is above the band."""
SAMPLES = 2.5
"""In a period of the band's end."""


@record(kw_only=True)
class SlipTime:
    """Record, settling before it, band of the noise and samples.

    ``short`` where the slowest mode asks for a record longer than `LONGEST_S`.
    """

    record_s: float
    settle_s: float
    band_hz: float
    sample_hz: float
    short: bool

    @property
    def samples(self) -> int:
        """Number of samples of the record."""
        return round(self.record_s * self.sample_hz)

    @property
    def settling(self) -> int:
        """Number of samples before the record, in which the loop settles."""
        return round(self.settle_s * self.sample_hz)

    @property
    def lines_hz(self) -> Float[np.ndarray, " line"]:
        """Noise lines [Hz]: halfway between multiples of one over the record, so that none is at zero."""
        return self._lines_hz(int(self.band_hz * self.record_s))

    def noise_lines(self, band_hz: tuple[float, float] | None) -> slice:
        """Indices of the noise lines in a band; all lines without one."""
        return _inside(self.lines_hz, band_hz)

    def record_lines(self, band_hz: tuple[float, float] | None) -> slice:
        """Indices of the record's lines in a band, the first of them those of the noise."""
        return _inside(self._lines_hz((self.samples + 1) // 2), band_hz)

    def _lines_hz(self, count: int) -> Float[np.ndarray, " line"]:
        return (np.arange(count) + 0.5) / self.record_s


def _inside(hz: Float[np.ndarray, " line"], band_hz: tuple[float, float] | None) -> slice:
    low, high = band_hz or (0.0, np.inf)
    return slice(int(np.searchsorted(hz, low)), int(np.searchsorted(hz, high, side="right")))


def choose_time(
    plant: Plant, laws: Iterable[Compensator | None], slips: DrawnSlips, plan: Plan, wiring: SlipPorts
) -> SlipTime:
    """The times of a run, by one plant.

    Raises `ConfigError` for a joint whose torque does not turn its own angle.
    """
    alone = around_sliders(plant, None, wiring, 1)
    joints = len(wiring.joints)
    turning = alone.C[:joints] @ alone.A @ alone.B  # angular acceleration by torque
    if np.any(alone.C[:joints] @ alone.B) or not np.all(np.diag(turning) > 0.0):
        raise ConfigError(
            f"the torques of {', '.join(wiring.joints)} do not turn the angles of these names",
            where="joint",
            hint="the joint's motor, and the relative angle that is read there, under one name",
        )
    every, springs = tuple(laws), slips.stiffness.max(axis=0)
    stiff = float(np.max(np.abs(turning) @ springs))
    asked_s = MEMORIES / _slowest(plant, plan)
    record_s = min(asked_s, LONGEST_S)
    both = plant, _sticking(plant, wiring, springs)
    band_hz = _band(both, every, plan, wiring, record_s)
    sample_hz = max(SAMPLES * band_hz, float(np.sqrt(stiff / GIVEN)))
    samples = cast("int", next_fast_len(int(np.ceil(record_s * sample_hz))))
    return SlipTime(
        record_s=samples / sample_hz,
        settle_s=record_s * SETTLED / MEMORIES,
        band_hz=band_hz,
        sample_hz=sample_hz,
        short=asked_s > LONGEST_S,
    )


def noise_intensity(plan: Plan, law: Compensator | None) -> Float[np.ndarray, " noise"]:
    """Square roots of the two-sided intensities of the disturbances, then of what ``law`` reads."""
    if law is None:
        return plan.intensity
    return np.concatenate([plan.intensity, np.sqrt(weights_of(plan, law.outputs, law.inputs).sensor)])


def _slowest(plant: Plant, plan: Plan) -> float:
    """Decay [1/s] of the slowest pole that counts in the performance without a compensator."""
    system = remove_delays(plant).system
    poles, vectors = solve_poles(system.A)
    B = system.B[:, plant.input_indices(plan.disturbances)] * plan.intensity
    C = plan.weights[:, None] * system.C[plant.output_indices(plan.performance)]
    drives = np.linalg.norm(np.linalg.solve(vectors, B.astype(complex)), axis=1)
    decay = np.maximum(-np.real(poles), np.finfo(float).tiny)
    square = (np.linalg.norm(C @ vectors, axis=0) * drives) ** 2 / decay
    return float(decay[square > COUNTS * square.sum()].min())


def _sticking(plant: Plant, wiring: SlipPorts, springs: Float[np.ndarray, " joint"]) -> Plant:
    """The plant with a spring in place of each slider."""
    gain = np.zeros((len(plant.inputs), len(plant.outputs)))
    gain[plant.input_indices(wiring.joints), plant.output_indices(wiring.joints)] = -springs
    return dataclasses.replace(plant, dynamics=close_static(remove_delays(plant).system, gain))


def _band(
    plants: Sequence[Plant],
    laws: Iterable[Compensator | None],
    plan: Plan,
    wiring: SlipPorts,
    record_s: float,
) -> float:
    """Half octave that holds all but a part of the mean square of every output, on all plants by all laws."""
    highest = [float(np.abs(solve_poles(remove_delays(p).system.A)[0]).max()) for p in plants]
    counts = [int(BEYOND * top / (2.0 * np.pi) * record_s) for top in highest]
    hz = np.arange(1, max(counts) + 1) / record_s
    each, end = [(p, n, evaluate_open(p, hz[:n])) for p, n in zip(plants, counts, strict=True)], 0
    for law in laws:
        answer = law_response(law, hz)
        for plant, n, G in each:
            H = noise_response(plant, G, law, answer, wiring, hz[:n]) * noise_intensity(plan, law)
            square = np.cumsum(np.sum(np.abs(H) ** 2, axis=2), axis=0)
            end = max(end, int(np.max(np.argmax(square >= (1.0 - ABOVE) * square[-1], axis=0))))
    return float(2.0 ** (0.5 * np.ceil(2.0 * np.log2(hz[end]))))
