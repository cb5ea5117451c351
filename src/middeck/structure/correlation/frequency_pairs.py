"""Pairs of measured frequencies and modes of the model, without shapes.

Errors of ln f are taken as Gaussian, all of one deviation, the likeliest of `SCATTER`. A measured mode has no
partner once in ten times, and then lies anywhere within an octave either way. The likeliest pairs follow: the
cost of a pair is convex in its distance, so that they rise together (no two cross), and none is farther apart
than a limit: 13 % where 4 % is the likeliest deviation, 53 % at most.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

SCATTER = (0.04, 0.08, 0.16)
# Minus the logarithm of the likelihood of a measured mode alone, over that of a pair as `pair_costs` has it.
ALONE = float(np.log(10.0 * 2.0 * np.log(2.0) / np.sqrt(2.0 * np.pi)))
# Difference of ln f below which frequencies are equal to rounding.
SAME = 1e-6


def pair_costs(
    ours: Float[np.ndarray, "mode measured"], theirs: Float[np.ndarray, " measured"], scatter: float
) -> Float[np.ndarray, "mode measured"]:
    """Minus the logarithm of the likelihood of every pair, from logarithms of frequencies."""
    return 0.5 * ((ours - theirs) / scatter) ** 2 + np.log(scatter)


def pair_frequencies(
    ours_hz: Float[np.ndarray, "mode measured"], theirs_hz: Float[np.ndarray, " measured"]
) -> Int[np.ndarray, "pair 2"]:
    """(mode, measured mode), one to one, in the order of the measured ones.

    A column has the frequencies of the modes as the measured one would find them; columns may differ.
    """
    # The lower one of two modes equally near counts, and modes of one frequency are in their order.
    ours, theirs = _spaced(ours_hz), _spaced(theirs_hz) - SAME
    least, pairs = np.inf, np.zeros((0, 2), dtype=int)
    for scatter in SCATTER:
        cost = np.minimum(pair_costs(ours, theirs, scatter), ALONE)
        i, j = linear_sum_assignment(cost)
        gain = cost[i, j] - ALONE
        if (total := float(gain.sum())) < least:
            least, pairs = total, np.stack([i, j], axis=1)[gain < 0.0]
    return pairs[np.argsort(pairs[:, 1], kind="stable")]


def _spaced(hz: np.ndarray) -> np.ndarray:
    """Logarithms of frequencies along the first axis, neighbours at least `SAME` apart."""
    log_hz = np.log(np.maximum(hz, np.finfo(float).tiny))
    order = np.argsort(np.round(log_hz / SAME), axis=0, kind="stable")
    step = SAME * np.arange(len(hz)).reshape(-1, *[1] * (hz.ndim - 1))
    spaced = np.maximum.accumulate(np.take_along_axis(log_hz, order, axis=0) - step, axis=0) + step
    return np.take_along_axis(spaced, np.argsort(order, axis=0), axis=0)


def nearest_two(ours_hz: Float[np.ndarray, " mode"], theirs_hz: Float[np.ndarray, " measured"]) -> str:
    """In words, the measured frequency and the one of the model that are nearest to each other."""
    moving = ours_hz[ours_hz > 0.0]
    if not len(moving):
        return "the model has rigid modes alone"
    apart = np.abs(np.log(moving[:, None] / theirs_hz))
    i, j = np.unravel_index(np.argmin(apart), apart.shape)
    return f"the nearest two are {theirs_hz[j]:.4g} Hz, measured, and {moving[i]:.4g} Hz"
