"""Where a return ratio meets the negative real axis or the unit circle, to rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.optimize import elementwise

from middeck.control.analysis.lines import WIDEST
from middeck.values import record

SKEW = 1.07
"""Points are not put half-way: that may be a pole on the axis, around which lines were placed."""
MOST_PEAKS, MOST_ROUNDS = 12, 12
FLAT = 1e-10
"""A parabola whose points beside the highest lie no further below it rises by a quarter of that at most."""
Ratio = Callable[[np.ndarray], np.ndarray]


@record
class Crossings:
    """Where one quantity of L changes sign, channel by channel.

    Parameters
    ----------
    omega:
        Angular frequency [rad/s].
    channel:
        Position of the channel.
    L:
        The ratio there.
    """

    omega: Float[np.ndarray, " crossing"]
    channel: Int[np.ndarray, " crossing"]
    L: Complex[np.ndarray, " crossing"]


def axis_crossings(ratio: Ratio, omega: Float[np.ndarray, " line"], L: np.ndarray) -> Crossings:
    """Where L is real and negative, within 80 dB of one."""
    # Projected on a sphere, so that the way through a pole on the axis stays finite and is recognised.
    found = _roots(ratio, omega, L, lambda x: np.imag(x) / (1.0 + np.abs(x) ** 2))
    size = np.abs(found.L)
    return _keep(found, (np.real(found.L) < 0.0) & (size < WIDEST) & (size > 1.0 / WIDEST))


def circle_crossings(ratio: Ratio, omega: Float[np.ndarray, " line"], L: np.ndarray) -> Crossings:
    """Where L has gain one."""
    found = _roots(ratio, omega, L, lambda x: (np.abs(x) ** 2 - 1.0) / (np.abs(x) ** 2 + 1.0))
    return _keep(found, np.isfinite(found.L))


def _keep(found: Crossings, which: np.ndarray) -> Crossings:
    return Crossings(found.omega[which], found.channel[which], found.L[which])


def _roots(
    ratio: Ratio, omega: np.ndarray, L: np.ndarray, value: Callable[[np.ndarray], np.ndarray]
) -> Crossings:
    """Bracketed by neighbouring lines, then by Chandrupatla's method (1997), all at once."""
    levels = value(L)
    line, channel = np.nonzero(np.signbit(levels[1:]) != np.signbit(levels[:-1]))
    if not len(line):
        return Crossings(np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=complex))

    def at(x: np.ndarray, k: np.ndarray) -> np.ndarray:
        # A pole on the axis is no crossing: it is told by its gain afterwards.
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
    """The largest of a positive function of frequency, beyond the grid: where, and how large.

    The highest peaks, those within a tenth of the highest line, are narrowed to an eighth time and again
    until they are flat: narrower there is rounding only, the more the nearer to a pole that cancels.
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
