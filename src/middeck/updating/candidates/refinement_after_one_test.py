"""A refinement after one more test, computed before the test is made.

Rows of the new test are those that `refine` would make of it, about the most probable article; they bring no
news, only certainty. The model's own errors are as large as they are thought to be now: it is not known what
a test will say of that.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator, Sequence
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError, MiddeckError
from middeck.updating.candidates.candidate_survey import CandidateSurvey, measured_by
from middeck.updating.refinement.bayesian_estimate import Estimate, Linear, estimate_at
from middeck.updating.refinement.common_rests import common_rests, same_modes, same_readings
from middeck.updating.refinement.problem import MODAL
from middeck.updating.refinement.refine import OF_READING, USUAL_STATIC, Refined, problem_of
from middeck.updating.residuals.static_tests import (
    ErrorFields,
    StaticTest,
    compare_statics,
    set_up_statics,
)
from middeck.updating.residuals.surveys import Survey, compare, set_up
from middeck.values import record

# Deviations of a model's static errors, of what members yield and of a reading, where no test has shown them.
UNTRIED = (USUAL_STATIC, OF_READING * USUAL_STATIC)


@record(kw_only=True)
class Foreseen:
    """A refinement with one more test.

    Attributes:
        refined: The same most probable article, with its uncertainty after the test.
        unseen: Modes of the test's band that its channels do not see, by name and frequency [Hz].
    """

    refined: Refined
    unseen: tuple[tuple[str, float], ...] = ()


def foresee(refined: Refined, candidate: CandidateSurvey | StaticTest) -> Foreseen:
    """The refinement with the candidate's test; the values of a static test are not used.

    An error that rows of the candidate have alone in `refine`, but have in common with a test already made
    (of the same mixture of modes, of the same gauge under the same load), is known already, and not counted
    again.

    Raises `ConfigError` for a name that a test already has, a parameter, channel or gauge that is not there,
    and where no mode is seen; `NumericalError` where the article has no rest state.
    """
    with _about(candidate.name):
        _check_new(refined, candidate.name)
        if isinstance(candidate, StaticTest):
            return Foreseen(refined=_with_static(refined, candidate))
        return _with_survey(refined, candidate)


@contextmanager
def _about(name: str) -> Generator[None]:
    """Put the candidate before the place of an error."""
    try:
        yield
    except MiddeckError as error:
        own = f"candidate {name!r}"
        if not error.where.startswith(own):
            error.where = f"{own}, {error.where}" if error.where else own
        raise


def _check_new(refined: Refined, name: str) -> None:
    made = [c.survey.name for c in refined.compared] + [c.test.name for c in refined.statics]
    if name in made:
        raise ConfigError("a test of this name has been made", hint=f"another name than {', '.join(made)}")


def _with_survey(refined: Refined, candidate: CandidateSurvey) -> Foreseen:
    place = set_up(refined.structure, candidate.environment, candidate.settings, refined.unknowns)
    modes = place.solve(refined.x)
    measured, unseen = measured_by(candidate, modes)
    survey = Survey(
        name=candidate.name, measured=measured, environment=candidate.environment, settings=candidate.settings
    )
    new = compare(modes, survey, place.bound)
    compared = (*refined.compared, new)
    rows = sum(len(c.rows) for c in refined.compared) + np.arange(len(new.rows))
    problem = problem_of(refined, compared, refined.statics, refined.fields)
    known = _known_after(refined, problem, rows, same_modes(refined.compared, new))
    after = dataclasses.replace(
        refined,
        compared=compared,
        before_hz=(*refined.before_hz, tuple(measured.frequency_hz[new.pairs[:, 1]].tolist())),
        estimate=known,
    )
    return Foreseen(refined=after, unseen=unseen)


def _with_static(refined: Refined, candidate: StaticTest) -> Refined:
    tests = (*(c.test for c in refined.statics), candidate)
    places = set_up_statics(refined.structure, tests, refined.unknowns)
    at = [*(c.at for c in refined.statics), places[-1].solve(refined.x)]
    value = at[-1].value(candidate.gauges)
    tests = (*tests[:-1], dataclasses.replace(candidate, value=value))
    statics = compare_statics(at, tests, places)
    fields = ErrorFields.of(at)
    problem = problem_of(refined, refined.compared, statics, fields)
    rows = np.arange(len(problem.y) - len(value), len(problem.y))
    links = same_readings(statics, len(problem.y) - sum(len(c.value) for c in statics))
    return dataclasses.replace(
        refined,
        statics=statics,
        before=(*refined.before, tuple(value.tolist())),
        estimate=_known_after(refined, problem, rows, links),
        fields=fields,
        unseen=_with_untried(refined.unseen, problem.sorts),
    )


def _known_after(
    refined: Refined, problem: Linear, new: Int[np.ndarray, " new"], links: Sequence[tuple[int, int, float]]
) -> Estimate:
    """The estimate with ``new`` rows, which read what is most probable without them."""
    tau = _with_untried(refined.estimate.tau, problem.sorts)
    errors = len(problem.sort)
    problem = common_rests(problem, links)
    old = np.setdiff1d(np.arange(len(problem.y)), new)
    made = {name: getattr(problem, name)[old] for name in ("y", "std", "J", "S", "rest", "row_sort")}
    known = estimate_at(dataclasses.replace(problem, **made), tau)
    y = problem.y.copy()
    y[new] = problem.J[new] @ known.x + problem.S[new] @ known.d
    return _without_links(estimate_at(dataclasses.replace(problem, y=y), tau), errors)


def _with_untried(tau: Float[np.ndarray, " some"], sorts: int) -> Float[np.ndarray, " sort"]:
    """One for every sort, those of static tests too where none has been made."""
    return tau if len(tau) == sorts else np.insert(tau, MODAL, UNTRIED)


def _without_links(found: Estimate, errors: int) -> Estimate:
    """The estimate of the unknowns and of the first ``errors`` of the model's own."""
    _, upper = np.linalg.qr(found.root[: len(found.x) + errors].T)
    return dataclasses.replace(found, d=found.d[:errors], root=upper.T)
