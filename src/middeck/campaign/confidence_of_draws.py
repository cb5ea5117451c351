"""Statements from random draws: a bound on one more draw, a probability and its interval, draws needed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv

CONFIDENCE = 0.95
TIE = 1e-9  # rounding of a rank


def level(db: Float[np.ndarray, " draw"], share: float) -> float:
    """Tolerance bound: the drawn value that one more draw does not exceed with probability ``share``.

    The k-th of n values is not exceeded by another draw with probability k / (n + 1) (Wilks 1941, Ann. Math.
    Stat. 12); where n is too small for ``share``, the largest (smallest) value. Never interpolated: a value
    may be infinite.
    """
    n = len(db)
    k = share * (n + 1)
    k = int(np.ceil(k - TIE) if share >= 0.5 else np.floor(k + TIE))
    return float(np.sort(db)[min(max(k, 1), n) - 1])


def probability_interval(count: int, of: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Interval of a probability after ``count`` successes in ``of`` trials (Clopper and Pearson 1934).

    >>> [round(p, 4) for p in probability_interval(299, 299, 0.9)]
    [0.99, 1.0]
    """
    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(count, of - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, of - count, 1.0 - tail)) if count < of else 1.0
    return low, high


def draws_needed(probability: float) -> int:
    """Number of draws, all stable, that shows ``probability`` of stability with 95 % confidence (Wilks 1941).

    >>> draws_needed(0.99)
    299
    """
    return int(np.ceil(np.log(1.0 - CONFIDENCE) / np.log(probability)))
