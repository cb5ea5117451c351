"""Search over methods for a law of lower order that stabilises every plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.reduction.homotopy import Withdrawal, polish_law, withdraw_remainder
from middeck.control.reduction.methods import Method, TruncatedLaw, find_candidate, find_start
from middeck.control.reduction.weighted_loop import Loop, proper_law
from middeck.errors import ConfigError, NumericalError
from middeck.systems.poles.stability import decays
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

Best = Literal["best"]
ORDER_OF_TRIAL: tuple[Method, ...] = ("performance", "stability", "coprime", "balanced")


@record(kw_only=True)
class Tested:
    """Result of one method: law, first truncation, whether it stabilises all plants, description."""

    law: StateSpace
    method: Method
    candidate: TruncatedLaw
    holds: bool
    steps: tuple[str, ...]


def search_law(
    system: StateSpace,
    order: int,
    method: Method | Best,
    loops: Sequence[Loop],
    *,
    homotopy: bool,
    polish: bool,
) -> Tested:
    """Result of the first method that stabilises, or of the one of least cost; of the first if none does."""
    asked: Method = "performance" if method == "best" else method
    trials = [_try(system, order, asked, loops, homotopy, polish)]
    steps: list[str] = []
    for way in ORDER_OF_TRIAL:
        if way == asked or (method != "best" and (trials[-1].holds or not homotopy)):
            continue
        try:
            trials.append(_try(system, order, way, loops, homotopy, polish))
        except (ConfigError, NumericalError) as error:
            # Another method may succeed, e.g. where this one keeps more unstable poles than ``order``.
            steps.append(f"{way}: {error.what}")
    chosen = trials[0]
    if any(trial.holds for trial in trials):
        chosen = min(trials, key=lambda trial: _mean_cost(trial.law, loops))
    done = (step for trial in trials for step in trial.steps)
    return dataclasses.replace(chosen, steps=(*done, *steps))


def _try(
    system: StateSpace, order: int, method: Method, loops: Sequence[Loop], homotopy: bool, polish: bool
) -> Tested:
    candidate = find_candidate(system, order, method, loops)
    law = candidate.law
    holds = bool(np.isfinite(_mean_cost(law, loops)))
    steps = [f"{method}: {'stable' if holds else 'unstable'} as cut"]
    if not holds and homotopy:
        end = _withdraw(system, order, candidate, loops)
        holds = end.share == 1.0
        law = _with_law(law, end.law) if holds else law
        steps.append(f"{method}: {_words(end)}")
    elif holds and polish:
        found = polish_law([loop.model for loop in loops], proper_law(law))
        law = law if found is None else _with_law(law, found)
        steps.append(f"{method}: the cost descended")
    return Tested(law=law, method=method, candidate=candidate, holds=holds, steps=tuple(steps))


def _words(end: Withdrawal) -> str:
    if end.share < 1.0:
        return f"homotopy blocked with {end.share:.3g} of the remainder withdrawn"
    return f"remainder withdrawn by a homotopy of {end.stops} stops, then the cost descended"


def _withdraw(system: StateSpace, order: int, candidate: TruncatedLaw, loops: Sequence[Loop]) -> Withdrawal:
    start = candidate if decays(candidate.remainder) else find_start(system, order, loops)
    if start is None:
        return Withdrawal(proper_law(candidate.law), 0.0, 0)
    return withdraw_remainder([loop.model for loop in loops], start)


def _with_law(system: StateSpace, law: Law) -> StateSpace:
    return StateSpace(law.A, law.B, law.C, system.D)


def _mean_cost(law: StateSpace, loops: Sequence[Loop]) -> float:
    return float(np.mean([evaluate_cost(loop.model, proper_law(law)).cost for loop in loops]))
