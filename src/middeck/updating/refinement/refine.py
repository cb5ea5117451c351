"""Refine an article on tests on the ground, of modes and of sag: the most probable unknowns, what stays open.

Gauss-Newton on analytic slopes, the model's own errors found anew at every step (`posterior`): far from the
answer they are large, which keeps the steps small.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.article import Structure
from middeck.structure.modes.solve import Modes
from middeck.updating.refinement.mesh_and_shear import left_out
from middeck.updating.refinement.own_errors import OwnErrors, sorts_of
from middeck.updating.refinement.posterior import (
    KNOWN,
    USUAL,
    Estimate,
    Linear,
    cut_below,
    estimate,
    excess,
    unseen_deviations,
)
from middeck.updating.residuals.gauges import Gauge
from middeck.updating.residuals.pairing import pair
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import (
    ComparedStatic,
    ErrorFields,
    Loaded,
    StaticSetUp,
    StaticTest,
    compare_statics,
    gauge_key,
    set_up_static,
)
from middeck.updating.residuals.surveys import (
    Compared,
    SetUp,
    Survey,
    compare,
    compare_measured_response,
    set_up,
)
from middeck.updating.unknowns.loop_unknowns import LOOP, loop_slopes
from middeck.updating.unknowns.unknowns import ENVIRONMENT, Unknown
from middeck.values import record

# Modes that live of gravity and suspension, and flexible ones, have errors of their own; static tests one
# that they share as far as they strain the members alike, and one of each reading.
SORTS = ("suspension", "flexible", "static", "reading")
MODAL = 2
# What begins so is no parameter of the article.
ELSEWHERE = (ENVIRONMENT, LOOP)
# Relative errors of a beam model's sag and, over them, of each reading, that are thought likely before.
USUAL_STATIC, OF_READING = 0.02, 0.25
STEPS = 12
# A step is the last that moves no unknown by more than this part of its deviation: it leaves its square.
SMALL = 0.2
# No step moves an unknown by more than this many of its prior deviations.
LARGEST = 2.0
HALVINGS = 6
# Surveys whose frequencies are this many times farther from any one article than they state contradict.
CONTRADICT = 2.0
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
        responses: Of the surveys that have one, beside the model.
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

    @property
    def zeros(self) -> tuple[tuple[str, ...], ...]:
        """Unloaded readings: series and `gauge_key` of each."""
        return _zeros(self.statics)

    @property
    def sorts(self) -> tuple[str, ...]:
        """Of the model's own errors, one ``estimate.tau`` each."""
        return SORTS[: len(self.estimate.tau)]

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

    @property
    def factors(self) -> dict[str, float]:
        """Of the article's parameters by name, as the ``[factors]`` of its file take them.

        What is added, and what belongs to an environment or a loop, has no place there (`left_out`).
        """
        factors: dict[str, float] = {}
        for unknown, x in zip(self.unknowns, self.x, strict=True):
            if unknown in self.left_out:
                continue
            for name in unknown.parameters:
                factors[name] = factors.get(name, 1.0) * float(np.exp(x))
        return factors

    @property
    def left_out(self) -> tuple[Unknown, ...]:
        """Unknowns that ``factors`` of an article cannot hold."""
        return tuple(
            u for u in self.unknowns if u.added or any(n.startswith(ELSEWHERE) for n in u.parameters)
        )


def refine(
    structure: Structure,
    surveys: Sequence[Survey],
    unknowns: Sequence[Unknown],
    model_error: float = USUAL,
    statics: Sequence[StaticTest] = (),
    static_error: float = USUAL_STATIC,
) -> Refined:
    """The most probable unknowns. ``structure`` is the article as drawn, whatever they are.

    ``model_error`` is what the frequencies of a model of this sort are thought to be wrong by, in parts of
    one, whatever its numbers, ``static_error`` what its members yield: what the tests show takes their place,
    the less the fewer there are.

    Raises `ConfigError` for no test, an unknown that no test has, names given twice, or a survey without
    any mode in common; `NumericalError` where the article has no rest state at the mean of the prior.
    """
    _check_names(surveys, statics, unknowns)
    places = _places(structure, surveys, statics, unknowns)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    usual = np.array([model_error] * MODAL + [static_error, OF_READING * static_error] * bool(statics))
    x, history, pace, last = mean.copy(), [], 1.0, np.zeros(len(mean))
    at = first = places.solve(x)
    # A response is nearly linear in what is left when the modes have settled, and not before.
    settled, measured, open_x = False, any(s.response is not None for s in surveys), np.diag(spread)
    while True:
        compared, sagged = places.compare(at, surveys, statics)
        heard = places.hear(compared, x, open_x) if settled else ()
        fields = ErrorFields.of(at.loaded) if at.loaded else None
        problem = linear_problem(compared, sagged, fields, x - mean, spread, heard)
        found = estimate(problem, usual)
        # Else a step far out is the answer: slopes by measured frequencies differ as these contradict.
        while (off := excess(problem, found, _rows_of_several(compared, len(problem.y)))) > CONTRADICT:
            compared = tuple(_widened(c, off) for c in compared)
            problem = linear_problem(compared, sagged, fields, x - mean, spread, heard)
            found = estimate(problem, usual)
        step = mean + found.x - x
        history.append(float(np.max(np.abs(step) / found.x_std, initial=0.0)))
        if history[-1] < SMALL or len(history) >= STEPS * (1 + settled):
            if settled or not measured:
                break
            settled, pace, last, open_x = True, 1.0, np.zeros(len(mean)), found.root[: len(x)]
            continue
        size, pace = step / spread, _pace(pace, step / spread, last)
        x, at = _moved(places, x, step * min(pace, LARGEST / np.max(np.abs(size))))
        last = size
    return Refined(
        structure=structure,
        unknowns=tuple(unknowns),
        compared=compared,
        statics=sagged,
        linear_at=x,
        estimate=found,
        before_hz=tuple(_before(old, c) for old, c in zip(first.modes, compared, strict=True)),
        before=tuple(
            tuple(old.value(t.gauges).tolist()) for old, t in zip(first.loaded, statics, strict=True)
        ),
        history=tuple(history),
        converged=history[-1] < SMALL,
        fields=fields,
        unseen=unseen_deviations(problem, found.tau, usual),
        responses=heard,
    )


