"""The likeliest of several starts on a record."""

from __future__ import annotations

from collections.abc import Iterable

from middeck.identification.fit.data import Data
from middeck.identification.fit.start import Start
from middeck.identification.samples.search import RecordRun, Weighting, refine_record

# Steps for all starts, and for the best few of them.
HEAT, FEW, FEW_STEPS = 3, 3, 10


def leader(data: Data, starts: Iterable[Start], weighting: Weighting) -> RecordRun | None:
    """All starts take a few steps, the best few some more, the likeliest leads; None if none has a model."""
    heats = [refine_record(data, s.layout, s.theta, weighting, rounds=1, steps=HEAT) for s in starts]
    ranked = sorted((run for run in heats if run is not None), key=lambda run: run.likelihood)
    if len(ranked) < 2:
        return ranked[0] if ranked else None
    few = [further(data, run, rounds=2, steps=FEW_STEPS) for run in ranked[:FEW]]
    return min(few, key=lambda run: run.likelihood)


def further(data: Data, run: RecordRun, *, rounds: int, steps: int) -> RecordRun:
    """A run refined further; itself where that fails."""
    theta = run.refined.theta
    return refine_record(data, run.layout, theta, run.weighting, rounds=rounds, steps=steps) or run
