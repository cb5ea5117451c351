"""A fit of a response without the modes that it can do without."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from middeck.identification.fit.data import Data
from middeck.identification.fit.fitted_model import model_of, structure_of
from middeck.identification.fit.order import description_length
from middeck.identification.fit.polish import Polished, polish
from middeck.identification.fit.significance import mode_significance, without_modes
from middeck.identification.fit.weights import Spread
from middeck.identification.uncertainty.covariance import estimate_covariance
from middeck.systems.response import FrequencyResponse

# A mode of fewer deviations is worth a try without it; which of the two is better, lengths tell.
WORTH_A_TRY = 8.0
# Of no more than this, all are tried without at once.
NOTHING = 2.0
STEPS = 10


def tidied(measured: FrequencyResponse, data: Data, best: Polished, spread: Spread) -> Polished:
    """``best`` without modes whose residue may be noise, as long as that shortens the description."""
    kept: set[int] = set()
    at_once = True
    while len(best.layout.pair) > 1:
        significance = _significance(measured, best, spread)
        weak = significance < (NOTHING if at_once else WORTH_A_TRY)
        weak[list(kept)] = False
        if at_once and np.sum(weak) < 2:
            at_once = False
            continue
        if not weak.any():
            return best
        least = int(np.argmin(np.where(weak, significance, np.inf)))
        dropped = weak if at_once and not weak.all() else np.arange(len(weak)) == least
        fewer = _without(data, best, spread, dropped)
        if fewer is not None:
            best, kept = fewer, set()
        elif not at_once:
            kept.add(least)
        at_once = False
    return best


def _significance(measured: FrequencyResponse, best: Polished, spread: Spread) -> Float[np.ndarray, " mode"]:
    model = model_of(best.layout, best.refined, measured.inputs, measured.outputs)
    covariance = estimate_covariance(
        model, structure_of(best.layout), measured, assumed=spread.at(best.share), noise=spread.variance
    )
    found = mode_significance(covariance)
    return np.array([found[model.poles == pole].max() for pole in dict.fromkeys(model.poles.tolist())])


def _without(
    data: Data, best: Polished, spread: Spread, dropped: Bool[np.ndarray, " mode"]
) -> Polished | None:
    """Refined without some modes, if its description is no longer."""
    start = without_modes(best.layout, best.refined.theta, dropped)
    fewer = polish(data, start, spread, steps=STEPS, rounds=2, share=best.share)
    if fewer is None or _length(data, fewer) > _length(data, best):
        return None
    return fewer


def _length(data: Data, run: Polished) -> float:
    return description_length(run.likelihood, run.layout.unknowns, 2 * data.H.size)
