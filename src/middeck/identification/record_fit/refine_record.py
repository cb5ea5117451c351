"""Refine a model on a record and estimate its noise in turn, with poles that stay where a record can see."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.levenberg_marquardt import Step, search
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import residual_of
from middeck.identification.problem.unknowns_layout import Layout, Start
from middeck.identification.record_fit.sensor_or_force_noise import (
    Noise,
    denominator,
    lines_alike,
    negative_log_likelihood,
    noise_variance,
)
from middeck.identification.search.least_squares_costs import least_cost, weighted
from middeck.identification.search.refine_and_reweigh import SearchedModel
from middeck.values import record

# "flat": one variance for each output, of driven and of silent lines, so that the least is the error of the
# simulation itself.
Weighting = Literal["flat"] | Noise
WEIGHTINGS: tuple[Weighting, ...] = ("output", "motion", "flat")
# A decay rate times the record's length below which free motion is no different from a ramp, of a pair from a
# steady sine whatever the noise; and times the sampling period above which it is over within a sample.
SLOWEST, LIGHTEST, FASTEST = 0.1, 1e-3, 15.0
# Decays over the record below which a sampled model has at most one real pole: several make ramps and
# parabolas, which fit any drift and no other record.
SLOW_REAL = 10.0
# Steps of all starts, and of those that stay: twice as many each time, the noise estimated anew within.
HEAT, ROUNDS = 3, 2


@record(kw_only=True)
class RecordRun(SearchedModel):
    """A model refined on a record; its ``variance`` is, by the weighting, from its residual."""

    weighting: Weighting
    variance: Float[np.ndarray, "output line column"]

    def denominator(self, data: Data) -> Float[np.ndarray, " line"]:
        """|A|^2 of its poles."""
        return _denominator(data, self.start)


def refine_record(
    data: Data, start: Start, weighting: Weighting, *, rounds: int, steps: int
) -> RecordRun | None:
    """Search and estimate the noise in turn; None for no finite model, or one of several slow real poles."""
    layout = start.layout
    theta = np.clip(start.theta, *_bounds(layout, data))
    first = least_cost(layout, data, theta)
    if first is None:
        return None
    r = residual_of(layout, data, theta, first[1])
    v = _variance_of(r, data, layout, theta, weighting)
    return _refined(data, Start(layout, theta), weighting, v, rounds, steps)


def further(data: Data, run: RecordRun, *, rounds: int, steps: int) -> RecordRun:
    """A run refined further on the data that it was refined on; itself where that fails."""
    return _refined(data, run.start, run.weighting, run.variance, rounds, steps) or run


def _refined(
    data: Data, start: Start, weighting: Weighting, v: np.ndarray, rounds: int, steps: int
) -> RecordRun | None:
    """The run refined from weights of the variance ``v``, in one round or more."""
    layout, theta, bounds = start.layout, start.theta, _bounds(start.layout, data)
    found, likelihood = None, np.inf
    for _ in range(rounds):
        again = data.reweighted(1.0 / np.sqrt(v))
        evaluate = _bounded(functools.partial(weighted, layout, again), *bounds)
        better = search(evaluate, theta, steps)
        if better is None or not np.isfinite(better.step.cost):
            return None
        theta = np.clip(better.theta, *bounds)
        found = dataclasses.replace(better, theta=theta)
        r = residual_of(layout, data, theta, found.step.linear)
        v = _variance_of(r, data, layout, theta, weighting)
        likelihood = negative_log_likelihood(r, v)
    decays = np.exp(theta[layout.pairs : len(layout.pair)]) * data.length_s
    if found is None or (layout.options.period_s > 0.0 and int(np.sum(decays < SLOW_REAL)) > 1):
        return None
    return RecordRun(layout=layout, refined=found, weighting=weighting, variance=v, likelihood=likelihood)


def _variance_of(
    r: Complex[np.ndarray, "output line column"],
    data: Data,
    layout: Layout,
    theta: np.ndarray,
    weighting: Weighting,
) -> Float[np.ndarray, "output line column"]:
    """Variance of each output on each line from a model's residual."""
    if weighting == "flat":
        v = np.empty(r.shape)
        for at in lines_alike(data.driven, r.shape[1]):
            v[:, at] = np.mean(np.abs(r[:, at]) ** 2, axis=(1, 2), keepdims=True) + np.finfo(float).tiny
        return v
    shape = _denominator(data, Start(layout, theta)) if weighting == "motion" else None
    return noise_variance(r, shape, driven=data.driven)


def _denominator(data: Data, start: Start) -> Float[np.ndarray, " line"]:
    p = start.point.poles
    return denominator(data.s, np.concatenate([p, p[start.layout.pair].conj()]), data.period_s)


def _bounds(layout: Layout, data: Data) -> tuple[np.ndarray, np.ndarray]:
    period, length = data.period_s, data.length_s
    low, high = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    modes, pairs = len(layout.pair), layout.pairs
    low[: modes + pairs] = np.log(SLOWEST / length)
    low[:pairs] = np.log(LIGHTEST / length)
    high[:modes] = np.log(FASTEST / period)
    high[modes : modes + pairs] = np.log(0.999 * np.pi / period)
    return low, high


def _bounded(
    evaluate: Callable[[np.ndarray, float], Step | None], low: np.ndarray, high: np.ndarray
) -> Callable[[np.ndarray, float], Step | None]:
    """The cost on the box; an unknown that is held by its bound is no direction of the search."""

    def at(theta: np.ndarray, below: float) -> Step | None:
        step = evaluate(np.clip(theta, low, high), below)
        if step is None or not (np.isfinite(step.gram).all() and np.isfinite(step.gradient).all()):
            return None
        held = ((theta <= low) & (step.gradient > 0.0)) | ((theta >= high) & (step.gradient < 0.0))
        gram = np.where(held[:, None] | held, 0.0, step.gram) + np.diag(held * 1.0)
        return dataclasses.replace(step, gradient=np.where(held, 0.0, step.gradient), gram=gram)

    return at


def leader(data: Data, starts: Iterable[Start], weighting: Weighting) -> RecordRun | None:
    """All starts take a few steps, the better half twice as many, and so on; None if none has a model."""
    heats = [refine_record(data, s, weighting, rounds=1, steps=HEAT) for s in starts]
    runs, steps = [run for run in heats if run is not None], HEAT
    left = len(runs)
    while left > 1:
        left //= 2
        runs = [further(data, run, rounds=ROUNDS, steps=steps) for run in _apart(runs)[:left]]
        steps *= 2
    return min(runs, key=lambda run: run.likelihood, default=None)


def _apart(runs: Iterable[RecordRun]) -> list[RecordRun]:
    """The likeliest first, without those that have come to where a likelier one is already."""
    found: list[RecordRun] = []
    for run in sorted(runs, key=lambda run: run.likelihood):
        if not any(_meet(run, other) for other in found):
            found.append(run)
    return found


def _meet(run: RecordRun, other: RecordRun) -> bool:
    """Whether the data distinguish two models by less than one deviation."""
    a, b = run.layout, other.layout
    if not (np.array_equal(a.pair, b.pair) and np.array_equal(a.pivot, b.pivot)):
        return False
    if not np.array_equal(a.fixed_imag, b.fixed_imag):
        return False
    away = run.refined.theta - other.refined.theta
    return float(away @ other.refined.step.gram @ away) < 1.0
