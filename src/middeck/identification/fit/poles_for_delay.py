"""Whether a delay of a fit stands for poles beyond the band, as of a filter or an actuator.

A low-pass filter turns the phase in its pass band as a delay does, and a little more. With real constants, of
relative degree two, only a delay can follow that, and pairs of poles are spent about each resonance on what
it leaves. With complex constants a pair beyond the band follows all of it. So where a fit with delays has
modes that are not sound, its sound ones and one or two pairs more, of complex constants and without delays,
are fitted in its place: which of the two is the article, their description lengths tell (Rissanen 1978).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.errors import DataError, FitError
from middeck.identification.model.fit_options import FitOptions, decided
from middeck.identification.order.best_start import race
from middeck.identification.order.order import description_length
from middeck.identification.problem.data import Data
from middeck.identification.search.polish import Polished
from middeck.identification.spectra.weights import Spread
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Pairs beyond the band that are tried.
PAIRS = (1, 2)
# Difference of two description lengths (twice a logarithm of likelihood) up to which neither is preferred:
# ten in that logarithm are decisive in any scale (Kass and Raftery 1995).
UNDECIDED = 20.0


@record
class PolesInstead:
    """A model without delays that describes the response about as shortly, or more so.

    Attributes:
        states: Of the model with complex constants and a constant term.
        shorter: Whether it is the better one beyond doubt; otherwise the response does not tell.
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


def poles_instead(
    measured: FrequencyResponse, data: Data, best: Polished, spread: Spread, sound: int
) -> PolesInstead | None:
    """What describes ``measured`` as well as ``best`` does, with ``sound`` modes of it; None where nothing
    does."""
    own = _length(data, best)
    found: list[tuple[float, int]] = []
    for pairs in PAIRS:
        asked = FitOptions(states=2 * (sound + pairs), constants="complex", delay=False)
        try:
            run = race(data, spread, decided(measured, asked))
        except (DataError, FitError):
            continue
        found.append((_length(data, run), run.layout.states))
    return instead_of(own, found)


def instead_of(own: float, others: Sequence[tuple[float, int]]) -> PolesInstead | None:
    """The shortest of ``others`` (length, states), where it is as short as ``own``."""
    length, states = min(others, default=(np.inf, 0))
    return PolesInstead(states, length < own - UNDECIDED) if length <= own + UNDECIDED else None


def _length(data: Data, run: Polished) -> float:
    likelihood = run.likelihood if np.isfinite(run.likelihood) else np.inf
    return description_length(likelihood, run.layout.unknowns, 2 * data.H.size)
