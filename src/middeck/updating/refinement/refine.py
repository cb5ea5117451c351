"""Refine an article on tests on the ground, of modes and of sag: the most probable unknowns, what stays open.

How the most probable ones are looked for is in `search`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.structure.model.article import Structure
from middeck.updating.refinement.bayesian_estimate import (
    USUAL,
    Estimate,
    Linear,
    cut_below,
    unseen_deviations,
)
from middeck.updating.refinement.curvature import frequency_curvature
from middeck.updating.refinement.problem import MODAL, linear_problem, sort_names, zeros_of
from middeck.updating.refinement.repeated_tests import refuse_repeated
from middeck.updating.refinement.search import Prior, find_most_probable, place_tests
from middeck.updating.residuals.damping_rows import ComparedDamping
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import (
    ComparedStatic,
    ErrorFields,
    StaticTest,
)
from middeck.updating.residuals.surveys import (
    Compared,
    Survey,
)
from middeck.updating.unknowns.unknowns import ENVIRONMENT, FRICTION, LOOP, Unknown
from middeck.values import record

# What begins so is no parameter of the article.
ELSEWHERE = (ENVIRONMENT, LOOP, FRICTION)
# Relative errors of a beam model's sag and, over them, of each reading, that are thought likely before.
USUAL_STATIC, OF_READING = 0.02, 0.25
# Usual error of ln zeta that loss factors and dampers give a mode.
USUAL_DAMPING = 0.2


@record(kw_only=True)
class Refined:
    """An article refined on surveys and static tests.

    Attributes:
        compared, statics: Each survey and each static test beside the model.
        linear_at: The unknowns at which they are compared, a small step from the most probable ones.
        estimate: Unknowns, the model's own errors (of surveys how much of `left_out` is there, then of modes,
            see `OwnErrors`; of ``fields``; of the unloaded readings in the order of ``zeros``), and their
            covariance, linear about there.
        before_hz: Frequencies of the modes of the mean of the prior that each survey's pairs were then.
        before: Gauge readings of each static test at the mean of the prior.
        history: Largest move of an unknown in its own deviations, step by step.
        converged: Whether the last was small.
        fields: Strains of the static tests, which have errors of their own; None where there are no tests.
        unseen: Deviations of the model's own errors that no test saw, one a sort: ``estimate.tau``, and more
            where the tests say little of it.
        responses: Responses of the surveys that have one, beside the model.
        damped: Damping of the surveys that state it, beside the model; none if no unknown moves any.
    """

    structure: Structure
    unknowns: tuple[Unknown, ...]
    compared: tuple[Compared, ...]
    statics: tuple[ComparedStatic, ...]
    linear_at: Float[np.ndarray, " unknown"]
    estimate: Estimate
    before_hz: tuple[tuple[float, ...], ...]
    before: tuple[tuple[float, ...], ...]
    history: tuple[float, ...]
    converged: bool
    fields: ErrorFields | None
    unseen: Float[np.ndarray, " sort"]
    responses: tuple[ComparedResponse, ...] = ()
    damped: tuple[ComparedDamping, ...] = ()

    @property
    def zeros(self) -> tuple[tuple[str, ...], ...]:
        """Unloaded readings: series and `gauge_key` of each."""
        return zeros_of(self.statics)

    @property
    def sorts(self) -> tuple[str, ...]:
        """Names of the model's own errors, one for each ``estimate.tau``."""
        return sort_names(bool(self.statics), bool(self.damped))

    @property
    def x(self) -> Float[np.ndarray, " unknown"]:
        """The most probable unknowns."""
        return np.array([u.mean for u in self.unknowns]) + self.estimate.x

    @property
    def shear(self) -> tuple[float, float]:
        """Factor of `left_out` that the surveys show, and its deviation; zero without any."""
        at = len(self.unknowns)
        found = self.estimate
        return (float(found.d[0]), float(np.linalg.norm(found.root[at]))) if self.compared else (0.0, 0.0)

    def with_shear(self, n: Float[np.ndarray, " both"]) -> Float[np.ndarray, " both"]:
        """``n``, numbers of the estimate's root, moved off negative shear by `cut_below`."""
        return cut_below(n, self.estimate.root[len(self.unknowns)], self.shear[0]) if self.compared else n

    def drawn_at(self, n: Float[np.ndarray, " both"]) -> tuple[Float[np.ndarray, " unknown"], float]:
        """Unknowns, and the factor of `left_out`, at standard normal numbers of the estimate's root."""
        off, at = self.estimate.root @ n, len(self.unknowns)
        return self.x + off[:at], self.shear[0] + float(off[at]) if self.compared else 0.0

    @functools.cached_property
    def bent_tests(self) -> tuple[Float[np.ndarray, "mode unknown unknown"], ...]:
        """Second derivatives of ln f of the modes of each survey's pairs; all predictions need them."""
        found = []
        for one in self.compared:
            bound = one.survey.set_up(self.structure, self.unknowns).bound
            found.append(frequency_curvature(one.modes, bound, one.pairs[:, 0]))
        return tuple(found)

    @property
    def factors(self) -> dict[str, float]:
        """Factors of the article's parameters by name, as the ``[factors]`` of its file take them.

        What is added, and what belongs to an environment or a loop, has no place there (`left_out`).
        """
        factors: dict[str, float] = {}
        for unknown, x in zip(self.unknowns, self.x, strict=True):
            if unknown in self.left_out:
                continue
            for name in unknown.parameters:
                factors[name] = factors.get(name, 1.0) * float(np.exp(x))
        return factors

    def friction(self) -> tuple[RefinedFriction, ...]:
        """Friction of each joint for which surveys state it, in the order of their first."""
        rows = self.estimate.root[: len(self.unknowns)]
        stated = {f.joint: f for c in self.compared for f in c.survey.friction}
        return tuple(
            RefinedFriction(
                joint=f.joint,
                value=np.array([f.slip_torque, f.slip_angle]) * np.exp(moved @ self.x),
                root=moved @ rows,
            )
            for f in stated.values()
            for moved in [f.moved_by([u.parameters for u in self.unknowns])]
        )

    @property
    def left_out(self) -> tuple[Unknown, ...]:
        """Unknowns that ``factors`` of an article cannot represent."""
        return tuple(
            u for u in self.unknowns if u.added or any(n.startswith(ELSEWHERE) for n in u.parameters)
        )


