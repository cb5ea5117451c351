"""Where to prove: discs of gains that cover an interval, from the loop's frequency response.

At a gain g the loop stays regular on the unit circle for every change below the distance of g from the
inverse Nyquist locus 1 / L (the circle criterion; Zames 1966, IEEE TAC 11). The discs are a plan and prove
nothing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.realtime.gate.gain_loop import GainLoop, closed_at
from middeck.systems.poles.resolvent import evaluate_transfer
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

SHARE = 0.7
"""Of a disc's radius that is planned with."""
WHOLE = 0.9
"""Of the radius of a disc that alone covers the interval."""
BEYOND = 4.0
"""How far the last centre may lie, in lengths of the interval."""
SCANNED = 33
MOST = 300
"""Gains looked at for poles outside the unit circle; most discs."""
LARGEST = 64
"""Lines of the largest response at which singular values are computed."""


@record
class Disc:
    """Gains from ``centre`` - ``radius`` to ``centre`` + ``radius``."""

    centre: float
    radius: float


@record
class Undecided:
    """A gain about which nothing is decided."""

    gain: float


@record
class Response:
    """L = C (z - A)^-1 B on the unit circle, in ``units`` of the commands that make it small."""

    L: Complex[np.ndarray, "line command command"]
    units: Float[np.ndarray, " command"]


def scan_gains(low: float, high: float) -> Float[np.ndarray, " gain"]:
    """Gains at which poles are looked at: dense near the lower end, where light modes are least held."""
    even = np.linspace(low, high, SCANNED)
    near = low + (high - low) * np.geomspace(1e-4, 1.0, SCANNED)
    return np.unique(np.concatenate([even, near]))


def find_response(loop: GainLoop, low: float, high: float) -> Response:
    """The response at the peaks of the loop over the interval."""
    omega = [np.linspace(0.0, np.pi, 400), np.geomspace(1e-5, np.pi, 400)]
    offsets = np.array([-3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0])
    for gain in scan_gains(low, high)[::4]:
        poles = np.linalg.eigvals(closed_at(loop, float(gain)))
        width = np.minimum(np.abs(1.0 - np.abs(poles)) + 1e-9, 0.1)
        omega.append((np.abs(np.angle(poles))[:, None] + width[:, None] * offsets).ravel())
    lines = np.unique(np.round(np.clip(np.concatenate(omega), 0.0, np.pi), 7))
    system = SampledStateSpace(loop.A, loop.B, loop.C, loop.D, period_s=loop.period_s)
    with np.errstate(all="ignore"):
        found = evaluate_transfer(system, np.exp(1j * lines))
    L = found[np.isfinite(found).all(axis=(1, 2))]  # beside a pole on the circle stand its neighbours
    _, units = balance(np.abs(L).max(axis=0))
    return Response(L * units / units[:, None], units)


def disc_radius(response: Response, gain: float) -> float:
    """Distance of ``gain`` from the inverse locus; of several commands, the inverse of the largest gain."""
    L = response.L
    if L.shape[1] == 1:
        with np.errstate(divide="ignore", invalid="ignore"):
            locus = 1.0 / L[:, 0, 0] - gain
        return _distance(locus[np.isfinite(locus)])
    try:
        closed = np.linalg.solve((np.eye(L.shape[1]) - gain * L).mT, L.mT).mT
    except np.linalg.LinAlgError:
        return 0.0
    large = np.argsort(np.linalg.norm(closed, axis=(1, 2)))[-LARGEST:]
    peak = float(np.linalg.norm(closed[large], 2, axis=(1, 2)).max(initial=0.0))
    return 1.0 / peak if peak > 0.0 else np.inf


def _distance(locus: Complex[np.ndarray, " line"]) -> float:
    """Distance of zero from the locus, straight between lines: between peaks of L its inverse is smooth."""
    if not len(locus):
        return np.inf
    start, way = locus[:-1], np.diff(locus)
    length = np.abs(way) ** 2
    at = -np.real(np.conj(way) * start) / np.where(length > 0.0, length, 1.0)
    nearest = np.abs(start + np.clip(at, 0.0, 1.0) * way)
    return float(min(nearest.min(initial=np.inf), np.abs(locus).min()))


def whole_disc(response: Response, low: float, high: float) -> Disc | None:
    """One disc over the interval, its centre as far above it as need be."""
    half = 0.5 * (high - low)
    for centre in low + half * np.geomspace(1.0, 32.0, 21):
        radius = WHOLE * disc_radius(response, float(centre))
        if centre - radius <= low and centre + radius >= high:
            return Disc(float(centre), min(radius, 2.0 * (float(centre) - low)))
    return None


def plan_discs(response: Response, low: float, high: float) -> list[Disc] | Undecided:
    """Discs from end to end, each of which holds its neighbours' centres.

    A disc's radius changes by no more than its centre, so that each next centre is found by bisection.
    """
    span = high - low

    def reach(gain: float) -> float:
        return min(SHARE * disc_radius(response, gain), 2.0 * span)

    discs: list[Disc] = []
    beyond = low + BEYOND * span
    at, most = low, beyond
    while len(discs) < MOST:
        gain = _farthest(lambda g, at=at: g - reach(g) <= at, at, most)
        radius = reach(gain)
        if discs and gain - at <= 1e-6 * span:
            return Undecided(at)
        discs.append(Disc(gain, radius))
        if gain + radius >= high:
            return discs
        at, most = gain, min(beyond, gain + radius)
    return Undecided(at)


def _farthest(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The largest gain up to which ``holds``, to a thousandth of what is left."""
    if holds(high):
        return high
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
