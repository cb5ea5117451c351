"""The likeliest of several starts on a record, by successive halving (Jamieson and Talwalkar 2016)."""

from __future__ import annotations

from collections.abc import Iterable

from middeck.identification.fit.data import Data
from middeck.identification.fit.start import Start
from middeck.identification.samples.search import RecordRun, Weighting, refine_record

# Steps of all starts, and of those that stay: twice as many each time, the noise estimated anew within.
HEAT, ROUNDS = 3, 2


def leader(data: Data, starts: Iterable[Start], weighting: Weighting) -> RecordRun | None:
    """All starts take a few steps, the better half twice as many, and so on; None if none has a model."""
    heats = [refine_record(data, s.layout, s.theta, weighting, rounds=1, steps=HEAT) for s in starts]
    runs, steps = [run for run in heats if run is not None], HEAT
    while len(runs) > 1:
        better = sorted(runs, key=lambda run: run.likelihood)[: len(runs) // 2]
        runs = [further(data, run, rounds=ROUNDS, steps=steps) for run in better]
        steps *= 2
    return runs[0] if runs else None


def further(data: Data, run: RecordRun, *, rounds: int, steps: int) -> RecordRun:
    """A run refined further; itself where that fails."""
    theta = run.refined.theta
    return refine_record(data, run.layout, theta, run.weighting, rounds=rounds, steps=steps) or run