@record(kw_only=True)
class RefinedFriction:
    """Slip torque [N m] and slip angle [rad] of a joint, and a root of the covariance of their logarithms."""

    joint: str
    value: Float[np.ndarray, "2"]
    root: Float[np.ndarray, "2 both"]

    @property
    def log_std(self) -> Float[np.ndarray, "2"]:
        """Standard deviations of the logarithms."""
        return np.linalg.norm(self.root, axis=1)


@named_kinds
def refine(
    structure: Structure,
    surveys: Sequence[Survey],
    unknowns: Sequence[Unknown],
    model_error: float = USUAL,
    statics: Sequence[StaticTest] = (),
    static_error: float = USUAL_STATIC,
    damping_error: float = USUAL_DAMPING,
) -> Refined:
    """The most probable unknowns, given all tests; ``structure`` is the article as drawn.

    ``model_error`` is what the frequencies of a model of this sort are thought to be wrong by, in parts of
    one, whatever its numbers, ``static_error`` what its members yield, ``damping_error`` its damping ratios
    (these where an unknown moves them): what the tests show takes their place, the less the fewer there are.

    Raises `ConfigError` for no test, an unknown that no test has, names or measurements given twice, or a
    survey without any mode in common, and as `compare_with_damping`; `NumericalError` where the article has
    no rest state at the mean of the prior.
    """
    _check_names(surveys, statics, unknowns)
    places = place_tests(structure, surveys, statics, unknowns)
    refuse_repeated(surveys)
    sizes = [model_error] * MODAL + [static_error, OF_READING * static_error] * bool(statics)
    usual = np.array(sizes + [damping_error] * places.moves_damping)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    found = find_most_probable(places, statics, Prior(mean, spread, usual))
    tests, first = found.tests, found.first
    return Refined(
        structure=structure,
        unknowns=tuple(unknowns),
        compared=tests.compared,
        statics=tests.statics,
        linear_at=found.x,
        estimate=found.estimate,
        before_hz=tuple(_before(*both) for both in zip(first.compared, tests.compared, strict=True)),
        before=tuple(tuple(old.value.tolist()) for old in first.statics),
        history=found.history,
        converged=found.converged,
        fields=found.fields,
        unseen=unseen_deviations(found.problem, found.estimate.tau, usual[: found.problem.sorts]),
        responses=tests.responses,
        damped=tests.damped,
    )


def compare_at_first(
    structure: Structure,
    surveys: Sequence[Survey],
    unknowns: Sequence[Unknown],
    statics: Sequence[StaticTest] = (),
) -> tuple[Compared | ComparedResponse | ComparedDamping | ComparedStatic, ...]:
    """Every test beside the model at the mean of the prior. Raises `ConfigError` as `refine`."""
    _check_names(surveys, statics, unknowns)
    places = place_tests(structure, surveys, statics, unknowns)
    refuse_repeated(surveys)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    tests = places.compare(places.solve(mean, places.moves_damping), statics, True)
    return tests._replace(responses=places.compare_responses(tests.compared, mean, np.diag(spread))).every


def _before(old: Compared, new: Compared) -> tuple[float, ...]:
    """Frequencies, before the refinement, of the modes paired with the measured ones; NaN without a pair."""
    hz = {j: float(old.modes.frequency_hz[i]) for i, j in old.pairs.tolist()}
    return tuple(hz.get(j, np.nan) for j in new.pairs[:, 1].tolist())


def problem_of(
    refined: Refined,
    compared: Sequence[Compared],
    statics: Sequence[ComparedStatic],
    fields: ErrorFields | None,
) -> Linear:
    """`linear_problem` of these tests about the unknowns at which ``refined`` was linearised."""
    mean, spread = (np.array([getattr(u, name) for u in refined.unknowns]) for name in ("mean", "spread"))
    at = refined.linear_at - mean
    return linear_problem(compared, statics, fields, at, spread, refined.responses, refined.damped)


def off_the_rest(refined: Refined) -> list[tuple[str, float]]:
    """Mean residual of ln f of each survey in the refined article, by name."""
    problem = problem_of(refined, refined.compared, refined.statics, refined.fields)
    left = problem.y - problem.J @ refined.estimate.x - problem.S @ refined.estimate.d
    first = np.cumsum([0, *(len(c.rows) for c in refined.compared)])
    return [
        (c.survey.name, float(np.mean(left[at : at + len(c.pairs)])))
        for c, at in zip(refined.compared, first, strict=False)
    ]


def _check_names(
    surveys: Sequence[Survey], statics: Sequence[StaticTest], unknowns: Sequence[Unknown]
) -> None:
    if not surveys and not statics:
        raise ConfigError("no survey and no static test", where="refinement", hint="at least one of them")
    if not unknowns:
        raise ConfigError("no unknown", where="refinement", hint="at least one")
    for what, given in (("survey", surveys), ("static test", statics), ("unknown", unknowns)):
        names = [g.name for g in given]
        twice = [n for n in names if names.count(n) > 1]
        if twice:
            raise ConfigError(f"the name {twice[0]!r} is given twice", where=what, hint="a name for each")
