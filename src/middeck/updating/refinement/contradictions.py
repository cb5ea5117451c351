"""Surveys that contradict one another: found, their deviations widened, and by what each is off the rest."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from middeck.updating.refinement.bayesian_estimate import Estimate, Linear, estimate, excess
from middeck.updating.refinement.problem import linear_problem
from middeck.updating.residuals.damping import ComparedDamping
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import ComparedStatic, ErrorFields
from middeck.updating.residuals.surveys import Compared

# Surveys whose frequencies, or ratios, are this many times farther from any one article than they state.
CONTRADICT = 2.0


class Tests(NamedTuple):
    """Measured values beside the model, in the order of the rows of `linear_problem`."""

    compared: tuple[Compared, ...]
    heard: tuple[ComparedResponse, ...]
    damped: tuple[ComparedDamping, ...]
    statics: tuple[ComparedStatic, ...]

    @property
    def every(self) -> tuple[Compared | ComparedResponse | ComparedDamping | ComparedStatic, ...]:
        """All of them."""
        return (*self.compared, *self.heard, *self.damped, *self.statics)

    def rows_of_several(self, kind: type) -> Bool[np.ndarray, " row"]:
        """Rows of frequencies, or of ln zeta, that another survey may contradict."""
        mine = {id(t): len(t.pairs) for t in (*self.compared, *self.damped) if isinstance(t, kind)}
        several = len(mine) > 1
        own = [np.arange(len(t.residual)) < several * mine.get(id(t), 0) for t in self.every]
        return np.concatenate(own)

    def widened(self, kind: type, by: float) -> Tests:
        """The tests with deviations of frequencies, or of ln zeta, so many times larger."""
        name = "compared" if kind is Compared else "damped"
        return self._replace(**{name: tuple(_widened(t, by) for t in getattr(self, name))})


Of = TypeVar("Of", Compared, ComparedDamping)


def _widened(test: Of, by: float) -> Of:
    own = np.arange(len(test.residual)) < len(test.pairs)
    return dataclasses.replace(test, std=np.where(own, by, 1.0) * test.std)


def estimate_of(
    tests: Tests,
    fields: ErrorFields | None,
    from_mean: Float[np.ndarray, " unknown"],
    spread: Float[np.ndarray, " unknown"],
    usual: Float[np.ndarray, " sort"],
) -> tuple[Tests, Linear, Estimate]:
    """The most probable; deviations of surveys that contradict one another are widened.

    Else a step far out is the answer: slopes by measured frequencies differ as these contradict.
    """
    while True:
        compared, heard, damped, statics = tests
        problem = linear_problem(compared, statics, fields, from_mean, spread, heard, damped)
        found = estimate(problem, usual[: problem.sorts])
        for kind in (Compared, ComparedDamping):
            off = excess(problem, found, tests.rows_of_several(kind))
            if off > CONTRADICT:
                tests = tests.widened(kind, off)
                break
        else:
            return tests, problem, found
