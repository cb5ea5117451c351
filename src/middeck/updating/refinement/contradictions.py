"""Surveys that contradict one another: detection, widened deviations, and the offset of each."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from middeck.updating.refinement.bayesian_estimate import Estimate, Linear, estimate, excess
from middeck.updating.refinement.problem import linear_problem
from middeck.updating.residuals.damping_rows import ComparedDamping
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import ComparedStatic, ErrorFields
from middeck.updating.residuals.surveys import Compared

# Surveys whose frequencies, or ratios, are this many times farther from any one article than they state.
CONTRADICT = 2.0
# Prior deviations of an estimate that is far out.
FAR = 3.0


class Tests(NamedTuple):
    """Measured values beside the model, in the order of the rows of `linear_problem`."""

    compared: tuple[Compared, ...]
    responses: tuple[ComparedResponse, ...]
    damped: tuple[ComparedDamping, ...]
    statics: tuple[ComparedStatic, ...]

    @property
    def every(self) -> tuple[Compared | ComparedResponse | ComparedDamping | ComparedStatic, ...]:
        """All rows."""
        return (*self.compared, *self.responses, *self.damped, *self.statics)

    def rows_of_several(self, kind: type) -> Bool[np.ndarray, " row"]:
        """Rows of frequencies, or of ln zeta, that another survey may contradict."""
        mine = {id(t): len(t.pairs) for t in (*self.compared, *self.damped) if isinstance(t, kind)}
        several = len(mine) > 1
        own = [np.arange(len(t.residual)) < several * mine.get(id(t), 0) for t in self.every]
        return np.concatenate(own)

    def with_slopes_of_logarithms(self) -> Tests:
        """Rows of frequencies as d ln f, whatever was measured."""
        return self._replace(compared=tuple(_logarithmic(c) for c in self.compared))

    def widened(self, kind: type, by: float) -> Tests:
        """The tests with deviations of frequencies, or of ln zeta, so many times larger."""
        name = "compared" if kind is Compared else "damped"
        return self._replace(**{name: tuple(_widened(t, by) for t in getattr(self, name))})


def _logarithmic(test: Compared) -> Compared:
    """Slopes by the model's omega^2 in place of the measured one, in the rows of own modes."""
    by = np.ones(len(test.residual))
    own = slice(len(test.pairs))
    by[own] = np.exp(2.0 * test.residual[own])
    return dataclasses.replace(test, slope=by[:, None] * test.slope)


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
    """The estimate, with widened deviations of surveys that contradict one another.

    Else a step far out is the answer: slopes by measured frequencies differ as these contradict. Where such a
    step leaves no contradiction, slopes of the logarithms, which do not differ, show it.
    """

    def solved(of: Tests) -> tuple[Linear, Estimate]:
        problem = linear_problem(of.compared, of.statics, fields, from_mean, spread, of.responses, of.damped)
        return problem, estimate(problem, usual[: problem.sorts])

    while True:
        problem, found = solved(tests)
        kind, off = _contradiction(tests, problem, found)
        if off <= CONTRADICT and np.any(np.abs(found.x) > FAR * spread):
            kind, off = _contradiction(tests, *solved(tests.with_slopes_of_logarithms()))
        if off <= CONTRADICT:
            return tests, problem, found
        tests = tests.widened(kind, off)


def _contradiction(tests: Tests, problem: Linear, found: Estimate) -> tuple[type, float]:
    """The first kind of rows that contradict one another, and by what."""
    by = {kind: excess(problem, found, tests.rows_of_several(kind)) for kind in (Compared, ComparedDamping)}
    return next(((kind, off) for kind, off in by.items() if off > CONTRADICT), (Compared, 0.0))
