"""Durations counted in a fixed number of bins: percentiles of runs of any length, in half a megabyte."""

import numpy as np
from jaxtyping import Float, Int

from middeck.values import record

FINE = 1024
"""Bins of each power of two: a bin is below a thousandth of its duration wide, and of one ns up to 2047."""
BINS = FINE * 54
"""All that 63 bits hold."""


@record
class Durations:
    """How many durations lie in each bin, and the longest of them [ns]."""

    counts: Int[np.ndarray, " bin"]
    longest: int


def no_durations() -> Durations:
    """None yet."""
    return Durations(np.zeros(BINS, np.int64), 0)


def count_durations(known: Durations, ns: Int[np.ndarray, " duration"]) -> Durations:
    """``known`` and those of ``ns``; one below zero counts as zero."""
    if not len(ns):
        return known
    counts = np.bincount(_bin(np.maximum(ns, 0)), minlength=BINS)
    return Durations(known.counts + counts, max(known.longest, int(ns.max())))


def percentiles(found: Durations, percent: tuple[float, ...]) -> Float[np.ndarray, " percentage"]:
    """As `numpy.percentile` [ns], to half a bin (0.05 %); the longest is exact.

    >>> percentiles(count_durations(no_durations(), np.array([5, 7, 1_000_003])), (25.0, 100.0)).tolist()
    [6.0, 1000003.0]
    """
    upto, last = np.cumsum(found.counts), int(found.counts.sum()) - 1
    at = np.asarray(percent) / 100.0 * last
    below = np.floor(at).astype(np.int64)
    low, high = (
        np.where(
            rank >= last,
            found.longest,
            np.minimum(_middle(np.searchsorted(upto, rank, side="right")), found.longest),
        )
        for rank in (below, np.minimum(below + 1, last))
    )
    return low + (at - below) * (high - low)


def _bin(ns: Int[np.ndarray, " duration"]) -> Int[np.ndarray, " duration"]:
    shift = np.maximum(np.frexp(ns.astype(float))[1] - 11, 0)
    return FINE * shift + (ns >> shift)


def _middle(place: Int[np.ndarray, " bin"]) -> Float[np.ndarray, " bin"]:
    shift = np.maximum(place // FINE - 1, 0)
    return ((place - FINE * shift) << shift) + 0.5 * ((1 << shift) - 1)
