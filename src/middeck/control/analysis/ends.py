"""Real end points of the return ratio: zero frequency, and half the sampling rate or infinity.

A real pole crosses the axis there, and the ratio along the axis need not show it: with a pole at the origin
that another loop stabilises too, each half of the loop is infinite while the ratio is finite.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.control.analysis.lines import AT_REST
from middeck.control.analysis.loop import At, FeedbackLoop, approximate_halves, broken_at, open_channel
from middeck.systems.resolvent import balance_states
from middeck.systems.statespace import StateSpace

Ends = tuple[tuple[float, Complex[np.ndarray, " channel"]], ...]
"""Angular frequency [rad/s] and the ratio of each channel there; infinite on a pole."""
REGULAR = 1e10
"""Condition number up to which the equations are solved at the end point itself."""
BESIDE = 1e-3
"""Otherwise: distances of the points of a third-order extrapolation, relative to the next pole."""


def find_ends(loop: FeedbackLoop, at: At) -> Ends:
    """The ratio at zero frequency, where delays have no effect, and at the other end; delayed loops have no
    limit there and give the first only."""
    halves = approximate_halves(loop)
    first = len(loop.inputs) if at == "outputs" else 0
    channels = [
        balance_states(open_channel(halves, i)) for i in range(first, first + len(broken_at(loop, at)))
    ]
    period = loop.period_s
    if period is not None:
        rest, fastest = (_values(channels, point) for point in (1.0, -1.0))
        return (0.0, rest), (np.pi / period, fastest)
    rest = _values(channels, 0.0)
    if loop.plant.delayed:
        return ((0.0, rest),)
    return (0.0, rest), (np.inf, np.array([-one.D[0, 0] for one in channels], dtype=complex))


def _values(channels: list[StateSpace], point: float) -> Complex[np.ndarray, " channel"]:
    return np.array([-_at(one, point) for one in channels], dtype=complex)


def _at(system: StateSpace, point: float) -> float:
    n = len(system.A)
    if not n or np.linalg.cond(point * np.eye(n) - system.A) < REGULAR:
        return _solve(system, point)
    away = np.abs(np.linalg.eigvals(system.A) - point)
    others = away[away > AT_REST * max(away.max(), 1.0)]
    step = BESIDE * (float(others.min()) if len(others) else 1.0)
    # Approach from the unstable side: right of the origin, or outside the unit circle.
    sign = -1.0 if point < 0.0 else 1.0
    far, middle, near = (_solve(system, point + sign * step * part) for part in (1.0, 0.5, 0.25))
    # On a pole the value doubles with each halving.
    return (8.0 * near - 6.0 * middle + far) / 3.0 if abs(near) < 1.5 * abs(middle) else np.inf


def _solve(system: StateSpace, point: float) -> float:
    states = np.linalg.solve(point * np.eye(len(system.A)) - system.A, system.B)
    return float((system.C @ states + system.D)[0, 0])
