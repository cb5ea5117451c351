"""The likeliest of several starts for one order, and the order that a response asks for."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.errors import FitError
from middeck.identification.exchange import exchanges
from middeck.identification.fit_data import Data
from middeck.identification.order import OrderChoice, choose, description_length, is_settled, sizes
from middeck.identification.polish import Polished, polish
from middeck.identification.start import Options, starts
from middeck.identification.weights import Spread
from middeck.systems.response import FrequencyResponse

# The starts are compared on lines that hold about so many numbers; the best is then refined on all.
RACE_NUMBERS = 5000
RACE_STEPS = 40
# Exchanges are tried when more than this share of the variance is not the measured one, and one counts when
# it gains more likelihood than rounding and an unsettled search may.
WORTH_EXCHANGE = 0.1
EXCHANGE_GAIN = 1.0


def race(data: Data, spread: Spread, options: Options) -> Polished:
    """The likeliest of the starts, each refined for a while on some of the lines, then its exchanges."""
    part, some = _some_lines(data, spread)
    best: Polished | None = None
    for start in starts(data, options):
        run = polish(part, start, some, steps=RACE_STEPS, rounds=3)
        if run is not None and (best is None or run.likelihood < best.likelihood):
            best = run
    if best is None:
        raise FitError(
            f"no start for {options.states} states could be refined",
            hint="fewer states, a wider band or a longer period",
        )
    return _exchange(part, some, options, best)


def _exchange(part: Data, spread: Spread, options: Options, best: Polished) -> Polished:
    """Exchange modes as long as that pays; a model that leaves no excess has nothing to gain."""
    while model_error(best, spread) > WORTH_EXCHANGE:
        runs = (
            polish(part, start, spread, steps=RACE_STEPS, rounds=3)
            for start in exchanges(part, options, best, spread)
        )
        better = (run for run in runs if run is not None and run.likelihood < best.likelihood - EXCHANGE_GAIN)
        found = next(better, None)
        if found is None:
            return best
        best = found
    return best


def model_error(best: Polished, spread: Spread) -> float:
    """Part of the variance behind the weights that is not the measured one."""
    return float(best.share * np.mean(spread.size / spread.at(best.share)))


def _some_lines(data: Data, spread: Spread) -> tuple[Data, Spread]:
    some = slice(None, None, max(1, data.H.size // RACE_NUMBERS))
    return Data(data.s[some], data.H[:, some], data.weight[:, some]), Spread(
        spread.variance[:, some], spread.size[:, some]
    )


def recommend_states(
    measured: FrequencyResponse, data: Data, spread: Spread, options: Options
) -> OrderChoice:
    """The order of the shortest description, each order raced as a fit would be."""
    part, _ = _some_lines(data, spread)
    tried: list[int] = []
    length: list[float] = []
    for states in sizes():
        sized = dataclasses.replace(options, states=states)
        unknowns = count_unknowns(measured, sized)
        if 2 * unknowns > part.H.size:
            break
        try:
            run = race(data, spread, sized)
        except FitError:
            continue
        tried.append(states)
        length.append(description_length(run.likelihood, unknowns, 2 * part.H.size))
        if is_settled(length):
            break
    if not tried:
        raise FitError("no order could be fitted", hint="a wider band or a longer period")
    return choose(tried, length)


def count_unknowns(measured: FrequencyResponse, options: Options) -> int:
    """Unknowns if all poles are pairs."""
    _, outputs, inputs = measured.H.shape
    each = 1 if options.real_constants else 2
    per_pair = 2 + each * (inputs - 1) + each * outputs
    return (
        -(-options.states // 2) * per_pair
        + outputs * options.with_delay
        + outputs * inputs * (options.with_lower + options.with_direct)
    )
