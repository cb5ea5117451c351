"""The likeliest of several starts on a record, by successive halving (Jamieson and Talwalkar 2016)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from middeck.identification.problem.data import Data
from middeck.identification.record_fit.search import RecordRun, Weighting, further, refine_record
from middeck.identification.start.start import Start

# Steps of all starts, and of those that stay: twice as many each time, the noise estimated anew within.
HEAT, ROUNDS = 3, 2


def leader(data: Data, starts: Iterable[Start], weighting: Weighting) -> RecordRun | None:
    """All starts take a few steps, the better half twice as many, and so on; None if none has a model."""
    heats = [refine_record(data, s.layout, s.theta, weighting, rounds=1, steps=HEAT) for s in starts]
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
    """Whether the data tell two models apart by less than one deviation."""
    a, b = run.layout, other.layout
    if not (np.array_equal(a.pair, b.pair) and np.array_equal(a.pivot, b.pivot)):
        return False
    if not np.array_equal(a.fixed_imag, b.fixed_imag):
        return False
    away = run.refined.theta - other.refined.theta
    return float(away @ other.refined.step.gram @ away) < 1.0
