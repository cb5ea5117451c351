"""Before flight: ground tests on the rig, friction out, modes found, the article refined by them."""

import warnings
from collections.abc import Sequence

import numpy as np

from middeck.files.promises.study_table import build_modal_test
from middeck.files.refinements.documents import build_unknown
from middeck.files.studies.documents import Study
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.friction.find import JointFriction, find_friction
from middeck.identification.friction.remove import without_friction
from middeck.identification.spectra.estimate import estimate_response
from middeck.laboratory.article_rig import build_rig_article
from middeck.laboratory.modal_test import take_modal_test
from middeck.laboratory.rig_settings import RigSettings
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from middeck.systems.plants.response import FrequencyResponse
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.fitted_survey import survey_from_fit
from middeck.updating.residuals.surveys import Survey
from middeck.values import record


@record(kw_only=True)
class GroundTest:
    """One set-up: friction of the joints, the fit behind it, and the modes that are certain."""

    friction: JointFriction
    fit: FitResult
    survey: Survey


@record(kw_only=True)
class KnownBefore:
    """Knowledge before flight: ground tests and the refined article."""

    tests: tuple[GroundTest, ...]
    refined: Refined


def run_ground_tests(study: Study, settings: RigSettings, rng: np.random.Generator) -> KnownBefore:
    """Test every set-up on the rig in the laboratory, and refine the article by the results."""
    form = study.promise
    article, _ = study.case(form.article, form.environment)
    tests = tuple(_tested(study, one.name, tuple(one.set.items()), settings, rng) for one in form.test)
    unknowns = [build_unknown(u) for u in form.unknown]
    return KnownBefore(tests=tests, refined=refine(article, [t.survey for t in tests], unknowns))


def _tested(
    study: Study,
    name: str,
    as_set: tuple[tuple[str, float], ...],
    settings: RigSettings,
    rng: np.random.Generator,
) -> GroundTest:
    form = study.promise
    article, lab = study.case(form.article, form.environment)
    there = build_rig_article(*_placed(article, lab, as_set), settings)
    taken = take_modal_test(there, settings, build_modal_test(form), rng)
    joints = [(joint, joint) for joint in form.joints]
    friction = find_friction(taken, joints, band_hz=form.band_hz, delay_s=settings.delay_s)
    with warnings.catch_warnings():  # free motions that are not over: the variance holds them
        warnings.simplefilter("ignore", UserWarning)
        response = estimate_response(without_friction(taken, friction), band_hz=form.band_hz)
    fit = _fit(response, form.states)
    seen = survey_from_fit(article, fit, gain_std=form.gain_std)
    survey = Survey(name=name, measured=seen, environment=lab, settings=as_set)
    return GroundTest(friction=friction, fit=fit, survey=survey)


def _placed(
    article: Structure, lab: Environment, as_set: tuple[tuple[str, float], ...]
) -> tuple[Structure, Environment]:
    both = article, lab
    for name, value in as_set:
        both = set_parameter(*both, find_parameters(*both, [name])[0], value)
    return both


def _fit(response: FrequencyResponse, states: Sequence[int]) -> FitResult:
    """The first fit that is sure of a mode, or the last: one that misses a mode makes all uncertain."""
    fit = _without_poles_beyond(response, states[0])
    if fit.standing.count("sound") or len(states) == 1:
        return fit
    return _fit(response, states[1:])


def _without_poles_beyond(response: FrequencyResponse, states: int) -> FitResult:
    """A fit with so many states, less those of poles beyond the band if that loses no mode.

    The constant stands for what is there; poles and constant together may be large and cancel.
    """
    # Dampers at joints make the modes complex; all paths have the same delay.
    fit = fit_response(response, states=states, constants="complex", delay="common")
    beyond = fit.standing.count("outside")
    if not beyond:
        return fit
    leaner = fit_response(response, states=states - 2 * beyond, constants="complex", delay="common")
    return leaner if leaner.standing.count("sound") >= fit.standing.count("sound") else fit
