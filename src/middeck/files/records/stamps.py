"""The even sampling grid behind printed time stamps."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

# Share of a time step by which a time stamp may be off: more than the rounding of printed stamps, and 0.4
# degrees of phase at a tenth of the sampling rate.
JITTER = 0.01
# Deviations of a step that was fitted to rounded stamps, within which a rounder rate is the one meant.
SURE = 4.0
# A rate [Hz] below which times without a unit are rather milliseconds or lines counted.
SLOW = 10.0
# Seconds since 1970 of a record made from 2001 to 2096.
EPOCH = (1e9, 4e9)
# A rate [Hz] below which they rather are ticks of a counter.
LOGGED = 1.0 / 60.0
# Half a unit of the last digit, and what printed decimals lose as binary numbers.
HALF = 0.5 + 1e-6


def last_digit(texts: Iterable[str]) -> float:
    """A unit of the last digit [s] of the stamps that are printed finest.

    >>> last_digit(["0.000", "0.004", "7.8e-3"])
    0.0001
    """
    found = (re.fullmatch(r"\s*[+-]?\d*\.?(\d*)(?:[eEdD]([+-]?\d+))?\s*", text) for text in texts)
    decimals = [len(m.group(1)) - int(m.group(2) or 0) for m in found if m is not None]
    return float(f"1e{-max(decimals, default=0)}")


def rate_of(step: float, samples: int, digit: float) -> float:
    """The roundest rate [Hz] that agrees with a step fitted to so many stamps.

    Rounding errors have the deviation digit / sqrt(12), so that the slope of a line through N of them has
    digit / N^1.5. Decimal stamps carry no more than nine digits in any case.

    >>> rate_of(0.00390626, 4000, 1e-3), rate_of(0.00390626, 4000, 1e-9)
    (256.0, 255.999345)
    """
    slack = SURE * digit / samples**1.5
    rounded = (float(f"{1.0 / step:.{d}g}") for d in range(1, 9))
    return next((r for r in rounded if abs(1.0 / r - step) <= slack), float(f"{1.0 / step:.9g}"))


def open_share(rate: float, samples: int, digit: float) -> float:
    """Relative uncertainty of the rate (`rate_of`) from rounded stamps."""
    return 2.0 * SURE * digit / samples**1.5 * rate


def mean_step(moment: float, total: float, samples: int) -> float:
    """The step of the least-squares line, from sum k (t_k - t_0) and sum (t_k - t_0)."""
    return 12.0 * (moment - 0.5 * (samples - 1) * total) / (samples * (samples**2 - 1.0))


def is_even(
    time: Float[np.ndarray, " line"], index: Int[np.ndarray, " line"], step: float, digit: float
) -> bool:
    """Whether the stamps lie on ``index`` steps: within `JITTER`, or all within half their last digit.

    A digit coarser than half a step would hide missing lines: such stamps are not even.
    """
    if step <= 0.0:
        return False
    off = time - time[0] - step * index
    if np.abs(off - 0.5 * (off.max() + off.min())).max() <= JITTER * step:
        return True
    return digit <= 0.5 * step and _least_deviation(index, off) <= HALF * digit


def _least_deviation(index: Int[np.ndarray, " line"], off: Float[np.ndarray, " line"]) -> float:
    """Largest deviation of time stamps from their best line (Chebyshev's), found from the corners of
    their hull decide."""
    if len(off) < 4:
        return float(np.ptp(off))
    k, size = index / index[-1], np.abs(off).max()
    corners = ConvexHull(np.column_stack([k, off / size])).vertices
    line = np.column_stack([np.ones(len(corners)), k[corners]])
    worst = np.ones((len(corners), 1))
    found = linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.block([[line, -worst], [-line, -worst]]),
        b_ub=np.concatenate([off[corners], -off[corners]]) / size,
        bounds=[(None, None), (None, None), (0.0, None)],
    )
    return float(found.fun) * size if found.success else np.inf


def since_1970(first: float) -> bool:
    """Whether a record's ``first`` stamp may be seconds since then."""
    return EPOCH[0] <= first < EPOCH[1]


def warning_on_seconds(rate: float, counted: bool, first: float) -> str:
    """A warning for stamps read as seconds, at a ``rate`` [Hz] at which no structure is sampled; empty for
    others, or where the ``first`` may be seconds since 1970."""
    if (not counted and rate >= SLOW) or (since_1970(first) and rate >= LOGGED):
        return ""
    meant = "they count the lines" if counted else f"if they are milliseconds, it is {1e3 * rate:.6g} Hz"
    return f"times are read as seconds, so that the rate is {rate:.6g} Hz: {meant}"
