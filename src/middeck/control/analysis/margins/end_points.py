"""Real end points of the return ratio: zero frequency, and half the sampling rate or infinity.

A real pole crosses the axis there, and the ratio along the axis need not show it: with a pole at the origin
that another loop stabilises too, each half of the loop is infinite while the ratio is finite.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.control.analysis.loop.feedback_loop import (
    At,
    FeedbackLoop,
    approximate_halves,
    channels_at,
    open_channel,
)
from middeck.systems.poles.integrators import part_integrators
from middeck.systems.state_space.statespace import LinearSystem, StateSpace

Ends = tuple[tuple[float, Complex[np.ndarray, " channel"]], ...]
"""Angular frequency [rad/s] and the ratio of each channel there; infinite on a pole."""


def find_ends(loop: FeedbackLoop, at: At) -> Ends:
    """The ratio at zero frequency, where delays have no effect, and at the other end; delayed loops have no
    limit there and give the first only."""
    halves = approximate_halves(loop)
    channels = [open_channel(halves, i) for i in channels_at(loop, at)]
    period = loop.period_s
    if period is not None:
        rest, fastest = (_values(channels, point) for point in (1.0, -1.0))
        return (0.0, rest), (np.pi / period, fastest)
    rest = _values(channels, 0.0)
    if loop.plant.delayed:
        return ((0.0, rest),)
    return (0.0, rest), (np.inf, np.array([-one.D[0, 0] for one in channels], dtype=complex))


def _values(channels: list[LinearSystem], point: float) -> Complex[np.ndarray, " channel"]:
    return np.array([-_at(one, point) for one in channels], dtype=complex)


def _at(system: LinearSystem, point: float) -> float:
    """The transfer at a real point; infinite on a pole whose residues do not vanish."""
    beside = StateSpace(system.A - point * np.eye(len(system.A)), system.B, system.C, system.D)
    parted = part_integrators(beside)
    if np.any(parted.residues):
        return np.inf
    moving = parted.moving
    return float((moving.D - moving.C @ np.linalg.solve(moving.A, moving.B))[0, 0])
