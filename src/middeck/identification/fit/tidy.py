"""Remove the modes that a fit of a response does not need."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float

from middeck.identification.fit.fitted_model import model_of, structure_of
from middeck.identification.fit.significance import mode_significance, without_modes
from middeck.identification.order.order import description_length
from middeck.identification.problem.data import Data
from middeck.identification.search.polish import Polished, polish
from middeck.identification.spectra.weights import Spread
from middeck.identification.uncertainty.covariance import estimate_covariance
from middeck.systems.response import FrequencyResponse

# A mode of fewer deviations is worth a try without it; which of the two is better, lengths tell.
WORTH_A_TRY = 8.0
# Of no more than this, all are tried without at once.
NOTHING = 2.0
STEPS = 10
State = TypeVar("State")


def tidied(measured: FrequencyResponse, data: Data, best: Polished, spread: Spread) -> Polished:
    """``best`` without modes whose residue may be noise, as long as that shortens the description."""
    return shed(
        best,
        lambda run: _significance(measured, run, spread),
        lambda run, dropped: _without(data, run, spread, dropped),
    )


def shed(
    state: State,
    significance: Callable[[State], Float[np.ndarray, " mode"]],
    without: Callable[[State, Bool[np.ndarray, " mode"]], State | None],
) -> State:
    """Remove modes that a fit does not need: all insignificant ones at once, then one by one.

    ``significance`` has the deviations of each mode's residue; ``without`` the fit without some modes, or
    None where that is no better.
    """
    kept: set[int] = set()
    at_once = True
    while len(size := significance(state)) > 1:
        weak = size < (NOTHING if at_once else WORTH_A_TRY)
        weak[list(kept)] = False
        if at_once and (np.sum(weak) < 2 or weak.all()):
            at_once = False
            continue
        if not weak.any():
            return state
        least = int(np.argmin(np.where(weak, size, np.inf)))
        fewer = without(state, weak if at_once else np.arange(len(weak)) == least)
        if fewer is not None:
            state, kept = fewer, set()
        elif not at_once:
            kept.add(least)
        at_once = False
    return state


def _significance(measured: FrequencyResponse, best: Polished, spread: Spread) -> Float[np.ndarray, " mode"]:
    model = model_of(best, measured.inputs, measured.outputs)
    covariance = estimate_covariance(
        model, structure_of(best.layout), measured, assumed=spread.at(best.share), noise=spread.variance
    )
    found = mode_significance(covariance)
    return np.array([found[model.poles == pole].max() for pole in dict.fromkeys(model.poles.tolist())])


def _without(
    data: Data, best: Polished, spread: Spread, dropped: Bool[np.ndarray, " mode"]
) -> Polished | None:
    """Refined without some modes, if its description is no longer."""
    start = without_modes(best.start, dropped)
    fewer = polish(data, start, spread, steps=STEPS, rounds=2, share=best.share)
    if fewer is None or _length(data, fewer) > _length(data, best):
        return None
    return fewer


def _length(data: Data, run: Polished) -> float:
    return description_length(run.likelihood, run.layout.unknowns, 2 * data.H.size)
