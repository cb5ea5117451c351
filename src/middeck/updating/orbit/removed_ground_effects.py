"""Effects removed between a test on the ground and an environment without gravity, term by term."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.gravity.budget import build_budget
from middeck.updating.orbit.predicted_frequencies import Prediction
from middeck.updating.refinement.refine import Refined
from middeck.values import record


@record(kw_only=True)
class Removed:
    """Contributions of gravity's effects to the refined model's frequencies in a survey, see `build_budget`.

    Attributes:
        survey: Name of the survey, the first of the article as it is promised.
        share_hz: Share of suspension, stiffness and deformation (`EFFECTS`) for each mode; their sum is the
            frequency there less that without gravity.
        unclear: Modes that keep less than half of their shape while effects are switched.
    """

    survey: str
    share_hz: Float[np.ndarray, "mode effect"]
    unclear: Bool[np.ndarray, " mode"]


def removed_terms(refined: Refined, predicted: Prediction) -> Removed | None:
    """Terms that modes without gravity and suspension no longer have.

    None where there is nothing that a budget could part: gravity or devices in the promised environment, no
    survey of the article in the same configuration and clamps with as many modes, or rounding beside a stiff
    member.
    """
    orbit = predicted.modes
    for survey in (c.survey for c in refined.compared):
        there = survey.set_up(refined.structure, refined.unknowns)
        if there.structure != refined.structure:
            continue
        try:
            found = build_budget(orbit, there.solve(refined.x), int(predicted.index.max(initial=-1)) + 1)
        except (ConfigError, NumericalError):
            continue
        row = {int(i): k for k, i in enumerate(found.pairs[:, 0])}
        if not set(predicted.index.tolist()) <= set(row):
            continue
        at = [row[int(i)] for i in predicted.index]
        return Removed(survey=survey.name, share_hz=found.share_hz[at], unclear=np.isin(at, found.doubtful))
    return None
