"""The order of a response, with terms for what is outside its band where poles would else stand for it.

Modes outside the band leave a slope and a constant in it. A model without terms for those spends pairs of
poles on them, wherever these do so best: far above the band, or critically damped below it. Such a pair is no
mode. Where the recommended order has poles outside the band, the terms of Ewins (2000, sec. 4.2) are tried
instead: D for modes above, and L / s^2 for modes below; what has the shortest description is taken.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from middeck.identification.fit.choices import Choices, at_zero
from middeck.identification.fit.data import Data
from middeck.identification.fit.layout import unpack
from middeck.identification.fit.order import OrderChoice
from middeck.identification.fit.polish import Polished
from middeck.identification.fit.race import race, recommend_states
from middeck.identification.fit.start import Options
from middeck.identification.fit.weights import Spread
from middeck.systems.response import FrequencyResponse


def race_of_orders(
    measured: FrequencyResponse, data: Data, spread: Spread, options: Options, choices: Choices
) -> tuple[Polished, str]:
    """The model of the recommended order, and the reason for that."""
    choice = recommend_states(measured, data, spread, options)
    best = race(data, spread, dataclasses.replace(options, states=choice.states))
    reason = choice.reason
    rivals = [(choice, options)]
    if _has_poles_beyond(best, data):
        rivals += [(recommend_states(measured, data, spread, o), o) for o in _with_terms(options, choices)]
    choice, chosen = min(rivals, key=lambda rival: _length(rival[0]))
    if chosen is not options:
        best = race(data, spread, dataclasses.replace(chosen, states=choice.states))
        terms = "a constant and 1/s^2 stand" if chosen.with_lower else "a constant stands"
        reason = f"{choice.reason}; {terms} for modes outside the band"
    still = at_zero(choices)
    return best, f"{reason}; {still} more are at zero" if still else reason


def _has_poles_beyond(best: Polished, data: Data) -> bool:
    size = np.abs(unpack(best.layout, best.refined.theta).poles)
    return bool(np.any((size < np.imag(data.s[0])) | (size > np.imag(data.s[-1]))))


def _with_terms(options: Options, choices: Choices) -> Iterator[Options]:
    """The same with terms that were not decided upon."""
    decided = choices.direct is not None or choices.relative_degree is not None or choices.residuals
    if decided or options.period_s:
        return
    if not options.with_direct:
        yield dataclasses.replace(options, with_direct=True)
    if not at_zero(choices):
        yield dataclasses.replace(options, with_direct=True, with_lower=True)


def _length(choice: OrderChoice) -> float:
    return next(t.length for t in choice.tried if t.states == choice.states)
