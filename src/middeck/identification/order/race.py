"""The likeliest of several starts for one order, and the order that a response asks for."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from middeck.errors import DataError, FitError
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order import order
from middeck.identification.order.exchange import exchanges, grown, shrunk
from middeck.identification.order.thinning import take_lines, thin_lines
from middeck.identification.problem.data import Data
from middeck.identification.problem.layout import Start
from middeck.identification.search.polish import Polished, polish
from middeck.identification.search.refine import weighted
from middeck.identification.spectra.weights import Spread
from middeck.identification.start.start import few_starts, starts
from middeck.systems.plants.response import FrequencyResponse

# Steps of all starts, of the best few of them, of the best, and of modes exchanged.
HEAT, FEW, FEW_STEPS, LAST_STEPS, EXCHANGE_STEPS = 0, 2, 6, 12, 4
# A start that costs so many times the best, before any step, is not refined at all.
HOPELESS = 3.0
# Exchanges are tried at any rate when more than this share of the variance is not the measured one, and one
# counts when it gains more likelihood than rounding and an unsettled search may.
WORTH_EXCHANGE = 0.1
EXCHANGE_GAIN = 1.0
# An order is given up to so many turns of a few steps before it is compared.
MOST_TURNS = 6
# Steps on half of the lines, from the model on all of them.
HELD_OUT_STEPS = 3
# A fit that misses more of the lines kept out than this share and their noise lacks a mode that can be found.
LACKING = 0.2


def race(data: Data, spread: Spread, options: FitOptions) -> Polished:
    """The likeliest of the starts, refined on some of the lines, then its exchanges.

    Successive halving: all starts take a few steps, the best of them a few more, and the best of those goes
    on. A start in the wrong valley is far behind after a few steps.
    """
    part, some = _some_lines(data, spread, options)
    best = _heats(part, some, [(start, None) for start in _hopeful(part, list(starts(part, options)))])
    if best is None:
        raise FitError(
            f"no start for {options.moving} states could be refined",
            hint="fewer states, a wider band or a longer period",
        )
    best = _further(part, some, best, LAST_STEPS)
    followed = spread_to_follow(best, some)
    if followed is not some:
        best = _further(part, followed, best, FEW_STEPS)
    return _exchange(part, followed, options, best)


def spread_to_follow(best: Polished, spread: Spread) -> Spread:
    """The spread itself for a model that explains its data, the even one for a model that leaves more."""
    return spread.even if model_error(best, spread) > WORTH_EXCHANGE else spread


def _hopeful(part: Data, started: list[Start]) -> list[Start]:
    """The starts that are worth a few steps."""
    steps = [weighted(start.layout, part, start.theta) for start in started]
    costs = [np.inf if step is None else step.cost for step in steps]
    return [start for start, cost in zip(started, costs, strict=True) if cost <= HOPELESS * min(costs)]


def _heats(part: Data, spread: Spread, started: list[tuple[Start, float | None]]) -> Polished | None:
    """The likeliest of several starts (each with the share of its weights, if known) after a few steps."""
    runs = [polish(part, start, spread, steps=HEAT, rounds=1, share=share) for start, share in started]
    ranked = sorted((run for run in runs if run is not None), key=_negative_likelihood)
    few = [_further(part, spread, run, FEW_STEPS) for run in ranked[:FEW]]
    return min(few, key=_negative_likelihood, default=None)


def _further(part: Data, spread: Spread, run: Polished, steps: int) -> Polished:
    return polish(part, run.start, spread, steps=steps, rounds=1, share=run.share) or run


def _negative_likelihood(run: Polished) -> float:
    # A model without a finite response is the least likely of all.
    return run.likelihood if np.isfinite(run.likelihood) else np.inf


def _exchange(part: Data, spread: Spread, options: FitOptions, best: Polished) -> Polished:
    """Exchange modes as long as that pays; where no excess is left, only as far as it promises to."""
    while True:
        large = model_error(best, spread) > WORTH_EXCHANGE
        runs = [
            polish(part, start, spread, steps=EXCHANGE_STEPS, rounds=1, share=best.share)
            for start in exchanges(part, options, best, spread, at_any_rate=large)
        ]
        found = min((run for run in runs if run is not None), key=_negative_likelihood, default=None)
        if found is None:
            return best
        found = _further(part, spread, found, LAST_STEPS)
        if _negative_likelihood(found) >= best.likelihood - EXCHANGE_GAIN:
            return best
        best = found


def model_error(best: Polished, spread: Spread) -> float:
    """Part of the variance behind the weights that is not the measured one."""
    return float(best.share * np.mean(spread.size / spread.at(best.share)))


def _some_lines(data: Data, spread: Spread, options: FitOptions) -> tuple[Data, Spread]:
    outputs, _, inputs = data.H.shape
    return take_lines(data, spread, thin_lines(data, spread, options.moving * (outputs + inputs)))


def recommend_states(
    measured: FrequencyResponse, data: Data, spread: Spread, options: FitOptions
) -> order.OrderChoice:
    """The order that `choose` takes, each from the best of a few starts and of the order before.

    As long as a mode is lacking (`LACKING`) an order has all starts, and the search does not end: what a few
    sizes do not find is no sign that there is nothing more.
    """
    part, some = _some_lines(data, spread, options)
    runs: dict[int, tuple[order.Tried, Polished]] = {}

    def judge(run: Polished) -> order.Tried:
        states = run.layout.states
        # Terms for modes outside the band are the same at each order, and dearer than poles there otherwise.
        sized = dataclasses.replace(options.sized(states), residuals=False, direct=False)
        unknowns = count_unknowns(measured, sized)
        length = order.description_length(run.likelihood, unknowns, 2 * part.H.size)
        # Without a measured variance nothing tells noise from what the model lacks.
        excess = 0.0 if measured.variance is None else model_error(run, some)
        runs[states] = order.Tried(states, length, _held_out(data, spread, part, some, run), excess), run
        return runs[states][0]

    best: Polished | None = None
    lacking, most = True, np.hypot(LACKING, float(np.sqrt(np.mean(spread.variance / spread.at(1.0)))))
    for states in order.sizes():
        sized = options.sized(states)
        if 2 * count_unknowns(measured, sized) > part.H.size:
            break
        first = starts(part, sized) if lacking else few_starts(part, sized)
        best = _heats(part, some, _started(part, some, sized, best, first)) or best
        if best is None or best.layout.states != states:
            continue
        best = _as_long_as_it_tells(part, some, best)
        judge(best)
        known = [t for t, _ in runs.values()]
        lacking = min(t.held_out for t in known) > most
        if not lacking and (order.is_settled([t.length for t in known]) or order.has_met(known)):
            break
    if not runs:
        raise _no_order(measured, part, options)
    shortest, best = min(runs.values(), key=lambda of: of[0].length)
    explained = any(t.excess <= order.EXPLAINED for t, _ in runs.values())
    while explained and shortest.states != max(runs) and shortest.states - 2 not in runs:
        start = shrunk(part, options.sized(shortest.states - 2), best, some)
        best = (
            None if start is None else polish(part, start, some, steps=FEW_STEPS, rounds=1, share=best.share)
        )
        if best is None:
            break
        best = _as_long_as_it_tells(part, some, best)
        smaller = judge(best)
        if smaller.length >= shortest.length:
            break
        shortest = smaller
    return order.choose([runs[states][0] for states in sorted(runs)])


def _no_order(measured: FrequencyResponse, part: Data, options: FitOptions) -> DataError | FitError:
    """Why no order could be compared with another."""
    unknowns = count_unknowns(measured, options.sized(2))
    entries = part.H.shape[0] * part.H.shape[2]
    least = -(-2 * unknowns // entries)
    if len(part.s) >= least:
        return FitError("no order could be fitted", hint="a wider band or a longer period")
    return DataError(
        f"{len(part.s)} lines are too few to choose an order by: the least model has {unknowns} unknowns",
        hint=f"{least} lines or more (a wider band, a longer period), or say how many states",
    )


def _started(
    part: Data, some: Spread, options: FitOptions, best: Polished | None, first: Iterable[Start]
) -> list[tuple[Start, float | None]]:
    """Starts of an order: the hopeful of the first ones, and the order before grown."""
    started: list[tuple[Start, float | None]] = []
    started += [(start, None) for start in _hopeful(part, list(first))]
    if best is not None and (larger := _grown(part, some, options, best)) is not None:
        started.append(larger)
    return started


def _as_long_as_it_tells(part: Data, spread: Spread, run: Polished) -> Polished:
    """Refined until some steps more gain no more than one unknown costs in the description."""
    for _ in range(MOST_TURNS):
        before, run = run, _further(part, spread, run, FEW_STEPS)
        if before.likelihood - run.likelihood <= 0.5 * np.log(2 * part.H.size):
            break
    return run


def _grown(part: Data, spread: Spread, options: FitOptions, best: Polished) -> tuple[Start, float] | None:
    """A start from the order before, a pair added at each peak of the residual."""
    while (left := options.moving - best.layout.states) > 0:
        start = grown(part, options.sized(best.layout.states + 2), best, spread)
        if left <= 2:
            return start, best.share
        run = polish(part, start, spread, steps=1, rounds=1, share=best.share)
        if run is None:
            return None
        best = run
    return None


def _held_out(data: Data, spread: Spread, part: Data, some: Spread, best: Polished) -> float:
    """Error on lines that the model has not seen, over the size that the fit weighs by and their noise.

    Those that were left out; where none were, it is refined on every other line and judged on the rest.
    """
    unseen = np.setdiff1d(np.arange(len(data.s)), np.searchsorted(data.omega, part.omega))
    run = best
    if not len(unseen):
        half, spread_of_half = take_lines(part, some, np.arange(0, len(part.s), 2))
        run = _further(half, spread_of_half, best, HELD_OUT_STEPS)
        unseen = np.arange(1, len(data.s), 2)
    r = run.residual(data)[:, unseen]
    return float(np.sqrt(np.mean(np.abs(r) ** 2 / spread.at(1.0)[:, unseen])))


def count_unknowns(measured: FrequencyResponse, options: FitOptions) -> int:
    """Unknowns if all poles are pairs."""
    _, outputs, inputs = measured.H.shape
    each = 1 if options.real_constants else 2
    per_pair = 2 + each * (outputs * inputs if options.full_rank else outputs + inputs - 1)
    delays = {"output": outputs, "path": outputs * inputs, "common": 1, None: 0}[options.delay_of]
    return (
        -(-options.moving // 2) * per_pair
        + sum(n * (outputs + inputs - n) for n in (options.rigid, options.integrators))
        + delays
        + outputs * inputs * (options.residuals + bool(options.direct) - options.zero_sum)
    )
