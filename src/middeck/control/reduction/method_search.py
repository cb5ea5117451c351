"""Search over methods for a compensator of lower order that stabilises every plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.reduction.methods import Method, TruncatedLaw, find_candidate, find_start
from middeck.control.reduction.weighted_loop import WeightedLoop, absorb, proper_law
from middeck.control.robust.search.smooth_maximum import improve
from middeck.control.robust.search.starting_laws import stabilises
from middeck.errors import ConfigError, NumericalError
from middeck.systems.poles.stability import decays
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

Best = Literal["best"]
ORDER_OF_TRIAL: tuple[Method, ...] = ("performance", "stability", "coprime", "balanced")
SMALLEST_STEP = 1.0 / 256.0
"""Smallest fraction of the remainder withdrawn in a step; below it the homotopy counts as blocked."""
SHORT_OF_EDGE = 0.75
"""Fraction of a step taken: at the stability limit itself the cost is infinite."""
ON_THE_WAY, AT_THE_END = 25, 200
"""Steps of the descent at each stop, and once the remainder is gone."""
LOOSE, TIDY = 1e-3, 1e-6


@record(kw_only=True)
class Tested:
    """Result of one method: compensator, first truncation, whether it stabilises all plants, description."""

    law: StateSpace
    method: Method
    candidate: TruncatedLaw
    holds: bool
    steps: tuple[str, ...]


def search_law(
    system: StateSpace,
    order: int,
    method: Method | Best,
    loops: Sequence[WeightedLoop],
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
    system: StateSpace,
    order: int,
    method: Method,
    loops: Sequence[WeightedLoop],
    homotopy: bool,
    polish: bool,
) -> Tested:
    candidate = find_candidate(system, order, method, loops)
    law = candidate.law
    holds = bool(np.isfinite(_mean_cost(law, loops)))
    steps = [f"{method}: {'stable' if holds else 'unstable'} as truncated"]
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


def _withdraw(
    system: StateSpace, order: int, candidate: TruncatedLaw, loops: Sequence[WeightedLoop]
) -> Withdrawal:
    start = candidate if decays(candidate.remainder) else find_start(system, order, loops)
    if start is None:
        return Withdrawal(proper_law(candidate.law), 0.0, 0)
    return withdraw_remainder([loop.model for loop in loops], start)


def _with_law(system: StateSpace, law: Law) -> StateSpace:
    return StateSpace(law.A, law.B, law.C, system.D)


def _mean_cost(law: StateSpace, loops: Sequence[WeightedLoop]) -> float:
    return float(np.mean([evaluate_cost(loop.model, proper_law(law)).cost for loop in loops]))


@record
class Withdrawal:
    """Withdrawn fraction of the remainder, the `Law` there, and the number of descents (``stops``)."""

    law: Law
    share: float
    stops: int


def withdraw_remainder(models: Sequence[GeneralizedPlant], candidate: TruncatedLaw) -> Withdrawal:
    """The `Law` of the candidate's order at the end of a stability homotopy, or where it was blocked.

    K(a) = K_r + (1 - a) R with the remainder R = K - K_r of the first cut: at a = 0 it is K, at a = 1 it is
    K_r. On the way K_r descends the H2 cost of the loops, which grows without bound at the stability limit,
    so that the remainder can be withdrawn further.
    """
    law, share, stops = proper_law(candidate.law), 0.0, 0

    def at(a: float) -> Sequence[GeneralizedPlant]:
        return models if a == 1.0 else [absorb(m, _times(candidate.remainder, 1.0 - a)) for m in models]

    if not decays(candidate.remainder) or not stabilises(at(0.0), law):
        return Withdrawal(law, 0.0, 0)
    while share < 1.0:
        step = 1.0 - share
        while not stabilises(at(share + step), law):
            step /= 2.0
            if step < SMALLEST_STEP:
                return Withdrawal(law, share, stops)
        share = 1.0 if share + step >= 1.0 else share + SHORT_OF_EDGE * step
        if share < 1.0:
            found = improve(law, at(share), [], power=1.0, tolerance=LOOSE, steps=ON_THE_WAY)
            law = law if found is None else found[0]
            stops += 1
    law = polish_law(models, law) or law
    return Withdrawal(law, share, stops)


def polish_law(models: Sequence[GeneralizedPlant], law: Law) -> Law | None:
    """The `Law` at the end of a descent of the mean cost; None where it does not stabilise all models."""
    found = improve(law, models, [], power=1.0, tolerance=TIDY, steps=AT_THE_END)
    return None if found is None else found[0]


def _times(system: StateSpace, factor: float) -> StateSpace:
    return StateSpace(system.A, system.B, factor * system.C, factor * system.D)
