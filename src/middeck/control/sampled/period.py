"""One sampling period of a plant with delayed inputs and measurements."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.systems.sampling.sampling import WHOLE
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record


@record
class Segment:
    """A part of the period within which no input changes.

    Attributes:
        duration_s: Its length.
        start: The plant's state at its start, then the inputs in force, from (states, new inputs) at the
            sample.
    """

    duration_s: float
    start: Float[np.ndarray, "held all"]


@record(kw_only=True)
class Between:
    """x' = A x + B u + noise of intensity V, seen by C and D; inputs and measurements delayed by samples."""

    A: np.ndarray
    B: np.ndarray
    V: np.ndarray
    C: np.ndarray
    D: np.ndarray
    delay_in: np.ndarray
    delay_out: np.ndarray
    period_s: float


@record(kw_only=True)
class _Layout:
    """Positions of the plant's states, past inputs, waiting measurements and new inputs."""

    states: int
    first: np.ndarray
    chain: np.ndarray
    size: int
    inputs: int

    def input_in_force(self, delay_in: np.ndarray, at: float) -> np.ndarray:
        """Rows that read, of states and new inputs, the inputs in force from ``at`` (in samples) on."""
        rows = np.zeros((self.inputs, self.size + self.inputs))
        for i, delay in enumerate(delay_in):
            age = int(np.ceil(delay - at - WHOLE))
            rows[i, self.size + i if age <= 0 else self.first[i] + age - 1] = 1.0
        return rows


def follow_period(between: Between) -> tuple[SampledStateSpace, np.ndarray, tuple[Segment, ...]]:
    """Propagate through one period, from event to event (a change of an input, or a measurement).

    The system from u to y, the covariance that noise adds to its states, and the segments between instants.
    """
    n, m = between.B.shape
    depth, waiting = np.ceil(between.delay_in).astype(int), np.ceil(between.delay_out).astype(int)
    first = n + np.concatenate([[0], np.cumsum(depth)])
    chain = int(first[-1]) + np.concatenate([[0], np.cumsum(waiting)])
    layout = _Layout(states=n, first=first, chain=chain, size=int(chain[-1]), inputs=m)
    looks = waiting - between.delay_out
    x = np.eye(n, layout.size + m)
    spread = np.zeros((n, n))
    seen: list[np.ndarray] = []  # rows of the measurements that wait from now on
    crossed = np.zeros((0, n))  # covariance of their noise with the state's
    own = np.zeros((0, 0))
    order: list[int] = []
    segments: list[Segment] = []
    for at, until in pairwise(_instants(np.concatenate([between.delay_in % 1.0, looks]))):
        force = layout.input_in_force(between.delay_in, at)
        for o in np.flatnonzero((waiting > 0) & (np.abs(looks - at) < WHOLE)):
            row = between.C[[o]]
            across = row @ spread
            own = np.block([[own, crossed @ row.T], [row @ crossed.T, across @ row.T]])
            crossed = np.vstack([crossed, across])
            seen.append((row @ x + between.D[[o]] @ force)[0])
            order.append(int(o))
        duration = (until - at) * between.period_s
        segments.append(Segment(duration, np.vstack([x, force])))
        step, drive, added = _step(between, duration)
        x = step @ x + drive @ force
        spread, crossed = step @ spread @ step.T + added, crossed @ step.T
    return _assemble(between, layout, x, (seen, order), (spread, crossed, own), segments)


def _instants(parts: np.ndarray) -> list[float]:
    """Distinct instants from 0 to 1."""
    found = [0.0]
    for part in np.sort(parts):
        if found[-1] + WHOLE < part < 1.0 - WHOLE:
            found.append(float(part))
    return [*found, 1.0]


def _step(between: Between, duration_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n, m = between.B.shape
    both = np.zeros((n + m, n + m))
    both[:n, :n], both[:n, n:] = between.A, between.B
    intensity = np.zeros_like(both)
    intensity[:n, :n] = between.V
    spread = spread_noise(both, intensity, duration_s)
    return spread.transition[:n, :n], spread.transition[:n, n:], spread.covariance[:n, :n]


def _assemble(
    between: Between,
    layout: _Layout,
    x: np.ndarray,
    waits: tuple[list[np.ndarray], list[int]],
    noise: tuple[np.ndarray, np.ndarray, np.ndarray],
    segments: list[Segment],
) -> tuple[SampledStateSpace, np.ndarray, tuple[Segment, ...]]:
    n, m, size = layout.states, layout.inputs, layout.size
    seen, order = waits
    spread, crossed, own = noise
    both = np.zeros((size, size + m))
    both[:n] = x
    for i in range(m):
        places = range(int(layout.first[i]), int(layout.first[i + 1]))
        for k in places:
            both[k, size + i if k == places[0] else k - 1] = 1.0
    added = np.zeros((size, size))
    added[:n, :n] = spread
    heads = [int(layout.chain[o]) for o in order]
    for head, row in zip(heads, seen, strict=True):
        both[head] = row
    added[np.ix_(heads, range(n))], added[np.ix_(range(n), heads)] = crossed, crossed.T
    added[np.ix_(heads, heads)] = own
    read = np.hstack([between.C, np.zeros((len(between.C), size + m - n))])
    read = read + between.D @ layout.input_in_force(between.delay_in, 0.0)
    for o in order:
        start, end = int(layout.chain[o]), int(layout.chain[o + 1])
        for k in range(start + 1, end):
            both[k, k - 1] = 1.0
        read[o] = 0.0
        read[o, end - 1] = 1.0
    system = SampledStateSpace(
        both[:, :size], both[:, size:], read[:, :size], read[:, size:], period_s=between.period_s
    )
    return system, added, tuple(segments)
