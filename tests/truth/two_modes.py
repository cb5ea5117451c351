"""Two modes, a delay and noise of stated size: small enough to fit hundreds of times."""

import functools

import gimbal_record
import numpy as np

from middeck.identification.fit.fit_response import fit_response
from middeck.systems.plants.response import FrequencyResponse

HZ, ZETA, CONSTANTS, DELAY_S = np.array([1.2, 1.7]), 0.01, np.array([1.0, 0.8]), 0.010
LINES = 0.9 + 0.02 * np.arange(60)
NOISE = 2e-3
# In the order of `in_order`.
TRUTH = np.array([*HZ, ZETA, ZETA, *CONSTANTS, DELAY_S])


def response(f):
    s = 2j * np.pi * np.asarray(f)
    w = 2.0 * np.pi * HZ[:, None]
    return np.exp(-DELAY_S * s) * np.sum(CONSTANTS[:, None] / (s**2 + 2 * ZETA * w * s + w**2), axis=0)


def circular(rng, shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)


def measure(rng, *, periods=3, noise=NOISE):
    """Mean of periods and its variance from their scatter; without one for a single period."""
    each = response(LINES) + noise * np.sqrt(periods) * circular(rng, (periods, len(LINES)))
    mean = each.mean(axis=0)
    variance = np.sum(np.abs(each - mean) ** 2, axis=0) / (max(periods - 1, 1) * periods)
    return as_response(mean, variance if periods > 1 else None)


def as_response(H, variance):
    variance = None if variance is None else np.asarray(variance)[:, None, None]
    ports = gimbal_record.INPUTS[:1], gimbal_record.OUTPUTS[:1]
    return FrequencyResponse(
        frequency_hz=LINES, H=H[:, None, None], inputs=ports[0], outputs=ports[1], variance=variance
    )


@functools.cache
def _drawn(periods):
    return np.random.default_rng(periods), []


def fits(draws, periods):
    """The first ``draws`` of one sequence, each fitted once."""
    rng, found = _drawn(periods)
    while len(found) < draws:
        found.append(fit_response(measure(rng, periods=periods), states=4))
    return found[:draws]


def in_order(parameters):
    """Positions of frequencies, damping, constants of rising modes, and of the delay."""
    order = np.argsort(parameters.values[:2])
    return np.concatenate([order, 2 + order, 4 + order, [6]])