def compare_at_first(
    structure: Structure,
    surveys: Sequence[Survey],
    unknowns: Sequence[Unknown],
    statics: Sequence[StaticTest] = (),
) -> tuple[Compared | ComparedResponse | ComparedStatic, ...]:
    """Every test beside the model at the mean of the prior. Raises `ConfigError` as `refine`."""
    _check_names(surveys, statics, unknowns)
    places = _places(structure, surveys, statics, unknowns)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    compared, sagged = places.compare(places.solve(mean), surveys, statics)
    return (*compared, *places.hear(compared, mean, np.diag(spread)), *sagged)


def _rows_of_several(compared: Sequence[Compared], count: int) -> np.ndarray:
    """Which of so many rows of `linear_problem` are frequencies that another survey may contradict."""
    own = [np.arange(len(c.rows)) < len(c.pairs) * (len(compared) > 1) for c in compared]
    return np.concatenate([*own, np.zeros(count - sum(map(len, own)), dtype=bool)])


def _widened(compared: Compared, by: float) -> Compared:
    """With deviations of its frequencies so many times larger."""
    own = np.arange(len(compared.rows)) < len(compared.pairs)
    return dataclasses.replace(compared, std=np.where(own, by, 1.0) * compared.std)


def _before(old: Modes, compared: Compared) -> tuple[float, ...]:
    """Of the modes that the measured ones were at first; where one was none, not a number."""
    hz = dict.fromkeys(compared.pairs[:, 1].tolist(), np.nan)
    hz |= {j: old.frequency_hz[i] for i, j in pair(old, compared.survey.measured).tolist() if j in hz}
    return tuple(hz[j] for j in compared.pairs[:, 1].tolist())


class _At(NamedTuple):
    """The article as every test had it, at some unknowns."""

    modes: list[Modes]
    loaded: list[Loaded]


class _Places(NamedTuple):
    """The set-ups of the surveys and of the static tests."""

    surveyed: list[SetUp]
    loaded: list[StaticSetUp]

    def solve(self, x: np.ndarray) -> _At:
        return _At([place.solve(x) for place in self.surveyed], [place.solve(x) for place in self.loaded])

    def compare(
        self, at: _At, surveys: Sequence[Survey], statics: Sequence[StaticTest]
    ) -> tuple[tuple[Compared, ...], tuple[ComparedStatic, ...]]:
        return (
            tuple(compare(m, s, p.bound) for m, s, p in zip(at.modes, surveys, self.surveyed, strict=True)),
            compare_statics(at.loaded, statics, self.loaded),
        )

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
    loaded = [
        set_up_static(structure, t.environment, t.settings, t.load_case, t.since_unloaded, unknowns)
        for t in statics
    ]
    for k, unknown in enumerate(unknowns):
        heard = [s.response.ports for s in surveys if s.response is not None]
        in_loop = any(loop_slopes([unknown.parameters], *ports).any[0] for ports in heard)
        if not in_loop and not any(place.bound[k].parameters for place in (*surveyed, *loaded)):
            raise ConfigError(
                f"no article, environment or loop under test has a parameter {', '.join(unknown.parameters)}",
                where=f"unknown {unknown.name!r}",
                hint="`middeck sensitivity` lists the parameters; those of a loop need a measured response",
            )
    return _Places(surveyed, loaded)


def _pace(pace: float, step: np.ndarray, last: np.ndarray) -> float:
    """Half of it for steps that swing, twice of it, up to one, for others.

    Both in deviations of the prior: those of the answer shrink with the model's errors on the way there.
    """
    swings = step @ last < 0.0 and np.linalg.norm(step) > SHRINKS * np.linalg.norm(last)
    return 0.5 * pace if swings else min(1.0, 2.0 * pace)


