"""The order that a response asks for: models of rising order, each the best of a few starts, compared."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError, FitError
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.add_or_exchange_modes import grown, shrunk
from middeck.identification.order.best_start import (
    FEW_STEPS,
    further,
    heats,
    hopeful,
    leaves_noise,
    some_lines,
)
from middeck.identification.order.order_choice import (
    OrderChoice,
    TriedOrder,
    choose,
    description_length,
    has_met,
    is_settled,
    sizes,
)
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Start
from middeck.identification.search.leverage import leverage
from middeck.identification.search.refine_and_reweigh import Polished, polish
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.identification.start.start import few_starts, starts
from middeck.identification.uncertainty.covariance import MOST_LEVERAGE
from middeck.systems.plants.response import FrequencyResponse

# An order is given up to so many turns of a few steps before it is compared.
MOST_TURNS = 6
# A fit that misses more of the lines kept out than this share and their noise lacks a mode that can be found.
LACKING = 0.1


def recommend_states(
    measured: FrequencyResponse, data: Data, spread: ExcessVariance, options: FitOptions
) -> OrderChoice:
    """The order that `choose` recommends; each is the best of a few starts and of the order before.

    While a mode is lacking (`LACKING`), each order is fitted from all starts and the search goes on: that a
    few sizes bring no gain then does not show that the order is reached.
    """
    part, some = some_lines(data, spread, options)
    runs: dict[int, tuple[TriedOrder, Polished]] = {}

    def judge(run: Polished) -> TriedOrder:
        states = run.layout.states
        # Terms for modes outside the band are the same at each order, and dearer than poles there otherwise.
        sized = dataclasses.replace(options.sized(states), residuals=False, direct=False)
        unknowns = count_unknowns(measured, sized)
        length = description_length(run.likelihood, unknowns, 2 * part.H.size, some.alike)
        # Without a measured variance noise and missing modes cannot be distinguished.
        noise = measured.variance is None or leaves_noise(run, some)
        lines = _held_out(data, spread, part, some, run)
        tried = TriedOrder(states, length, float(np.sqrt(np.sum(lines))), noise, lines=lines)
        runs[states] = tried, run
        return tried

    best: Polished | None = None
    lacking, most = True, np.hypot(LACKING, float(np.sqrt(np.mean(spread.variance / spread.at(1.0)))))
    for states in sizes():
        sized = options.sized(states)
        if 2 * count_unknowns(measured, sized) > part.H.size:
            break
        first = starts(part, sized) if lacking else few_starts(part, sized)
        best = heats(part, some, _started(part, some, sized, best, first)) or best
        if best is None or best.layout.states != states:
            continue
        best = _as_long_as_it_tells(part, some, best)
        judge(best)
        known = [t for t, _ in runs.values()]
        lacking = min(t.held_out for t in known) > most
        if not lacking and (is_settled([t.length for t in known]) or has_met(known)):
            break
    if not runs:
        raise _no_order(measured, part, options)
    shortest, best = min(runs.values(), key=lambda of: of[0].length)
    explained = any(t.noise for t, _ in runs.values())
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
    return choose([runs[states][0] for states in sorted(runs)])


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
    part: Data, some: ExcessVariance, options: FitOptions, best: Polished | None, first: Iterable[Start]
) -> list[tuple[Start, float | None]]:
    """Starts of an order: the hopeful of the first ones, and the order before grown."""
    started: list[tuple[Start, float | None]] = []
    started += [(start, None) for start in hopeful(part, list(first))]
    if best is not None and (larger := _grown(part, some, options, best)) is not None:
        started.append(larger)
    return started


def _as_long_as_it_tells(part: Data, spread: ExcessVariance, run: Polished) -> Polished:
    """Refined until some steps more gain no more than one unknown costs in the description."""
    for _ in range(MOST_TURNS):
        before, run = run, further(part, spread, run, FEW_STEPS)
        if before.likelihood - run.likelihood <= 0.5 * np.log(2 * part.H.size):
            break
    return run


def _grown(
    part: Data, spread: ExcessVariance, options: FitOptions, best: Polished
) -> tuple[Start, float] | None:
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


def _held_out(
    data: Data, spread: ExcessVariance, part: Data, some: ExcessVariance, best: Polished
) -> Float[np.ndarray, " line"]:
    """Mean square error on lines that the model has not seen, shared out among them.

    It is relative to the size that the fit weighs by and their noise.

    Those that were left out; where none were, on each line that of the model without it. A refit to every
    other line would not do: it keeps poles that follow single lines, and how many depends on where rounding
    leads a search.
    """
    unseen = np.setdiff1d(np.arange(len(data.s)), np.searchsorted(data.omega, part.omega))
    r, v = best.residual(data), spread.at(1.0)
    if len(unseen):
        r, v = r[:, unseen], v[:, unseen]
    else:
        r = r / (1.0 - np.minimum(leverage(part, best, some.at(best.share)), MOST_LEVERAGE))
    return np.sum(np.abs(r) ** 2 / v, axis=(0, 2)) / r.size


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
