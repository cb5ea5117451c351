"""The likeliest of several starts for one order, by a race: few steps of all, more of the best."""

import numpy as np

from middeck.errors import FitError
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.add_or_exchange_modes import exchanges
from middeck.identification.order.thinning import take_lines, thin_lines
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Start
from middeck.identification.search.least_squares_costs import least_cost
from middeck.identification.search.refine_and_reweigh import Polished, polish
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.identification.start.start import starts

# Steps of all starts, of the best few of them, of the best, and of modes exchanged.
HEAT, FEW, FEW_STEPS, LAST_STEPS, EXCHANGE_STEPS = 0, 2, 6, 12, 4
# A start that costs so many times the best, before any step, is not refined at all.
HOPELESS = 3.0
# A model leaves noise where no more than this share of the variance is not the measured one, or as much as
# noise of few lines or periods leaves by chance: so many deviations, once in 160 fits.
EXPLAINED, BY_CHANCE = 0.1, 2.5
# An exchange counts when it gains more likelihood than rounding and an unsettled search may.
EXCHANGE_GAIN = 1.0


def race(data: Data, spread: ExcessVariance, options: FitOptions) -> Polished:
    """The likeliest of the starts, refined on some of the lines, then its exchanges.

    Successive halving: all starts take a few steps, the best of them a few more, and the best of those goes
    on. A start in the wrong valley is far behind after a few steps.
    """
    part, some = some_lines(data, spread, options)
    best = heats(part, some, [(start, None) for start in hopeful(part, list(starts(part, options)))])
    if best is None:
        raise FitError(
            f"no start for {options.moving} states could be refined",
            hint="fewer states, a wider band or a longer period",
        )
    best = further(part, some, best, LAST_STEPS)
    followed = spread_to_follow(best, some)
    if followed is not some:
        best = further(part, followed, best, FEW_STEPS)
    return _exchange(part, followed, options, best)


def spread_to_follow(best: Polished, spread: ExcessVariance) -> ExcessVariance:
    """The spread for a model that explains its data; ``spread.even`` for one that does not."""
    return spread if leaves_noise(best, spread) else spread.even


def hopeful(part: Data, started: list[Start]) -> list[Start]:
    """The starts that are worth a few steps."""
    each = [least_cost(start.layout, part, start.theta) for start in started]
    costs = [np.inf if found is None else found[0] for found in each]
    return [start for start, cost in zip(started, costs, strict=True) if cost <= HOPELESS * min(costs)]


def heats(part: Data, spread: ExcessVariance, started: list[tuple[Start, float | None]]) -> Polished | None:
    """The likeliest of several starts (each with the share of its weights, if known) after a few steps."""
    runs = [polish(part, start, spread, steps=HEAT, rounds=1, share=share) for start, share in started]
    ranked = sorted((run for run in runs if run is not None), key=_negative_likelihood)
    few = [further(part, spread, run, FEW_STEPS) for run in ranked[:FEW]]
    return min(few, key=_negative_likelihood, default=None)


def further(part: Data, spread: ExcessVariance, run: Polished, steps: int) -> Polished:
    """A run refined by so many steps more; the run itself where no step lowers the cost."""
    return polish(part, run.start, spread, steps=steps, rounds=1, share=run.share) or run


def _negative_likelihood(run: Polished) -> float:
    # A model without a finite response is the least likely of all.
    return run.likelihood if np.isfinite(run.likelihood) else np.inf


def _exchange(part: Data, spread: ExcessVariance, options: FitOptions, best: Polished) -> Polished:
    """Exchange modes as long as that pays; where no excess is left, only as far as it promises to."""
    while True:
        large = not leaves_noise(best, spread)
        runs = [
            polish(part, start, spread, steps=EXCHANGE_STEPS, rounds=1, share=best.share)
            for start in exchanges(part, options, best, spread, at_any_rate=large)
        ]
        found = min((run for run in runs if run is not None), key=_negative_likelihood, default=None)
        if found is None:
            return best
        found = further(part, spread, found, LAST_STEPS)
        if _negative_likelihood(found) >= best.likelihood - EXCHANGE_GAIN:
            return best
        best = found


def model_error(best: Polished, spread: ExcessVariance) -> float:
    """Part of the variance behind the weights beyond the measured one."""
    return float(best.share * np.mean(spread.size / spread.at(best.share)))


def leaves_noise(best: Polished, spread: ExcessVariance) -> bool:
    """Whether a model's residual may be noise alone; False where no noise was measured."""
    most = spread.mean * (1.0 + BY_CHANCE * spread.chance)
    return model_error(best, spread) <= max(EXPLAINED, 1.0 - 1.0 / most)


def some_lines(data: Data, spread: ExcessVariance, options: FitOptions) -> tuple[Data, ExcessVariance]:
    """Data and excess variance on a subset of the lines, as many as models of this order need."""
    outputs, _, inputs = data.H.shape
    return take_lines(data, spread, thin_lines(data, spread, options.moving * (outputs + inputs)))
