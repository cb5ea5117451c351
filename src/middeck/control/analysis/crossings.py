"""Where a return ratio meets the negative real axis or the unit circle, to rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.optimize import elementwise

from middeck.control.analysis.lines import WIDEST
from middeck.values import record

SKEW = 1.07
"""Exponent that keeps new points off the middle of an interval, where a pole on the axis may lie."""
MOST_PEAKS, MOST_ROUNDS = 12, 12
MOST = 300
"""Crossings of a channel that are found: a delay makes thousands, most of them far from a gain of one."""
REAL = 1e-9
"""Imaginary part over the real one: that of a ratio without a phase of its own, by rounding."""
FLAT = 1e-10
"""Drop to the neighbours of the highest point; a parabola through them rises by a quarter of it at most."""
Ratio = Callable[[np.ndarray], np.ndarray]


@record
class Crossings:
    """Where one quantity of L changes sign, channel by channel.

    Attributes:
        omega: Angular frequency [rad/s].
        channel: Position of the channel.
        L: The ratio there.
    """

    omega: Float[np.ndarray, " crossing"]
    channel: Int[np.ndarray, " crossing"]
    L: Complex[np.ndarray, " crossing"]


def axis_crossings(ratio: Ratio, omega: Float[np.ndarray, " line"], L: np.ndarray) -> Crossings:
    """Where L is real and negative, within 80 dB of one; of many a channel, the `MOST` nearest to one."""
    # Project on a sphere: the curve stays finite through a pole on the axis, which is then recognised.
    none = _is_real(L) | _far(L)
    found = _roots(ratio, omega, L, lambda x: np.imag(x) / (1.0 + np.abs(x) ** 2), none)
    size = np.abs(found.L)
    return _keep(found, (np.real(found.L) < 0.0) & (size < WIDEST) & (size > 1.0 / WIDEST))


def circle_crossings(ratio: Ratio, omega: Float[np.ndarray, " line"], L: np.ndarray) -> Crossings:
    """Where L has gain one."""
    found = _roots(ratio, omega, L, lambda x: (np.abs(x) ** 2 - 1.0) / (np.abs(x) ** 2 + 1.0))
    return _keep(found, np.isfinite(found.L))


def _is_real(L: np.ndarray) -> Bool[np.ndarray, "line channel"]:
    """Whether L is real at a line and the next: an undamped loop is, and its crossings would be rounding."""
    real = np.abs(np.imag(L)) <= REAL * np.abs(np.real(L))
    return real[1:] & real[:-1]


def _far(L: np.ndarray) -> Bool[np.ndarray, "line channel"]:
    """Steps across the positive real axis, and all but the `MOST` across the negative one nearest to one."""
    positive, below = np.real(L) > 0.0, np.signbit(np.imag(L))
    far = positive[1:] & positive[:-1]
    with np.errstate(divide="ignore"):
        level = np.abs(np.log(np.abs(L)))
    for channel, across in enumerate((below[1:] != below[:-1]).T):
        steps = np.flatnonzero(across & ~far[:, channel])
        nearest = np.argsort(np.fmin(level[steps, channel], level[steps + 1, channel]), kind="stable")
        far[steps[nearest[MOST:]], channel] = True
    return far


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
