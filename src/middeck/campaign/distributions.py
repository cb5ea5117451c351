"""Distributions of parameters, each as a function of a standard normal number."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, logsumexp, ndtr, ndtri_exp

from middeck.errors import ConfigError
from middeck.values import record


@record
class Uniform:
    """Equally likely between ``low`` and ``high``."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _require(math.isfinite(self.high - self.low) and self.low < self.high, self, "low < high, finite")


@record
class Normal:
    """Normal of mean and standard deviation."""

    mean: float
    std: float

    def __post_init__(self) -> None:
        _require(math.isfinite(self.mean) and 0.0 < self.std < math.inf, self, "std > 0, finite")


@record
class TruncatedNormal:
    """A normal of ``mean`` and ``std`` before truncation, given that it lies between ``low`` and ``high``."""

    mean: float
    std: float
    low: float
    high: float

    def __post_init__(self) -> None:
        _require(math.isfinite(self.mean) and 0.0 < self.std < math.inf, self, "std > 0, finite")
        _require(self.low < self.high, self, "low < high")


@record
class LogNormal:
    """exp of a normal: ``median``, and standard deviation ``spread`` of the natural logarithm."""

    median: float
    spread: float

    def __post_init__(self) -> None:
        fits = 0.0 < self.median < math.inf and 0.0 < self.spread < math.inf
        _require(fits, self, "median > 0 and spread > 0, finite")


Distribution = Uniform | Normal | TruncatedNormal | LogNormal


def from_normal(distribution: Distribution, z: Float[np.ndarray, " case"]) -> Float[np.ndarray, " case"]:
    """The distribution's quantiles at the probabilities of the standard normal numbers ``z``.

    >>> float(from_normal(LogNormal(2.0, 0.1), np.array([0.0]))[0])
    2.0
    """
    match distribution:
        case Uniform(low=low, high=high):
            return low + (high - low) * ndtr(z)
        case Normal(mean=mean, std=std):
            return mean + std * z
        case LogNormal(median=median, spread=spread):
            return median * np.exp(spread * z)
        case TruncatedNormal(mean=mean, std=std, low=low, high=high):
            return _truncated(distribution, z)


def _truncated(d: TruncatedNormal, z: np.ndarray) -> np.ndarray:
    """Truncated normal numbers by logarithms of probabilities: both far tails keep their digits."""
    ends = (d.low - d.mean) / d.std, (d.high - d.mean) / d.std
    sign = 1.0 if ends[0] + ends[1] <= 0.0 else -1.0
    low, high = sorted(sign * e for e in ends)
    shares = np.stack([log_ndtr(-sign * z) + log_ndtr(low), log_ndtr(sign * z) + log_ndtr(high)])
    # log_ndtr(-inf) is -inf: a side without an end.
    found = ndtri_exp(np.minimum(np.asarray(logsumexp(shares, axis=0)), 0.0))
    return np.clip(d.mean + sign * d.std * found, d.low, d.high)


def _require(fits: bool, distribution: Distribution, allowed: str) -> None:
    if not fits:
        raise ConfigError(f"{distribution!r} is no distribution", hint=allowed)
