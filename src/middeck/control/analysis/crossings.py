"""Where a return ratio meets the negative real axis or the unit circle, to rounding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.control.analysis.lines import WIDEST
from middeck.values import record

SKEW = 1.07
"""Exponent that keeps new points off the middle of an interval, where a pole on the axis may lie."""
MOST_PEAKS, MOST_ROUNDS = 12, 12
TIGHT, MOST_STEPS = 4.0 * np.finfo(float).eps, 100
"""Relative width to which a crossing is bracketed; halving alone takes 52 steps."""
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
    """Where L is real and negative, within 80 dB of one."""
    # Project on a sphere: the curve stays finite through a pole on the axis, which is then recognised.
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
    """Roots bracketed by neighbouring frequency lines, found together by Chandrupatla's method (1997)."""
    levels = value(L)
    line, channel = np.nonzero(np.signbit(levels[1:]) != np.signbit(levels[:-1]))
    if not len(line):
        return Crossings(np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=complex))

    def at(x: np.ndarray, k: np.ndarray) -> np.ndarray:
        # A pole on the axis is no crossing; its gain shows it afterwards.
        return np.nan_to_num(value(_pick(ratio, x, k)))

    root = _bracketed(at, omega[line], omega[line + 1], channel)
    return Crossings(root, channel, np.nan_to_num(_pick(ratio, root, channel), nan=np.inf))


def _bracketed(
    f: Callable[[np.ndarray, np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, channel: np.ndarray
) -> Float[np.ndarray, " root"]:
    """Roots of f between ``low`` and ``high``, each by inverse quadratic steps or halves, to rounding.

    Some brackets at a time cost `scipy.optimize.elementwise.find_root` ten times as much in bookkeeping.
    """
    x1, x2, root = low.copy(), high.copy(), low.copy()
    f1, f2 = f(x1, channel), f(x2, channel)
    part, left = np.full(len(x1), 0.5), np.arange(len(x1))
    for _ in range(MOST_STEPS):
        x = x1 + part * (x2 - x1)
        y = f(x, channel[left])
        same = np.signbit(y) == np.signbit(f1)
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, y
        nearer = np.abs(f2) < np.abs(f1)
        root[left] = np.where(nearer, x2, x1)
        narrow = TIGHT * np.abs(root[left]) / np.abs(x2 - x1)
        on = (narrow <= 0.5) & (np.where(nearer, f2, f1) != 0.0)
        if not on.any():
            break
        x1, x2, x3, f1, f2, f3, left, narrow = (v[on] for v in (x1, x2, x3, f1, f2, f3, left, narrow))
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        inverse = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        part = np.clip(np.where(inverse, t, 0.5), narrow, 1.0 - narrow)
    return root


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
