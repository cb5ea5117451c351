"""Refine and reweigh in turn: the residual sets the weights, and the weights the fit."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.levenberg_marquardt import LeastSquaresResult, search
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import residual_of
from middeck.identification.problem.unknowns_layout import Layout, Start
from middeck.identification.search.least_squares_costs import by_normal_equations, logarithmic, weighted
from middeck.identification.search.pole_bounds import bound_theta, bounded
from middeck.identification.spectra.excess_variance import ExcessVariance, excess_share
from middeck.values import record

# The weights have settled when the variance moves by less than this share on average.
SETTLED = 0.02
# A search goes on in chunks of steps, each with new weights, at most so many. It has settled too when a chunk
# gains less than this share of the cost that is not noise: lines share what a model lacks, and a thousandth
# of it determines no unknown.
CHUNK, MOST_CHUNKS = 10, 6
LITTLE = 1e-3
# Or no more than this for each unknown: noise makes a fit of n unknowns cost n/2 too little.
LITTLE_OF_NOISE = 1e-3
# Steps on the first weights, before a residual gives better ones.
FIRST_STEPS = 3


@record(kw_only=True)
class SearchedModel:
    """A model at the end of a search.

    Attributes:
        likelihood: Negative logarithm of the likelihood, up to a constant: sum of log v + |r|^2 / v.
    """

    layout: Layout
    refined: LeastSquaresResult
    likelihood: float

    @functools.cached_property
    def start(self) -> Start:
        """Start of a further refinement."""
        return Start(self.layout, self.refined.theta)

    def residual(self, data: Data) -> Complex[np.ndarray, "output line column"]:
        """H - E, unweighted."""
        return residual_of(self.layout, data, self.refined.theta, self.refined.step.linear)


@record(kw_only=True)
class Polished(SearchedModel):
    """A fit of a response; ``share`` of the response's size is the variance beyond the measured one."""

    share: float


def polish(
    data: Data, start: Start, spread: ExcessVariance, *, steps: int, rounds: int, share: float | None = None
) -> Polished | None:
    """Refine on the weights of a share until that settles; without a share, first on those of ``data``.

    None where the start has no finite response.
    """
    layout = start.layout
    found = _search(layout, data, start.theta, FIRST_STEPS) if share is None else None
    if share is None:
        if found is None:
            return None
        share = excess_share(_left(layout, data, found), spread)
    theta = start.theta if found is None else found.theta
    for _ in range(rounds):
        v = spread.at(share)
        again = data.reweighted(1.0 / np.sqrt(v))
        found = _search(layout, again, theta, steps)
        if found is None:
            return None
        theta, before, share = found.theta, share, excess_share(_left(layout, data, found), spread)
        if abs(share - before) * np.mean(spread.size / v) <= SETTLED:
            break
    return None if found is None else _polished(layout, data, found, spread, share)


def settle(data: Data, start: Polished, spread: ExcessVariance) -> Polished:
    """A polished start, refined until further gains are smaller than noise and model error."""
    best = start
    for _ in range(MOST_CHUNKS):
        found = polish(data, best.start, spread, steps=CHUNK, rounds=1, share=best.share)
        if found is None:
            return best
        before, best = best, found
        history = found.refined.history
        lacking = found.share * np.mean(spread.size / spread.at(found.share))
        settled = abs(found.share - before.share) * np.mean(spread.size / spread.at(found.share)) <= SETTLED
        unknowns = len(found.refined.theta) + found.refined.step.linear.size
        little = history[0] - history[-1] <= LITTLE * lacking * history[-1] + LITTLE_OF_NOISE * unknowns
        if settled and (found.refined.converged or little):
            return dataclasses.replace(found, refined=dataclasses.replace(found.refined, converged=True))
    return best


def _search(
    layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"], steps: int
) -> LeastSquaresResult | None:
    """A search with poles where they may be."""
    by_lines = bounded(layout, data, functools.partial(weighted, layout, data, from_sums=False))
    exactly = by_lines if by_normal_equations(layout, data) else None
    by_sums = bounded(layout, data, functools.partial(weighted, layout, data))
    found = search(by_sums, theta, steps, exactly=exactly)
    return None if found is None else dataclasses.replace(found, theta=bound_theta(layout, data, found.theta))


def _left(layout: Layout, data: Data, found: LeastSquaresResult) -> Complex[np.ndarray, "output line column"]:
    """H - E at the end of a search."""
    r = found.step.residual
    return residual_of(layout, data, found.theta, found.step.linear) if r is None else r


def logarithmic_polish(data: Data, start: Polished, spread: ExcessVariance) -> Polished:
    """`polish` for the logarithmic cost, from a fit by the other cost.

    log H has the variance v / |E|^2. The model E, not H, stands there: where H is noise, its own size says
    nothing, and such lines would rule the fit.
    """
    layout = start.layout
    theta = np.concatenate([start.refined.theta, start.refined.step.linear.ravel()])
    shared = len(start.refined.theta)
    E = data.H - start.residual(data)
    size = np.maximum(np.abs(E) ** 2, np.finfo(float).tiny)
    of_log = ExcessVariance(variance=spread.variance / size, size=np.ones(size.shape))
    again = Data(
        s=data.s, H=data.H, weight=1.0 / np.sqrt(of_log.at(excess_share(np.log(data.H / E), of_log)))
    )
    found = search(bounded(layout, again, lambda x, _: logarithmic(layout, again, x)), theta)
    if found is None:
        return start
    found = dataclasses.replace(found, theta=bound_theta(layout, again, found.theta))
    shorter = LeastSquaresResult(found.theta[:shared], found.step, found.history, found.converged)
    return _polished(layout, data, shorter, spread, start.share)


def _polished(
    layout: Layout, data: Data, found: LeastSquaresResult, spread: ExcessVariance, share: float
) -> Polished:
    r, v = _left(layout, data, found), spread.at(share)
    likelihood = float(np.sum(np.log(v) + np.abs(r) ** 2 / v))
    return Polished(layout=layout, refined=found, share=share, likelihood=likelihood)
