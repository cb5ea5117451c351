"""A test of whether poles that are no modes of the article represent an AC-coupled sensor.

An AC-coupled channel multiplies the response by s tau / (1 + s tau). A fit with real constants follows that
phase with its delay, and the remainder with heavily damped or unresolved poles, after which no score shows
the coupling. A fit with such poles is therefore refined without them, and the coupling that its scores show
is divided out. The smaller description length decides between the two fits (Rissanen 1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.identification.fit.mode_trust import Standing
from middeck.identification.fit.poles_beyond_the_band import UNDECIDED
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio
from middeck.identification.start.start import HEAVY
from middeck.identification.uncertainty.lacking_terms import (
    COUPLED_TOLD,
    TOLD,
    LackingTerm,
    TermScores,
    coupled_channel,
)

# How often the coupling is found anew; and the steps and rounds of each search.
TIMES, STEPS, ROUNDS = 4, 12, 2


class CouplingTrial(NamedTuple):
    """A fit without some poles of data whose coupling was divided out: its length and what it still lacks."""

    length: float
    scores: TermScores


def coupling_terms(outputs: int) -> list[LackingTerm]:
    """A coupling of each output; that of an only input is the same of all, of the other sign."""
    return [LackingTerm(kind="coupled", output=o) for o in range(outputs)]


def without_coupling(
    rate: Float[np.ndarray, " output"], s: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "output line"]:
    """Factor on a response that removes couplings of outputs (1 / tau > 0) or of the input (-1 / tau)."""
    blocked = 1.0 + np.abs(rate)[:, None] / s
    return np.where(rate[:, None] >= 0.0, blocked, 1.0 / blocked)


def spare_modes(model: MeasurementModel, standing: Sequence[Standing]) -> Bool[np.ndarray, " mode"]:
    """Poles that may be no modes: not sound, or heavily damped."""
    return np.array([one != "sound" for one in standing], bool) | (damping_ratio(model) > HEAVY)


def coupling_instead(
    own: float, trial: Callable[[Float[np.ndarray, " output"]], CouplingTrial | None], model: MeasurementModel
) -> list[str]:
    """Warnings for couplings that describe as shortly as the poles do; ``own`` is the length with these.

    ``trial`` fits without them, the couplings of given rates divided out.
    """
    rate = np.zeros(len(model.outputs))
    for _ in range(TIMES):
        found = trial(rate)
        if found is None:
            return []
        scores = found.scores
        rate = rate + scores.value
    z = np.abs(rate * np.divide(scores.z, scores.value, out=np.zeros(len(rate)), where=scores.value != 0.0))
    if found.length > own + UNDECIDED:
        return []
    return [
        COUPLED_TOLD.format(channel=coupled_channel(term, model, r), tau=1.0 / abs(r), z=size)
        for term, r, size in zip(coupling_terms(len(rate)), rate, z, strict=True)
        if size > TOLD
    ]
