"""Unknowns that a refinement can determine: their effects on measured values, and alike ones.

Each column of slopes is divided by the noise of its rows and multiplied by the spread of its unknown: the
effect of one prior deviation in deviations of the test. Columns aligned with the first error can take it
away; columns that are aligned with one another cannot be distinguished.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.structure.model.article import Structure
from middeck.updating.refinement.bayesian_estimate import USUAL
from middeck.updating.refinement.refine import USUAL_DAMPING, USUAL_STATIC, compare_at_first
from middeck.updating.residuals.damping_rows import ComparedDamping
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import ComparedStatic, StaticTest
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from middeck.values import record

# Deviations of the test: an unknown that moves less is not seen.
SEEN = 1.0
# Cosine of two columns beyond which the surveys determine their sum alone.
ALIKE = 0.99


@record(kw_only=True)
class Choice:
    """The unknowns before a refinement.

    Attributes:
        strength: Effect of one prior deviation of each on all measured values, in deviations of these.
        alignment: Cosine with the first error: how much of it this unknown alone could take away, by sign.
        cosine: Between the columns of two unknowns, 1 where they move everything alike.
        weak: Unknowns that the surveys do not see, by their numbers.
        alike: Groups of unknowns that the surveys do not tell apart: to be moved as one, or one of them kept.
    """

    unknowns: tuple[Unknown, ...]
    strength: Float[np.ndarray, " unknown"]
    alignment: Float[np.ndarray, " unknown"]
    cosine: Float[np.ndarray, "unknown unknown"]
    weak: tuple[int, ...]
    alike: tuple[tuple[int, ...], ...]

    def reason(self, number: int) -> str:
        """Why an unknown is better left out or merged; empty for one that can stand."""
        if number in self.weak:
            return "not seen: over its whole spread no test changes by more than its noise"
        for group in self.alike:
            if number in group:
                others = ", ".join(self.unknowns[k].name for k in group if k != number)
                return (
                    f"changes all tests in the same proportions as {others}: make them one group, or keep one"
                )
        return ""


def weigh_unknowns(
    structure: Structure,
    surveys: Sequence[Survey],
    unknowns: Sequence[Unknown],
    model_error: float = USUAL,
    statics: Sequence[StaticTest] = (),
    static_error: float = USUAL_STATIC,
    damping_error: float = USUAL_DAMPING,
) -> Choice:
    """The choice at the mean of the prior; noise and the errors of the model together are the unit.

    Raises `ConfigError` as `refine`.
    """
    compared = compare_at_first(structure, surveys, unknowns, statics)
    usual = [_usual(c, model_error, static_error, damping_error) for c in compared]
    std = np.concatenate([np.hypot(c.std, error) for c, error in zip(compared, usual, strict=True)])
    spread = np.array([u.spread for u in unknowns])
    columns = np.vstack([c.slope for c in compared]) * spread / std[:, None]
    error = np.concatenate([c.residual for c in compared]) / std
    strength = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(strength > 0.0, strength, 1.0)
    cosine = np.abs(unit.T @ unit)
    weak = tuple(int(k) for k in np.flatnonzero(strength < SEEN))
    return Choice(
        unknowns=tuple(unknowns),
        strength=strength,
        alignment=unit.T @ error / max(float(np.linalg.norm(error)), np.finfo(float).tiny),
        cosine=cosine,
        weak=weak,
        alike=_groups(cosine, weak),
    )


def _usual(compared: object, model_error: float, static_error: float, damping_error: float) -> float:
    """Usual error of the model beside noise; in a response's rows it is counted already."""
    if isinstance(compared, ComparedResponse):
        return 0.0
    if isinstance(compared, ComparedDamping):
        return damping_error
    return static_error if isinstance(compared, ComparedStatic) else model_error


def _groups(cosine: np.ndarray, weak: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """Unknowns that are alike, each with all of its group; those that are not seen have none."""
    found: list[tuple[int, ...]] = []
    for k in range(len(cosine)):
        if k in weak or any(k in group for group in found):
            continue
        group = [j for j in range(k, len(cosine)) if j not in weak and cosine[k, j] > ALIKE]
        if len(group) > 1:
            found.append(tuple(group))
    return tuple(found)