def _moved(places: _Places, x: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, _At]:
    """A step, shorter where the article has no rest state at its end."""
    for _ in range(HALVINGS):
        try:
            return x + step, places.solve(x + step)
        except NumericalError:
            step = 0.5 * step
    raise NumericalError(
        "the article has no equilibrium at the values towards which the refinement moves the unknowns",
        where="refinement",
        hint="narrower spreads, or fewer unknowns",
    )


class _Errors(NamedTuple):
    """Of the model, in rows: what each shares of errors (`Linear.S`) and their sorts."""

    S: np.ndarray
    rest: np.ndarray
    sort: np.ndarray
    row_sort: np.ndarray


def linear_problem(
    compared: Sequence[Compared],
    statics: Sequence[ComparedStatic],
    fields: ErrorFields | None,
    from_mean: np.ndarray,
    spread: np.ndarray,
    responses: Sequence[ComparedResponse] = (),
) -> Linear:
    """The tests as one linear problem about the present unknowns."""
    tests = (*compared, *responses, *statics)
    J = np.vstack([c.slope for c in tests])
    parts = [_of_modes(compared)] if compared else []
    parts += [_of_responses(sum(len(r.residual) for r in responses))] if responses else []
    parts += [] if fields is None else [_of_statics(statics, fields)]
    return Linear(
        y=np.concatenate([c.residual for c in tests]) + J @ from_mean,
        std=np.concatenate([c.std for c in tests]),
        J=J,
        spread=spread,
        S=np.asarray(sla.block_diag(*(p.S for p in parts))),
        rest=np.concatenate([p.rest for p in parts]),
        sort=np.concatenate([p.sort for p in parts]),
        row_sort=np.concatenate([p.row_sort for p in parts]),
        sorts=len(SORTS) if statics else MODAL,
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
    return linear_problem(compared, statics, fields, at, spread, refined.responses)


def off_the_rest(refined: Refined) -> list[tuple[str, float]]:
    """Of each survey by name, the mean of what the refined article leaves of ln f."""
    problem = problem_of(refined, refined.compared, refined.statics, refined.fields)
    left = problem.y - problem.J @ refined.estimate.x - problem.S @ refined.estimate.d
    first = np.cumsum([0, *(len(c.rows) for c in refined.compared)])
    return [
        (c.survey.name, float(np.mean(left[at : at + len(c.pairs)])))
        for c, at in zip(refined.compared, first, strict=False)
    ]


def _of_modes(compared: Sequence[Compared]) -> _Errors:
    errors = OwnErrors.of(compared)
    own = [np.arange(len(c.rows)) < len(c.pairs) for c in compared]
    S = np.vstack(
        [
            np.where(mine[:, None], errors.shared_with(c.modes)[c.rows[:, 1]], 0.0)
            for c, mine in zip(compared, own, strict=True)
        ]
    )
    return _Errors(
        np.column_stack([np.concatenate([_of_mesh_and_shear(c) for c in compared]), S]),
        np.maximum(1.0 - np.sum(S**2, axis=1), 0.0),
        np.append(KNOWN, errors.sorts(compared)),
        np.concatenate([sorts_of(c.modes, c.rows[:, 1]) for c in compared]),
    )


def _of_mesh_and_shear(compared: Compared) -> np.ndarray:
    """What more elements and shear would change in each row."""
    own, (of, place) = compared.pairs[:, 0], compared.rows.T
    index, at = np.unique(np.append(own, place), return_inverse=True)
    k = at[: len(own)][of]
    return left_out(compared.modes, index)[at[len(own) :], k] / (2.0 * compared.modes.omega[own[of]] ** 2)


def _of_responses(rows: int) -> _Errors:
    """None: what a response errs by is stated, and in its rows."""
    return _Errors(np.zeros((rows, 0)), np.zeros(rows), np.zeros(0, dtype=int), np.zeros(rows, dtype=int))


def _of_statics(statics: Sequence[ComparedStatic], fields: ErrorFields) -> _Errors:
    by_fields = np.vstack([fields.slope(c.at, c.test.gauges)[0] / c.scale[:, None] for c in statics])
    zeros = _zeros(statics)
    by_zeros = np.zeros((len(by_fields), len(zeros)))
    rows = [(c, gauge) for c in statics for gauge in c.test.gauges]
    for row, (c, gauge) in enumerate(rows):
        if c.test.since_unloaded:
            by_zeros[row, zeros.index(zero_of(c.test, gauge))] = -1.0
    static, reading = SORTS.index("static"), SORTS.index("reading")
    sort = np.repeat([static, reading], [by_fields.shape[1], len(zeros)])
    return _Errors(np.hstack([by_fields, by_zeros]), np.ones(len(rows)), sort, np.full(len(rows), reading))


def _zeros(statics: Sequence[ComparedStatic]) -> tuple[tuple[str, ...], ...]:
    counted = [c.test for c in statics if c.test.since_unloaded]
    return tuple(dict.fromkeys(zero_of(test, gauge) for test in counted for gauge in test.gauges))


def zero_of(test: StaticTest, gauge: Gauge) -> tuple[str, ...]:
    """The unloaded reading from which a gauge counts in a test."""
    return test.series or test.name, *gauge_key(gauge)


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
