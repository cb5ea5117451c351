"""Several loops that share one unbounded gain, where rounding hides their difference.

Beside a free body's poles each loop is unbounded, while its return ratio with the other loops closed
and the sensitivity of all are finite: differences of numbers that grow as 1/s^2. There they follow from the
state space of the closed loop, which holds no such difference.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.control.analysis.loop.feedback_loop import (
    At,
    FeedbackLoop,
    approximate_halves,
    channels_at,
    close_channels,
    open_channel,
    resolve,
)
from middeck.systems.poles.resolvent import Resolvent
from middeck.systems.state_space.statespace import LinearSystem

TRUSTED = 1e-8
"""Largest error from rounding, relative to one or to the value."""
SHORT = 1.0
"""Largest angle [rad] that a delay turns at which its approximation is exact to rounding."""


def spread_rounding(
    P: Complex[np.ndarray, "line channel channel"], S: Complex[np.ndarray, "line channel channel"]
) -> Float[np.ndarray, "line channel channel"]:
    """Error of each entry of S = (1 - P)^-1 from an error of eps |P| in each entry of P."""
    return np.finfo(float).eps * (np.abs(S) @ np.abs(P) @ np.abs(S))


def is_short(loop: FeedbackLoop, s: Complex[np.ndarray, " line"]) -> Bool[np.ndarray, " line"]:
    """Whether `approximate_halves` is exact to rounding, line by line: everywhere for a sampled loop."""
    longest = float(loop.plant.delay_s.max(initial=0.0)) if loop.period_s is None else 0.0
    return np.abs(s) * longest < SHORT


def closed_ratio(loop: FeedbackLoop, at: At) -> Callable[[np.ndarray], np.ndarray]:
    """Minus the transfer of each channel around the loop, the others closed; prepared when first asked."""

    @functools.cache
    def channels() -> list[Resolvent]:
        halves = approximate_halves(loop)
        return [_over_s(loop, open_channel(halves, i)) for i in channels_at(loop, at)]

    return lambda s: np.concatenate([-one(s)[:, :, 0] for one in channels()], axis=1)


def closed_round(loop: FeedbackLoop, at: At) -> Callable[[np.ndarray], np.ndarray]:
    """S - 1 of all channels closed, S = (1 - P)^-1, prepared when first asked."""

    @functools.cache
    def closed() -> Resolvent:
        channels = channels_at(loop, at)
        return _over_s(loop, close_channels(approximate_halves(loop)).select(channels, channels))

    return lambda s: closed()(s)


def _over_s(loop: FeedbackLoop, system: LinearSystem) -> Resolvent:
    period, response = loop.period_s, resolve(system)
    return response if period is None else lambda s: response(np.exp(s * period))
