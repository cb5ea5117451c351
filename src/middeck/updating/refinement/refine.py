"""Refine an article on tests on the ground, of modes and of sag: the most probable unknowns, what stays open.

Gauss-Newton on analytic slopes, the model's own errors found anew at every step
(`bayesian_estimate`): far from the answer they are large, which keeps the steps small.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.article import Structure
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes
from middeck.updating.refinement.bayesian_estimate import (
    USUAL,
    Estimate,
    Linear,
    cut_below,
    unseen_deviations,
)
from middeck.updating.refinement.contradictions import Tests, estimate_of
from middeck.updating.refinement.curvature import frequency_curvature
from middeck.updating.refinement.problem import MODAL, linear_problem, sort_names, zeros_of
from middeck.updating.residuals.damping import (
    ComparedDamping,
    compare_with_damping,
    moves_losses,
    solve_damped_near,
    states_damping,
)
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import (
    ComparedStatic,
    ErrorFields,
    Loaded,
    StaticSetUp,
    StaticTest,
    compare_statics,
    set_up_statics,
    solve_statics,
)
from middeck.updating.residuals.surveys import (
    Compared,
    SetUp,
    Survey,
    compare,
    compare_measured_response,
    set_up,
)
from middeck.updating.unknowns.unknowns import ENVIRONMENT, FRICTION, LOOP, Unknown, loop_slopes
from middeck.values import record

# What begins so is no parameter of the article.
ELSEWHERE = (ENVIRONMENT, LOOP, FRICTION)
# Relative errors of a beam model's sag and, over them, of each reading, that are thought likely before.
USUAL_STATIC, OF_READING = 0.02, 0.25
# Usual error of ln zeta that loss factors and dampers give a mode.
USUAL_DAMPING = 0.2
STEPS = 12
# A step is the last that moves no unknown by more than this part of its deviation: it leaves its square.
SMALL = 0.2
# No step moves an unknown by more than this many of its prior deviations.
LARGEST = 2.0
HALVINGS = 6
# Steps back that are not this much smaller than the last swing about the answer.
SHRINKS = 0.7


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
        before: What gauges of each static test read of the mean of the prior.
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
        """How much of `left_out` the surveys show, and its deviation; without any none."""
        at = len(self.unknowns)
        found = self.estimate
        return (float(found.d[0]), float(np.linalg.norm(found.root[at]))) if self.compared else (0.0, 0.0)

    def with_shear(self, n: Float[np.ndarray, " both"]) -> Float[np.ndarray, " both"]:
        """``n``, numbers of the estimate's root, moved off negative shear as by `cut_below`."""
        return cut_below(n, self.estimate.root[len(self.unknowns)], self.shear[0]) if self.compared else n

    def drawn_at(self, n: Float[np.ndarray, " both"]) -> tuple[Float[np.ndarray, " unknown"], float]:
        """Unknowns, and how much of `left_out`, at standard normal numbers of the estimate's root."""
        off, at = self.estimate.root @ n, len(self.unknowns)
        return self.x + off[:at], self.shear[0] + float(off[at]) if self.compared else 0.0

    @functools.cached_property
    def bent_tests(self) -> tuple[Float[np.ndarray, "mode unknown unknown"], ...]:
        """Second derivatives of ln f of the modes of each survey's pairs; all predictions need them."""
        found = []
        for one in self.compared:
            place, settings = one.survey.environment, one.survey.settings
            bound = set_up(self.structure, place, settings, self.unknowns).bound
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
        """Unknowns that ``factors`` of an article cannot hold."""
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

    Raises `ConfigError` for no test, an unknown that no test has, names given twice, or a survey without
    any mode in common, and as `compare_with_damping`; `NumericalError` where the article has no rest state at
    the mean of the prior.
    """
    _check_names(surveys, statics, unknowns)
    places = _places(structure, surveys, statics, unknowns)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    lossy = places.moves_damping
    sizes = [model_error] * MODAL + [static_error, OF_READING * static_error] * bool(statics)
    usual = np.array(sizes + [damping_error] * lossy)
    x, history, pace, last = mean.copy(), [], 1.0, np.zeros(len(mean))
    at, first = places.solve(x, lossy), ()
    # Responses and damping are nearly linear in what is left when the modes have settled, and not before.
    settled, open_x = False, np.diag(spread)
    measured = lossy or any(s.response is not None for s in surveys)
    while True:
        tests = places.compare(at, statics, settled)
        first = first or (tests.compared, at.loaded)
        heard = places.hear(tests.compared, x, open_x) if settled else ()
        fields = ErrorFields.of(at.loaded) if at.loaded else None
        tests, problem, found = estimate_of(tests._replace(heard=heard), fields, x - mean, spread, usual)
        step = mean + found.x - x
        history.append(float(np.max(np.abs(step) / found.x_std, initial=0.0)))
        if history[-1] < SMALL or len(history) >= STEPS * (1 + settled):
            if settled or not measured:
                break
            settled, pace, last, open_x = True, 1.0, np.zeros(len(mean)), found.root[: len(x)]
            continue
        size, pace = step / spread, _pace(pace, step / spread, last)
        x, at = _moved(places, x, step * min(pace, LARGEST / np.max(np.abs(size))), lossy)
        last = size
    return Refined(
        structure=structure,
        unknowns=tuple(unknowns),
        compared=tests.compared,
        statics=tests.statics,
        linear_at=x,
        estimate=found,
        before_hz=tuple(_before(*both) for both in zip(first[0], tests.compared, strict=True)),
        before=tuple(tuple(old.value(t.gauges).tolist()) for old, t in zip(first[1], statics, strict=True)),
        history=tuple(history),
        converged=history[-1] < SMALL,
        fields=fields,
        unseen=unseen_deviations(problem, found.tau, usual[: problem.sorts]),
        responses=heard,
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
    places = _places(structure, surveys, statics, unknowns)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    tests = places.compare(places.solve(mean, places.moves_damping), statics, True)
    return tests._replace(heard=places.hear(tests.compared, mean, np.diag(spread))).every


def _before(old: Compared, new: Compared) -> tuple[float, ...]:
    """Frequencies, before the refinement, of the modes paired with the measured ones; NaN without a pair."""
    hz = {j: float(old.modes.frequency_hz[i]) for i, j in old.pairs.tolist()}
    return tuple(hz.get(j, np.nan) for j in new.pairs[:, 1].tolist())


class _At(NamedTuple):
    """The article as every test had it, at the unknowns ``x``; complex modes where damping is refined."""

    x: np.ndarray
    modes: list[Modes]
    loaded: list[Loaded]
    damped: list[DampedModes | None]


class _Places(NamedTuple):
    """The set-ups of the surveys and of the static tests."""

    surveyed: list[SetUp]
    loaded: list[StaticSetUp]
    surveys: tuple[Survey, ...]

    @property
    def moves_damping(self) -> bool:
        """Whether an unknown does. Raises `ConfigError` where no survey has anything to tell of it."""
        both = zip(self.surveys, self.surveyed, strict=True)
        if not any(moves_losses(survey, place.bound) for survey, place in both):
            return False
        if not any(states_damping(s) or s.friction or s.response is not None for s in self.surveys):
            raise ConfigError(
                "an unknown moves damping, and no survey states a damping ratio",
                where="refinement",
                hint="damping with the modes of a survey, or no unknown of damping",
            )
        return True

    def solve(self, x: np.ndarray, lossy: bool) -> _At:
        """Every set-up at the unknowns ``x``, its complex modes too where ``lossy``."""
        modes = [place.solve(x) for place in self.surveyed]
        damped = [
            solve_damped_near(m, s) if lossy and (states_damping(s) or s.friction) else None
            for m, s in zip(modes, self.surveys, strict=True)
        ]
        return _At(x, modes, solve_statics(self.loaded, x), damped)

    def compare(self, at: _At, statics: Sequence[StaticTest], settled: bool) -> Tests:
        """Damping, as far as ``at`` has any, where the modes have ``settled``."""
        compared: list[Compared] = []
        lossy: list[ComparedDamping] = []
        for place, survey, modes, damped in zip(
            self.surveyed, self.surveys, at.modes, at.damped, strict=True
        ):
            if damped is None or not (settled or survey.friction):
                compared.append(compare(modes, survey, place.bound))
            else:
                frequencies, ratios = compare_with_damping(modes, damped, survey, place.bound, at.x)
                compared.append(frequencies)
                lossy.append(ratios)
        return Tests(tuple(compared), (), tuple(lossy), compare_statics(at.loaded, statics, self.loaded))

    def hear(
        self, compared: Sequence[Compared], x: np.ndarray, open_x: np.ndarray
    ) -> tuple[ComparedResponse, ...]:
        """Responses beside the model at the unknowns ``x``, of whose covariance ``open_x`` is a root."""
        return tuple(
            compare_measured_response(c, place.bound, x, open_x)
            for c, place in zip(compared, self.surveyed, strict=True)
            if c.survey.response is not None
        )


def _places(
    structure: Structure,
    surveys: Sequence[Survey],
    statics: Sequence[StaticTest],
    unknowns: Sequence[Unknown],
) -> _Places:
    surveyed = [set_up(structure, s.environment, s.settings, unknowns) for s in surveys]
    loaded = set_up_statics(structure, statics, unknowns)
    stated: dict[str, tuple[float, float]] = {}
    for friction in (f for s in surveys for f in s.friction):
        sizes = friction.slip_torque, friction.slip_angle
        if stated.setdefault(friction.joint, sizes) != sizes:
            raise ConfigError(
                f"surveys state two slip torques or slip angles of joint {friction.joint!r}",
                where="friction",
                hint="one joint has one; what it may be is the spread of an unknown",
            )
    for k, unknown in enumerate(unknowns):
        heard = [s.response.ports for s in surveys if s.response is not None]
        rubbed = [f for s in surveys for f in s.friction]
        elsewhere = any(loop_slopes([unknown.parameters], *ports).any[0] for ports in heard) or any(
            np.any(friction.moved_by([unknown.parameters])) for friction in rubbed
        )
        places = (*surveyed, *(place.loaded for place in loaded))
        if not elsewhere and not any(place.bound[k].parameters for place in places):
            raise ConfigError(
                f"no article, environment or loop under test has a parameter {', '.join(unknown.parameters)}",
                where=f"unknown {unknown.name!r}",
                hint="`middeck sensitivity` lists the parameters; those of a loop need a measured response, "
                "those of friction a survey that states a joint's friction and amplitudes",
            )
    return _Places(surveyed, loaded, tuple(surveys))


def _pace(pace: float, step: np.ndarray, last: np.ndarray) -> float:
    """Half of it for steps that swing, twice of it, up to one, for others.

    Both in deviations of the prior: those of the answer shrink with the model's errors on the way there.
    """
    swings = step @ last < 0.0 and np.linalg.norm(step) > SHRINKS * np.linalg.norm(last)
    return 0.5 * pace if swings else min(1.0, 2.0 * pace)


def _moved(places: _Places, x: np.ndarray, step: np.ndarray, lossy: bool) -> tuple[np.ndarray, _At]:
    """A step, shorter where the article has no rest state at its end, or damping ratios that cannot be."""
    why = ""
    for _ in range(HALVINGS):
        try:
            return x + step, places.solve(x + step, lossy)
        except (ConfigError, NumericalError) as error:
            step, why = 0.5 * step, error.what
    raise NumericalError(
        f"there is no such article at the values towards which the refinement moves the unknowns: {why}",
        where="refinement",
        hint="narrower spreads, or fewer unknowns",
    )


def problem_of(
    refined: Refined,
    compared: Sequence[Compared],
    statics: Sequence[ComparedStatic],
    fields: ErrorFields | None,
) -> Linear:
    """`linear_problem` of these tests about the unknowns at which ``refined`` has its own."""
    mean, spread = (np.array([getattr(u, name) for u in refined.unknowns]) for name in ("mean", "spread"))
    at = refined.linear_at - mean
    return linear_problem(compared, statics, fields, at, spread, refined.responses, refined.damped)


def off_the_rest(refined: Refined) -> list[tuple[str, float]]:
    """Each survey by name, with the mean residual of ln f in the refined article."""
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
