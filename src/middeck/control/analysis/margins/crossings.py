"""Crossings of a return ratio with the negative real axis or the unit circle, to rounding."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.optimize import elementwise, minimize_scalar

from middeck.control.analysis.loop.frequency_lines import WIDEST
from middeck.values import record

SKEW = 1.07
"""Exponent that keeps new points off the middle of an interval, where a pole on the axis may lie."""
MOST_PEAKS, MOST_ROUNDS = 12, 12
MOST = 300
"""Crossings of a channel that are found on each side of a gain of one: a delay makes thousands, most of them
far from it."""
REAL, NARROW = 1e-9, 1e-7
"""Imaginary part over the real one: that of a ratio without a phase of its own, by rounding. Part of its
bracket to which an extremum is found."""
FLAT = 1e-10
"""Drop to the neighbours of the highest point; a parabola through them rises by a quarter of it at most."""
Ratio = Callable[[np.ndarray], np.ndarray]


@record
class Crossings:
    """Sign changes of one quantity of L, channel by channel.

    Attributes:
        omega: Angular frequency [rad/s].
        channel: Position of the channel.
        L: The ratio there.
    """

    omega: Float[np.ndarray, " crossing"]
    channel: Int[np.ndarray, " crossing"]
    L: Complex[np.ndarray, " crossing"]


def axis_crossings(ratio: Ratio, omega: Float[np.ndarray, " line"], L: np.ndarray) -> Crossings:
    """Real negative values of L within 80 dB of one; of many in a channel, the `MOST` nearest on each side.

    Where L is real everywhere, only where it turns back: roots on the axis meet there, and one leaves it.
    """
    real = np.abs(np.imag(L)) <= REAL * np.abs(np.real(L))
    # An undamped loop: its crossings would be rounding.
    undamped = 2 * np.sum(real, axis=0) > len(real)
    none = (real[1:] & real[:-1] & undamped) | _far(ratio, omega, L)
    # Project on a sphere: the curve stays finite through a pole on the axis, which is then recognised.
    found = join_crossings(
        _roots(ratio, omega, L, lambda x: np.imag(x) / (1.0 + np.abs(x) ** 2), none),
        *(_turns(ratio, omega, L, k) for k in np.flatnonzero(undamped).tolist()),
    )
    size = np.abs(found.L)
    return _keep(found, (np.real(found.L) < 0.0) & (size < WIDEST) & (size > 1.0 / WIDEST))


def circle_crossings(ratio: Ratio, omega: Float[np.ndarray, " line"], L: np.ndarray) -> Crossings:
    """Crossings of L with the unit circle."""
    found = _roots(ratio, omega, L, lambda x: (np.abs(x) ** 2 - 1.0) / (np.abs(x) ** 2 + 1.0))
    return _keep(found, np.isfinite(found.L))


def _turns(ratio: Ratio, omega: np.ndarray, L: np.ndarray, channel: int) -> Crossings:
    """Extrema of an L that is real and negative."""
    value = np.real(L[:, channel])
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.diff(np.log(np.abs(value)))
    plain = np.flatnonzero(np.abs(step) > REAL)
    at: list[float] = []
    for i, j in pairwise(plain.tolist()):
        if step[i] * step[j] < 0.0 and np.all(value[i : j + 2] < 0.0):
            at.append(_extremum(ratio, channel, (omega[i], omega[j + 1]), up=bool(step[i] > 0.0)))
    where = np.array(at, dtype=float)
    k = np.full(len(where), channel)
    return Crossings(where, k, _pick(ratio, where, k) if len(where) else np.zeros(0, dtype=complex))


def _extremum(ratio: Ratio, channel: int, bounds: tuple[float, float], *, up: bool) -> float:
    def size(x: float) -> float:
        gain = float(np.abs(ratio(1j * np.array([x]))[0, channel]))
        return -gain if up else gain

    narrow = {"xatol": NARROW * (bounds[1] - bounds[0])}
    found: Any = minimize_scalar(size, bounds=bounds, method="bounded", options=narrow)
    return float(found.x)


def _far(ratio: Ratio, omega: np.ndarray, L: np.ndarray) -> Bool[np.ndarray, "step channel"]:
    """Steps across the positive real axis, and those across the negative one beyond `MOST` on a side of one.

    The nearest below one and the nearest above are both limits of gain.
    """
    positive, below = np.real(L) > 0.0, np.signbit(np.imag(L))
    far = positive[1:] & positive[:-1]
    for channel, across in enumerate((below[1:] != below[:-1]).T):
        steps = np.flatnonzero(across & ~far[:, channel])
        if len(steps) <= MOST:
            continue
        level = _levels(ratio, omega, L, steps, channel)
        order = np.argsort(np.abs(level), kind="stable")
        above = (level > 0.0)[order]
        for side in (above, ~above):
            far[steps[order[side][MOST:]], channel] = True
    return far


def _levels(
    ratio: Ratio, omega: np.ndarray, L: np.ndarray, steps: np.ndarray, channel: int
) -> Float[np.ndarray, " crossing"]:
    """Logarithms of the gain where L crosses the negative real axis, from one more line within each step.

    The gain at an end of the step would do if steps were alike. Where crossings repeat from the first turn of
    a delay to the thousandth, the nearest to one may have a short step, others a long one that begins nearer.
    """
    ends = np.stack([L[steps, channel], L[steps + 1, channel]])
    with np.errstate(divide="ignore", invalid="ignore"):
        level, turn = np.log(np.abs(ends)), np.angle(-ends)
        share = turn[0] / (turn[0] - turn[1])
        between = ratio(1j * (omega[steps] + share * (omega[steps + 1] - omega[steps])))[:, channel]
        slope = (level[1] - level[0]) / (turn[1] - turn[0])
        found = np.log(np.abs(between)) - slope * np.angle(-between)
    return np.where(np.isfinite(found), found, np.inf)


def join_crossings(*parts: Crossings) -> Crossings:
    """All crossings together."""
    omega, channel, L = (
        np.concatenate(x) for x in zip(*((p.omega, p.channel, p.L) for p in parts), strict=True)
    )
    return Crossings(omega, channel, L)


def _keep(found: Crossings, which: np.ndarray) -> Crossings:
    return Crossings(found.omega[which], found.channel[which], found.L[which])


def _roots(
    ratio: Ratio,
    omega: np.ndarray,
    L: np.ndarray,
    value: Callable[[np.ndarray], np.ndarray],
    none: np.ndarray | bool = False,
) -> Crossings:
    """Roots bracketed by neighbouring lines, found together by Chandrupatla's method (1997).

    There are ``none`` at some of the steps from line to line.
    """
    levels = value(L)
    line, channel = np.nonzero((np.signbit(levels[1:]) != np.signbit(levels[:-1])) & ~np.asarray(none))
    if not len(line):
        return Crossings(np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=complex))

    def at(x: np.ndarray, k: np.ndarray) -> np.ndarray:
        # A pole on the axis is no crossing; its gain shows it afterwards.
        return np.nan_to_num(value(_pick(ratio, x, k)))

    solve: Any = elementwise.find_root
    root = solve(at, (omega[line], omega[line + 1]), args=(channel,)).x
    return Crossings(root, channel, np.nan_to_num(_pick(ratio, root, channel), nan=np.inf))


def _pick(ratio: Ratio, omega: np.ndarray, channel: np.ndarray) -> np.ndarray:
    x, k = np.broadcast_arrays(omega, channel)
    each = ratio(1j * x.ravel())
    return each[np.arange(x.size), k.ravel().astype(int)].reshape(x.shape)


def find_peaks(
    function: Callable[[np.ndarray], np.ndarray], omega: Float[np.ndarray, " line"], value: np.ndarray
) -> tuple[float, float]:
    """Frequency and size of the largest value of a positive function, refined between the lines.

    Peaks within a tenth of the highest line are narrowed to an eighth repeatedly until they are flat;
    narrower intervals show rounding only, most of all beside a pole that cancels.
    """
    padded = np.concatenate([[-np.inf], value, [-np.inf]])
    peaks = np.flatnonzero((value >= padded[:-2]) & (value >= padded[2:]) & (value >= 0.9 * value.max()))
    peaks = peaks[np.argsort(-value[peaks], kind="stable")[:MOST_PEAKS]]
    low, high = omega[np.maximum(peaks - 1, 0)], omega[np.minimum(peaks + 1, len(omega) - 1)]
    best, place = value[peaks[0]], omega[peaks[0]]
    share = np.linspace(0.0, 1.0, 9) ** SKEW
    for _ in range(MOST_ROUNDS):
        x = low[:, None] + (high - low)[:, None] * share
        y = function(x.ravel()).reshape(x.shape)
        rows, top = np.arange(len(x)), np.argmax(y, axis=1)
        lead = int(np.argmax(y[rows, top]))
        if y[lead, top[lead]] > best:
            best, place = y[lead, top[lead]], x[lead, top[lead]]
        left, right = np.maximum(top - 1, 0), np.minimum(top + 1, 8)
        going = np.minimum(y[rows, left], y[rows, right]) < (1.0 - FLAT) * y[rows, top]
        if not going.any():
            break
        low, high = x[rows, left][going], x[rows, right][going]
    return float(place), float(best)
