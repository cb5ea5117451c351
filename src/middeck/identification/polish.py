"""Refine and weigh in turn: the fit tells what it cannot follow, and the weights follow the fit."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.refine import Data, Refined, logarithmic, residual_of, search, weighted
from middeck.identification.start import Start
from middeck.identification.terms import Layout
from middeck.identification.weights import excess_variance
from middeck.values import record

# The weights have settled when the excess moves by less than this share of the variance it is added to.
SETTLED = 0.02


@record
class Polished:
    """A start refined, with what its last weights were made of.

    Parameters
    ----------
    excess:
        Variance of each output beyond the measured one.
    gram:
        Normal equations of theta at the end, the linear unknowns projected out.
    likelihood:
        Negative logarithm of the likelihood, up to a constant: sum of log v + |r|^2 / v.
    """

    layout: Layout
    refined: Refined
    excess: Float[np.ndarray, " output"]
    gram: Float[np.ndarray, "unknown unknown"]
    likelihood: float


def polish(
    data: Data, start: Start, variance: Float[np.ndarray, "output line input"], *, steps: int, rounds: int
) -> Polished | None:
    """Refine on the weights of ``data``, then on ``variance`` plus excess until that settles.

    None where the start has no finite response.
    """
    layout = start.layout
    found = search(lambda theta: weighted(layout, data, theta), start.theta, most_steps=3)
    excess = np.full(len(data.H), np.inf)
    for _ in range(rounds):
        if found is None:
            return None
        r = residual_of(layout, data, found.theta, found.step.linear)
        before, excess = excess, excess_variance(data.H, r, variance)
        v = variance + excess[:, None, None]
        again = Data(data.s, data.H, 1.0 / np.sqrt(v))
        found = search(
            lambda theta, again=again: weighted(layout, again, theta), found.theta, most_steps=steps
        )
        if np.all(np.abs(excess - before) <= SETTLED * v.mean(axis=(1, 2))):
            break
    return None if found is None else _polished(layout, data, found, variance, excess, found.step.gram)


def logarithmic_polish(data: Data, start: Polished, variance: np.ndarray) -> Polished:
    """The same for the logarithmic cost, from a fit of the other.

    log H has the variance v / |E|^2. The model E, not H, stands there: where H is noise, its own size says
    nothing, and such lines would rule the fit.
    """
    layout = start.layout
    theta = np.concatenate([start.refined.theta, start.refined.step.linear.ravel()])
    shared = len(start.refined.theta)
    E = data.H - residual_of(layout, data, theta[:shared], start.refined.step.linear)
    size = np.maximum(np.abs(E) ** 2, np.finfo(float).tiny)
    excess = excess_variance(np.ones_like(E), np.log(data.H / E), variance / size)
    again = Data(data.s, data.H, 1.0 / np.sqrt(variance / size + excess[:, None, None]))
    found = search(lambda x: logarithmic(layout, again, x), theta)
    if found is None:
        return start
    gram = found.step.gram
    linear = gram[shared:, shared:]
    projected = (
        gram[:shared, :shared] - gram[:shared, shared:] @ np.linalg.pinv(linear) @ gram[shared:, :shared]
    )
    shorter = Refined(found.theta[:shared], found.step, found.history, found.converged)
    return _polished(layout, data, shorter, variance, start.excess, projected)


def _polished(
    layout: Layout, data: Data, found: Refined, variance: np.ndarray, excess: np.ndarray, gram: np.ndarray
) -> Polished:
    r = residual_of(layout, data, found.theta, found.step.linear)
    v = variance + excess[:, None, None]
    return Polished(layout, found, excess, gram, float(np.sum(np.log(v) + np.abs(r) ** 2 / v)))
