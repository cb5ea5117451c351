"""When a tracker has lost its modes, and from where it begins again.

A filter that follows a wrong frequency is sure of it: its covariance is small, and corrections that are right
come too late. Its innovations tell: large, and not white as they would be if only the noise had grown. If
that lasts, parameters are set back to those of the last time when all was well and the motion to not known.
Frequencies are then opened by a jump, and by twice and four times that where the try before found nothing:
a wide opening finds a mode from farther off, and more often its neighbour.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.identification.tracking.trust import WATCHED
from middeck.values import record

# Memory [samples] of the products that it is judged by: a fourth of that of `trusted`, to see a try succeed.
BRIEF = 256
# Mean square of innovations, and sum of their squared correlations over 16 lags, beyond which the modes are
# lost. Chance has 1 +- 0.06 and 0.03 +- 0.01; a sine among noise as large as itself has 2 and 2.
TOO_LARGE, TOO_COLOURED = 1.5, 0.5
# How long [s] it is to last, and how far apart good states are kept, so that the older one is of before.
PATIENCE_S = 6.0
# Openings that are tried one after the other, in jumps.
OPENINGS = (1.0, 2.0, 4.0)


@record
class Restart:
    """A restart of a tracker that had lost its modes.

    Parameters
    ----------
    time_s:
        When [s].
    good_s:
        Of the state whose parameters it took up again.
    opening:
        Relative deviation by which its frequencies were opened.
    """

    time_s: float
    good_s: float
    opening: float


@record
class Recovery:
    """What is kept to begin again from.

    Parameters
    ----------
    products, weight:
        As of the tracker, with a brief memory.
    lost:
        Samples for which the modes were lost, less those since.
    tries:
        Restarts since all was well.
    mean, variance, taken:
        Parameters of two good states, the older one first, and the samples after which each was taken.
    loudness:
        Mean square of late inputs: by it motion is judged that is not known.
    restarts:
        All of them.
    """

    products: Float[np.ndarray, " lag"]
    weight: float
    lost: int
    tries: int
    mean: Float[np.ndarray, "age parameter"]
    variance: Float[np.ndarray, "age parameter"]
    taken: Int[np.ndarray, " age"]
    loudness: Float[np.ndarray, " input"]
    restarts: tuple[Restart, ...]


def first_recovery(
    mean: Float[np.ndarray, " parameter"],
    variance: Float[np.ndarray, " parameter"],
    loudness: Float[np.ndarray, " input"],
) -> Recovery:
    """Before the first sample: the start is the good state."""
    twice = np.tile(mean, (2, 1)), np.tile(variance, (2, 1))
    return Recovery(np.zeros(WATCHED + 1), 0.0, 0, 0, *twice, np.zeros(2, dtype=int), loudness, ())


def is_lost(products: Float[np.ndarray, " lag"], weight: float) -> bool:
    """Whether late innovations are too large and too coloured.

    >>> noise = np.zeros(WATCHED + 1)
    >>> noise[0] = 9.0                                       # three times as large as stated, but white
    >>> is_lost(noise, 1.0), is_lost(2.0 * np.cos(0.2 * np.arange(WATCHED + 1)), 1.0)
    (False, True)
    """
    if weight < 0.5:
        return False
    size = products[0] / weight
    return bool(size > TOO_LARGE and np.sum((products[1:] / products[0]) ** 2) > TOO_COLOURED)


def opening(tries: int) -> float:
    """In jumps, after so many tries."""
    return OPENINGS[tries % len(OPENINGS)]


def patience(tries: int) -> float:
    """Time [s] before the next restart, longer with each round: what never works is tried less often."""
    return PATIENCE_S * (1 + tries // len(OPENINGS))
