"""Lag of a parameter that moves faster than its assumed drift, estimated from the filter's corrections.

A filter for a random walk of intensity q^2 runs behind a ramp r by r / (q sqrt(I)), I the information of one
second, which may be many of its deviations: these count chance alone. What each sample would correct, over
the variance, is the score of an offset of the parameter (Willsky and Jones 1976); summed over twice the
memory of the filter it gives the mean lag and its deviation. A lag that is seen widens the deviation; one
beyond chance is news: it opens the filter, and the drift is taken to be as fast as what it missed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# Rows of the sums of each parameter: score, information, variance of the score, seconds, added drift.
ROWS = 5
SCORE, INFORMATION, CHANCE, SECONDS, DRIFT = range(ROWS)
Sums = Float[np.ndarray, "5 parameter"]
# Longest memory [s] of the sums.
LONGEST_S = 64.0
# Standard deviations of a lag by chance: the rest counts in the stated deviation.
BY_CHANCE = 2.0
# Standard deviations beyond which the filter is opened: by chance once in 2000 independent looks.
BEYOND_CHANCE = 3.5
# Shortest time [s] from which a drift is estimated.
SHORTEST_S = 1.0
# Time [s] in which an added drift is given up again.
FORGOTTEN_S = 10.0


def no_lag(parameters: int) -> Sums:
    """The sums before the first sample."""
    return np.zeros((ROWS, parameters))


def add(
    lag: Sums,
    move: Float[np.ndarray, " parameter"],
    removed: Float[np.ndarray, " parameter"],
    variance: Float[np.ndarray, " parameter"],
    T: float,
) -> None:
    """Add a correction, with the variance that it removes from that before it."""
    by = removed / variance
    keep = 1.0 - np.maximum(0.5 * by, T / LONGEST_S)
    lag[:DRIFT] *= keep
    lag[CHANCE] *= keep
    lag[SCORE] += move / variance
    lag[INFORMATION] += by / variance
    lag[CHANCE] += by / variance
    lag[SECONDS] += T


def mean_lag(lag: Sums) -> Float[np.ndarray, " parameter"]:
    """Mean offset over the memory of the sums; zero where nothing is known."""
    return lag[SCORE] / np.where(lag[INFORMATION] > 0.0, lag[INFORMATION], np.inf)


def unexplained(lag: Sums) -> Float[np.ndarray, " parameter"]:
    """Square of the lag in excess of chance.

    >>> sums = no_lag(2)
    >>> for k in range(100):
    ...     add(sums, np.array([0.04, 0.0]), np.full(2, 0.01), np.ones(2), 0.1)
    >>> unexplained(sums).round(1).tolist()
    [11.9, 0.0]
    """
    known = np.where(lag[INFORMATION] > 0.0, lag[INFORMATION], np.inf)
    return np.maximum(lag[SCORE] ** 2 - BY_CHANCE**2 * lag[CHANCE], 0.0) / known**2


def behind(lag: Sums, size: float) -> np.ndarray:
    """Parameters whose lag is beyond chance, where innovations have ``size`` times the stated variance."""
    return np.flatnonzero(lag[SCORE] ** 2 > BEYOND_CHANCE**2 * lag[CHANCE] * max(size, 1.0))


def take_as_drift(lag: Sums, k: int, most: float) -> None:
    """Take the lag of a parameter, ``most`` at most, as its drift from now on, and begin its sums anew."""
    speed = min(mean_lag(lag)[k] ** 2, most**2) / max(lag[SECONDS, k], SHORTEST_S)
    lag[DRIFT, k] = max(lag[DRIFT, k], speed)
    lag[:DRIFT, k] = 0.0
