"""A test of whether a fitted delay represents poles beyond the band, as of a filter or an actuator.

A low-pass filter turns the phase in its pass band much as a delay does. With real constants, of relative
degree two, only a delay can follow that, and extra pairs of poles near each resonance fit the remainder. With
complex constants one pair beyond the band follows all of it. So if a fit with delays has modes that are not
sound, a second fit has its sound modes and one or two more pairs, with complex constants and no delays; the
smaller description length decides between the two (Rissanen 1978).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Complex

from middeck.identification.fit.mode_trust import Standing
from middeck.identification.model.fit_options import FitOptions, decided
from middeck.identification.order.order_choice import description_length
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Start
from middeck.identification.search.refine_and_reweigh import Polished, polish
from middeck.identification.spectra.excess_variance import ExcessVariance
from middeck.identification.start.start import start_at, upper_half
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Pairs beyond the band that are tried, from those of Butterworth's filter, whose delay is sqrt(2) over its
# frequency; two that coincide would be one.
PAIRS = (1, 2)
BUTTERWORTH, PARTED = np.sqrt(0.5) * (-1.0 + 1.0j), 1.3
# Standing of the modes that stay: a pair that is spent on the delay may look like a neighbour of a true one.
KEPT = (("sound",), ("sound", "unresolved"))
# Steps of a search on one share of weights, and how often the share is found anew.
STEPS, ROUNDS = 12, 2
# Difference of two description lengths (twice a logarithm of likelihood) up to which neither is preferred:
# ten in that logarithm are decisive in any scale (Kass and Raftery 1995).
UNDECIDED = 20.0


@record
class PolesInstead:
    """A model without delays that describes the response about as shortly, or more so.

    Attributes:
        states: States of the model with complex constants and a constant term.
        shorter: Whether it is clearly better; otherwise the response does not decide.
    """

    states: int
    shorter: bool

    def doubt(self) -> str:
        """The warning."""
        tells = "they are the shorter description" if self.shorter else "the response does not tell which"
        follow = ", and modes were spent on what it leaves of them" if self.shorter else ""
        return (
            f"the delay may stand for poles beyond the band, as of a filter or an actuator{follow}: {tells}; "
            f"take constants='complex', delay=False, {self.states} states, or a wider band"
        )


def true_modes(standing: Sequence[Standing]) -> list[Bool[np.ndarray, " mode"]]:
    """Candidates for the modes in the data: sound ones, and these with neighbours that are not resolved."""
    found = [np.array([one in kept for one in standing], dtype=bool) for kept in KEPT]
    return found[: 1 + bool(np.any(found[0] != found[1]))]


def poles_instead(
    measured: FrequencyResponse,
    data: Data,
    best: Polished,
    spread: ExcessVariance,
    true: Sequence[Complex[np.ndarray, " mode"]],
) -> PolesInstead | None:
    """Poles that describe ``measured`` as well as ``best`` does, with one set of its ``true`` poles; None for
    none. The fit is refined by the same cost first: likelihoods of two costs do not compare."""
    same = polish(data, best.start, spread, steps=STEPS, rounds=ROUNDS, share=best.share) or best
    found: list[tuple[float, int]] = []
    for poles, pairs in itertools.product(true, PAIRS):
        start = _beyond(measured, data, best, poles, pairs)
        run = polish(data, start, spread, steps=STEPS, rounds=ROUNDS)
        if run is not None:
            found.append((_length(data, run, spread), run.layout.states))
    return instead_of(_length(data, same, spread), found)


def _beyond(measured: FrequencyResponse, data: Data, best: Polished, true: np.ndarray, pairs: int) -> Start:
    """The true poles, and so many further pairs whose delay together is the fit's largest one."""
    late = max(float(best.start.point.delay_s.max()), 1.0 / float(data.omega[-1]))
    each = BUTTERWORTH * np.sqrt(2.0) * pairs / late * np.linspace(1.0, PARTED, pairs)
    poles, pair = upper_half(np.concatenate([true, each]), 0.0)
    states = int(np.sum(np.where(pair, 2, 1)))
    options = decided(measured, FitOptions(states=states, constants="complex", delay=False))
    return start_at(data, options, poles, pair, np.zeros((len(data.H), 1)))


def instead_of(own: float, others: Sequence[tuple[float, int]]) -> PolesInstead | None:
    """The shortest of ``others`` (length, states), where it is as short as ``own``."""
    length, states = min(others, default=(np.inf, 0))
    return PolesInstead(states, length < own - UNDECIDED) if length <= own + UNDECIDED else None


def _length(data: Data, run: Polished, spread: ExcessVariance) -> float:
    likelihood = run.likelihood if np.isfinite(run.likelihood) else np.inf
    return description_length(likelihood, run.layout.unknowns, 2 * data.H.size, spread.alike)
