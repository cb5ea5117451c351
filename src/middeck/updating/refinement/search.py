"""The search for the most probable unknowns of a refinement, repeated where its end is doubtful.

Gauss-Newton on analytic slopes, the model's own errors found anew at every step (`bayesian_estimate`): far
from the optimum they are large, which keeps the steps small. Where they are so large that no step seems to
help, or where modes are paired wrongly on the way, the search ends short of the optimum. An end with errors
larger than anyone thought likely is compared, by its likelihood, with that of a search that first takes the
model for right and, where frequencies alone say which mode is which, with those of others from elsewhere,
until two of these come to the likeliest end.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.article import Structure
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes
from middeck.updating.refinement.bayesian_estimate import FACTOR, Estimate, Linear, estimate_at, unlikely
from middeck.updating.refinement.contradictions import Tests, estimate_of
from middeck.updating.refinement.problem import linear_problem
from middeck.updating.residuals.damping_rows import (
    ComparedDamping,
    compare_with_damping,
    moves_losses,
    solve_damped_near,
    states_damping,
)
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import (
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
)
from middeck.updating.unknowns.unknowns import Unknown, loop_slopes
from middeck.values import record

STEPS = 12
# A step is the last that moves no unknown by more than this part of its deviation: it leaves its square.
SMALL = 0.2
# No step moves an unknown by more than this many of its prior deviations.
LARGEST = 2.0
HALVINGS = 6
# Steps back that are not this much smaller than the last swing about the optimum.
SHRINKS = 0.7
# Deviations of the model's errors, of what was thought before, beyond which the end of a search is doubtful.
DOUBTFUL = 3.0
# Draws of the prior from which a search without shapes begins again; two that agree are enough.
STARTS = 8


class Prior(NamedTuple):
    """Mean and deviations of the unknowns; the ``usual`` deviation of each sort of model error."""

    mean: np.ndarray
    spread: np.ndarray
    usual: np.ndarray


@record(kw_only=True)
class RefinementEnd:
    """The end of a search: the tests there, the unknowns ``x`` at which they are linear, and the estimate.

    ``first`` are the tests at the start, ``stated`` deviations of rows as the tests state them, which surveys
    that contradict one another have widened, ``history`` is that of `Refined`.
    """

    first: Tests
    tests: Tests
    x: np.ndarray
    problem: Linear
    estimate: Estimate
    fields: ErrorFields | None
    history: tuple[float, ...]
    stated: np.ndarray

    @property
    def converged(self) -> bool:
        """Whether the last step was small."""
        return self.history[-1] < SMALL

    def doubtful(self, usual: np.ndarray) -> bool:
        """Whether the search may have stopped short of the optimum: see the module."""
        much = self.estimate.tau > FACTOR**DOUBTFUL * usual[: self.problem.sorts]
        return bool(np.any(much) or np.any(self.stated < self.problem.std)) or not self.converged

    def unlikely(self, usual: np.ndarray) -> float:
        """Minus the logarithm of the posterior, of rows that other pairs have as well.

        A measured mode without a pair may have any frequency in a factor of e.
        """
        tau = self.estimate.tau
        before = 0.5 * np.sum((np.log(tau / usual[: len(tau)]) / np.log(FACTOR)) ** 2)
        return _unlikely_in(self.problem, self._in_all_pairs, tau) + float(before)

    def if_it_fitted(self, usual: np.ndarray) -> float:
        """`unlikely` for a model as accurate as its prior that fits every row as stated."""
        fitted = dataclasses.replace(self.problem, y=np.zeros(len(self.stated)), std=self.stated)
        return _unlikely_in(fitted, self._in_all_pairs, usual[: self.problem.sorts])

    @property
    def _in_all_pairs(self) -> np.ndarray:
        every = self.tests.every
        own = [len(t.pairs) if isinstance(t, Compared) else len(t.residual) for t in every]
        return np.concatenate(
            [np.arange(len(t.residual)) < count for t, count in zip(every, own, strict=True)]
        )


def _unlikely_in(problem: Linear, some: np.ndarray, tau: np.ndarray) -> float:
    """Minus the logarithm of the likelihood of ``some`` rows."""
    names = ("y", "std", "J", "S", "rest", "row_sort")
    part = dataclasses.replace(problem, **{name: getattr(problem, name)[some] for name in names})
    return float(unlikely(part, tau)) + 0.5 * float(np.log(2.0 * np.pi)) * int(np.sum(some))


def find_most_probable(places: TestSetups, statics: Sequence[StaticTest], prior: Prior) -> RefinementEnd:
    """End of the search from the mean of the prior or, if doubtful, the likelier of two.

    Raises `NumericalError` where the article has no rest state at the mean of the prior, and where both
    searches end at values of no article.
    """
    try:
        at = places.solve(prior.mean, places.moves_damping)
    except NumericalError as error:
        error.where = ", ".join(filter(None, (error.where, "at the means of the unknowns")))
        advice = "means, or an article as drawn, with a rest state in this test"
        error.hint = "; ".join(filter(None, (advice, error.hint)))
        raise
    found, why = None, None
    try:
        found = _search(places, statics, prior, at)
    except NumericalError as error:
        why = error
    if found is not None and not found.doubtful(prior.usual):
        return found
    ends = [found] if found is not None else []
    drawn: list[RefinementEnd] = []
    for k, start in enumerate(_starts(places, prior, at)):
        try:
            settled = _as_if_right(places, statics, prior, start, _reach(ends, prior.usual))
            ends.append(_search(places, statics, prior, settled))
        except (ConfigError, NumericalError):
            continue
        drawn += ends[-1:] if k else []
        if not ends[-1].doubtful(prior.usual) or _came_back(_likeliest(ends, prior.usual), drawn):
            break
    if not ends:
        assert why is not None
        raise why
    best = _likeliest(ends, prior.usual)
    return dataclasses.replace(
        best, first=places.compare(at, statics, False) if found is None else found.first
    )


def _likeliest(ends: Sequence[RefinementEnd], usual: np.ndarray) -> RefinementEnd:
    return min(ends, key=lambda end: (not end.converged, end.unlikely(usual)))


def _reach(ends: Sequence[RefinementEnd], usual: np.ndarray) -> float:
    """Prior deviations beyond which no end is likelier than the best of ``ends``, however well it fits."""
    if not ends:
        return np.inf
    best = _likeliest(ends, usual)
    return float(np.sqrt(2.0 * max(0.0, best.unlikely(usual) - best.if_it_fitted(usual))))


def _came_back(best: RefinementEnd, drawn: Sequence[RefinementEnd]) -> bool:
    """Whether two starts that were drawn by themselves led to ``best``."""
    near = [bool(np.all(np.abs(end.x - best.x) < SMALL * best.estimate.x_std)) for end in drawn]
    return best.converged and sum(near) > 1


def _starts(places: TestSetups, prior: Prior, at: SolvedSetups) -> Iterator[SolvedSetups]:
    """``at`` and, where a survey has no shapes, draws of the prior of which there is an article."""
    yield at
    if all(s.measured.node for s in places.surveys):
        return
    draws = np.random.default_rng(STARTS).standard_normal((STARTS, len(prior.mean)))
    for draw in draws:
        try:
            yield places.solve(prior.mean + prior.spread * draw, places.moves_damping)
        except (ConfigError, NumericalError):
            continue


def _search(
    places: TestSetups, statics: Sequence[StaticTest], prior: Prior, at: SolvedSetups
) -> RefinementEnd:
    """Search from ``at``."""
    mean, spread, usual = prior
    lossy = places.moves_damping
    x, history, pace, last, first = at.x, [], 1.0, np.zeros(len(mean)), None
    # Responses and damping are nearly linear in what is left when the modes have settled, and not before.
    settled, open_x = False, np.diag(spread)
    measured = lossy or any(s.response is not None for s in places.surveys)
    while True:
        asked = places.compare(at, statics, settled)
        first = first or asked
        asked = asked._replace(
            responses=places.compare_responses(asked.compared, x, open_x) if settled else ()
        )
        fields = ErrorFields.of(at.loaded) if at.loaded else None
        tests, problem, found = estimate_of(asked, fields, x - mean, spread, usual)
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
    stated = np.concatenate([t.std for t in asked.every])
    return RefinementEnd(
        first=first,
        tests=tests,
        x=x,
        problem=problem,
        estimate=found,
        fields=fields,
        history=tuple(history),
        stated=stated,
    )


def _as_if_right(
    places: TestSetups, statics: Sequence[StaticTest], prior: Prior, at: SolvedSetups, reach: float
) -> SolvedSetups:
    """The end of a search in which the model's errors are as thought before, whatever the tests show.

    Raises `NumericalError` where it leads farther from the prior than ``reach`` of its deviations.
    """
    mean, spread, usual = prior
    pace, last = 1.0, np.zeros(len(mean))
    for _ in range(STEPS):
        tests = places.compare(at, statics, False)
        fields = ErrorFields.of(at.loaded) if at.loaded else None
        problem = linear_problem(tests.compared, tests.statics, fields, at.x - mean, spread, (), tests.damped)
        found = estimate_at(problem, usual[: problem.sorts])
        step = mean + found.x - at.x
        if np.max(np.abs(step) / found.x_std, initial=0.0) < SMALL:
            break
        size, pace = step / spread, _pace(pace, step / spread, last)
        _, at = _moved(places, at.x, step * min(pace, LARGEST / np.max(np.abs(size))), places.moves_damping)
        if np.linalg.norm((at.x - mean) / spread) > reach:
            raise NumericalError("a search led where no end is likely", hint="another start")
        last = size
    return at


class SolvedSetups(NamedTuple):
    """The article in each test at the unknowns ``x``; complex modes where damping is refined."""

    x: np.ndarray
    modes: list[Modes]
    loaded: list[Loaded]
    damped: list[DampedModes | None]


def _solve(place: SetUp, survey: Survey, x: np.ndarray) -> Modes:
    """The modes of a survey's article. Raises `NumericalError` that names the survey."""
    try:
        return place.solve(x)
    except NumericalError as error:
        error.where = ", ".join(filter(None, (f"survey {survey.name!r}", error.where)))
        raise


