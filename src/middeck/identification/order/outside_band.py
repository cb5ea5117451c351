"""Order of a response, with terms for the modes outside its band in place of poles.

Modes outside the band leave a slope and a constant in it. A model without terms for these spends pairs of
poles on them, far above the band or critically damped below it; in a narrow band such pairs also stand for a
delay and leave a lead. Where the recommended order has poles outside the band, or leads, two terms are tried
instead: D for modes above and L / s^2 for modes below (Ewins 2000, sec. 4.2). The least description length is
taken; if that model leads, one that does not and fits the held-out lines as well.
"""

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from middeck.errors import DataError, FitError
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.best_start import race
from middeck.identification.order.order_choice import WORSE, OrderChoice, TriedOrder
from middeck.identification.order.recommended_order import recommend_states
from middeck.identification.problem.data import Data
from middeck.identification.search.fit_warnings import LEFT
from middeck.identification.search.refine_and_reweigh import Polished
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.systems.plants.response import FrequencyResponse


def choose_order(
    measured: FrequencyResponse, data: Data, spread: ExcessVariance, options: FitOptions, asked: FitOptions
) -> tuple[Polished, str]:
    """The model of the recommended order, and the reason for that."""
    choice = recommend_states(measured, data, spread, options)
    best, chosen = race(data, spread, options.sized(choice.states)), options
    reason = choice.reason
    if _has_poles_beyond(best, data) or _leads(best, data):
        rivals = [_Rival(choice, options, best)]
        for with_terms in _with_terms(options, asked):
            # Terms are unknowns too: too few lines for them are none too few for the order without.
            with contextlib.suppress(DataError, FitError):
                rivals.append(_Rival(recommend_states(measured, data, spread, with_terms), with_terms, None))
        choice, chosen, best = _take(data, spread, rivals)
    if chosen is not options:
        terms = "a constant and 1/s^2 stand" if chosen.residuals else "a constant stands"
        reason = f"{choice.reason}; {terms} for modes outside the band"
    return best, f"{reason}; {options.at_zero} more are at zero" if options.at_zero else reason


class _Rival(NamedTuple):
    """An order recommended with some terms, and its model where that is known."""

    choice: OrderChoice
    options: FitOptions
    best: Polished | None


def _take(
    data: Data, spread: ExcessVariance, rivals: Sequence[_Rival]
) -> tuple[OrderChoice, FitOptions, Polished]:
    """The MDL choice; if it leads, the next that does not and meets lines kept out as well."""
    shortest: tuple[OrderChoice, FitOptions, Polished] | None = None
    for choice, options, best in sorted(rivals, key=lambda rival: _judged(rival.choice).length):
        if shortest and _judged(choice).held_out > WORSE * _judged(shortest[0]).held_out:
            continue
        best = best or race(data, spread, options.sized(choice.states))
        if not _leads(best, data):
            return choice, options, best
        shortest = shortest or (choice, options, best)
    assert shortest is not None
    return shortest


def _has_poles_beyond(best: Polished, data: Data) -> bool:
    size = np.abs(best.start.point.poles)
    return bool(np.any((size < data.omega[0]) | (size > data.omega[-1])))


def _leads(best: Polished, data: Data) -> bool:
    """Whether an output leads by more than a tenth of a radian in the band: too much to set it to zero."""
    return bool(np.any(best.start.point.delay_s * data.omega[-1] < -LEFT))


def _with_terms(options: FitOptions, asked: FitOptions) -> Iterator[FitOptions]:
    """The same with terms that were not decided upon."""
    decided = asked.direct is not None or asked.relative_degree is not None or asked.residuals
    if decided or options.period_s:
        return
    if not options.direct:
        yield dataclasses.replace(options, direct=True)
    if not asked.rigid:
        yield dataclasses.replace(options, direct=True, residuals=True)


def _judged(choice: OrderChoice) -> TriedOrder:
    return next(t for t in choice.tried if t.states == choice.states)