class TestSetups(NamedTuple):
    """The set-ups of the surveys and of the static tests."""

    surveyed: list[SetUp]
    loaded: list[StaticSetUp]
    surveys: tuple[Survey, ...]

    @property
    def moves_damping(self) -> bool:
        """Whether an unknown moves damping. Raises `ConfigError` where no survey measured any."""
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

    def solve(self, x: np.ndarray, lossy: bool) -> SolvedSetups:
        """Every set-up at the unknowns ``x``, its complex modes too where ``lossy``."""
        modes = [_solve(*both, x) for both in zip(self.surveyed, self.surveys, strict=True)]
        damped = [
            solve_damped_near(m, s) if lossy and (states_damping(s) or s.friction) else None
            for m, s in zip(modes, self.surveys, strict=True)
        ]
        return SolvedSetups(x, modes, solve_statics(self.loaded, x), damped)

    def compare(self, at: SolvedSetups, statics: Sequence[StaticTest], settled: bool) -> Tests:
        """Tests beside the model: damping too, as far as ``at`` has it, where the modes have ``settled``."""
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

    def compare_responses(
        self, compared: Sequence[Compared], x: np.ndarray, open_x: np.ndarray
    ) -> tuple[ComparedResponse, ...]:
        """Responses beside the model at the unknowns ``x``; ``open_x`` is a root of their covariance."""
        return tuple(
            compare_measured_response(c, place.bound, x, open_x)
            for c, place in zip(compared, self.surveyed, strict=True)
            if c.survey.response is not None
        )


def place_tests(
    structure: Structure,
    surveys: Sequence[Survey],
    statics: Sequence[StaticTest],
    unknowns: Sequence[Unknown],
) -> TestSetups:
    """The set-ups of all tests.

    Raises `ConfigError` for an unknown that no test has, and for two sizes of the friction of one joint.
    """
    surveyed = [s.set_up(structure, unknowns) for s in surveys]
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
        responses = [s.response.ports for s in surveys if s.response is not None]
        rubbed = [f for s in surveys for f in s.friction]
        elsewhere = any(loop_slopes([unknown.parameters], *ports).any[0] for ports in responses) or any(
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
    return TestSetups(surveyed, loaded, tuple(surveys))


def _pace(pace: float, step: np.ndarray, last: np.ndarray) -> float:
    """Half of it for steps that swing, twice of it, up to one, for others.

    Both in deviations of the prior: those of the optimum shrink with the model's errors on the way there.
    """
    swings = step @ last < 0.0 and np.linalg.norm(step) > SHRINKS * np.linalg.norm(last)
    return 0.5 * pace if swings else min(1.0, 2.0 * pace)


def _moved(
    places: TestSetups, x: np.ndarray, step: np.ndarray, lossy: bool
) -> tuple[np.ndarray, SolvedSetups]:
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
