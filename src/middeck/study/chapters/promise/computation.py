"""From ground test to orbit: test, refine, take gravity out, promise; then fly, and compare."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from middeck.control.analysis.stability.stability import LoopStability, decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.lqg.design import LQGCompensator, design_lqg
from middeck.errors import NumericalError
from middeck.files.promises.outcomes import name_of, name_of_mode, statements_of
from middeck.files.promises.promise_documents import promised_there
from middeck.files.promises.study_table import build_plan
from middeck.files.studies.documents import Study
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.spectra.estimate import estimate_response
from middeck.laboratory.article_rig import build_rig_article, linear_plant
from middeck.laboratory.rig_settings import RigSettings
from middeck.laboratory.tested_article import RigArticle
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.modes.solve import Modes
from middeck.study.chapters.promise.flight import Flown, fly, launch
from middeck.study.chapters.promise.ground import KnownBefore, run_ground_tests
from middeck.study.shared import find_modes
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.updating.promise.plan import Plan, weights_of
from middeck.updating.promise.promise import Promise, design_ladder, design_on, promise
from middeck.updating.promise.score import Score, Scored, Verdict, judge, score
from middeck.updating.promise.stability_probability import LEVELS
from middeck.updating.residuals.pairing import pair
from middeck.updating.residuals.surveys import set_up
from middeck.values import record

FLEXIBLE = 10  # frequencies that are judged together
SHEET = "{}, nominal"
MEASURED = "{}, measured"


@record(kw_only=True)
class GroundLaw:
    """A compensator for all motors and sensors, designed on the ground test alone, and its stability there
    and in orbit."""

    log10_authority: float
    lab: LoopStability
    orbit: LoopStability


@record(kw_only=True)
class FlexibleHz:
    """The first flexible modes in orbit [Hz], paired by shape: true, refined and of the sheet."""

    true_hz: Float[np.ndarray, " mode"]
    refined_hz: Float[np.ndarray, " mode"]
    sheet_hz: Float[np.ndarray, " mode"]


@record(kw_only=True)
class PromiseKept:
    """The promise before flight, and its outcome.

    Attributes:
        there: The part of the promise's document on orbit.
        outcomes, verdicts, score: Frequencies of the article, decibels measured on the rig.
        flown: Compensators of the sheet, of the refined article, and of a record taken in orbit.
        measured: The fit to that record.
        ground_law: Why gravity cannot be taken out of a measurement.
    """

    ground: KnownBefore
    plan: Plan
    promise: Promise
    there: dict[str, Any]
    frequencies: FlexibleHz
    outcomes: tuple[Scored, ...]
    verdicts: tuple[Verdict, ...]
    score: Score
    flown: tuple[Flown, ...]
    measured: FitResult
    ground_law: GroundLaw


def compute(study: Study, rng: np.random.Generator) -> PromiseKept:
    """The whole chain; the article in orbit is used by `fly` and the comparison alone."""
    form = study.promise
    settings = dataclasses.replace(study.rig, hidden_seed=form.hidden_seed)
    article, orbit = study.case(form.article, "orbit")
    ground = run_ground_tests(study, settings, rng)
    found = [one.friction for one in ground.tests]
    plan = build_plan(form, orbit, found, delay_s=settings.delay_s, seed=study.seed)
    sheet = find_modes(article, orbit)
    given = {SHEET.format(name): law for name, law in design_ladder(sheet, plan).items()}
    plan = dataclasses.replace(plan, laws=given)
    (promised,) = promise(ground.refined, plan).values()
    there = promised_there("orbit", promised, plan)

    refined = set_up(ground.refined.structure, orbit, (), ground.refined.unknowns).solve(ground.refined.x)
    truth = build_rig_article(article, orbit, settings)
    above = launch(truth, study, settings, plan, rng)
    response = estimate_response(above.without, band_hz=form.loop_band_hz)
    fit = fit_response(response, states=form.flight_states, cost="logarithmic")
    ladder = design_ladder(refined, plan)
    by_record, without = _by_record(fit, plan, ladder)
    laws: dict[str, Compensator] = {**given, **ladder, **by_record}
    flown = (*fly(above, laws, rng), *without)
    statements = statements_of({"shares": LEVELS, "environments": [there]})
    outcomes = _outcomes(promised, truth.modes, flown)
    verdicts = judge(statements, outcomes)
    return PromiseKept(
        ground=ground,
        plan=plan,
        promise=promised,
        there=there,
        frequencies=_frequencies(promised, sheet, truth.modes),
        outcomes=tuple(outcomes),
        verdicts=verdicts,
        score=score(verdicts),
        flown=flown,
        measured=fit,
        ground_law=_ground_law(study, ground.tests[0].fit, plan, settings, truth),
    )


def measured_ladder(fit: FitResult, plan: Plan) -> dict[str, LQGCompensator]:
    """The plan's ladder designed on a record from orbit."""
    assert plan.ladder is not None
    ports = {"w": plan.disturbances, "u": plan.ladder.drives, "z": plan.performance, "y": plan.ladder.reads}
    delayed = measured_plant(_falling(fit.model), **ports)
    return {MEASURED.format(name): law for name, law in design_on(delayed, plan.ladder, plan).items()}


def _by_record(
    fit: FitResult, plan: Plan, names: Iterable[str]
) -> tuple[dict[str, LQGCompensator], tuple[Flown, ...]]:
    """The ladder on a record from orbit; where the fit allows no design, what stands for each of it."""
    try:
        return measured_ladder(fit, plan), ()
    except NumericalError as error:
        cause = str(error)
    lost = [Flown(name=MEASURED.format(name), db=None, rig_db=None, cause=cause) for name in names]
    return {}, tuple(lost)


def _falling(model: MeasurementModel) -> MeasurementModel:
    """The model without its constant, which stands for modes above the band: it would pass all noise."""
    return dataclasses.replace(model, direct=np.zeros_like(model.direct))


def _true_pairs(modes: Modes, truth: Modes, kept: Int[np.ndarray, " mode"]) -> dict[int, float]:
    """The truth's frequency [Hz] of each of ``kept``, by shape."""
    flexible = [i for i, kind in enumerate(truth.kind) if kind == "flexible"]
    seen = measure_modes(truth, chosen=flexible[: len(kept)])
    return {int(i): float(seen.frequency_hz[j]) for i, j in pair(modes, seen) if i in kept}


def _frequencies(promised: Promise, sheet: Modes, truth: Modes) -> FlexibleHz:
    found = promised.modes
    chosen = [i for i in found.index.tolist() if found.modes.kind[i] == "flexible"][:FLEXIBLE]
    true = _true_pairs(found.modes, truth, np.array(chosen))
    by_sheet = {hz: sheet.frequency_hz[i] for i, hz in _true_pairs(sheet, truth, found.index).items()}
    hz = dict(zip(found.index.tolist(), found.frequency_hz.tolist(), strict=True))
    both = [i for i in chosen if i in true and true[i] in by_sheet]
    return FlexibleHz(
        true_hz=np.array([true[i] for i in both]),
        refined_hz=np.array([hz[i] for i in both]),
        sheet_hz=np.array([by_sheet[true[i]] for i in both]),
    )


def _outcomes(promised: Promise, truth: Modes, flown: tuple[Flown, ...]) -> list[Scored]:
    """Outcomes of what was promised: modes that can be paired, and compensators."""
    named, index = {o.name for o in promised.outlooks}, promised.modes.index
    true = _true_pairs(promised.modes.modes, truth, index)
    modes = [
        Scored(kind="mode", name=name_of_mode("orbit", number), value=true[i])
        for number, i in enumerate(index.tolist(), start=1)
        if i in true
    ]
    loops = [
        Scored(
            kind="compensator",
            name=name_of("orbit", one.name),
            value=one.rig_db,
            stable=one.stable,
        )
        for one in flown
        if one.name in named
    ]
    return [*modes, *loops]


def _ground_law(
    study: Study, fit: FitResult, plan: Plan, settings: RigSettings, truth: RigArticle
) -> GroundLaw:
    """LQG for all motors and sensors on the fit of the first ground test, there and in orbit."""
    form = study.promise
    groups = {"w": (form.actuator,), "u": form.inputs, "z": (form.sensor,), "y": form.outputs}
    delayed = measured_plant(_falling(fit.model), **groups)
    plant = approximate_delays(delayed, approximation_order(delayed))
    weights = weights_of(plan, plant.inputs, plant.outputs)
    law = design_lqg(plant, weights, 10.0**form.ground_log10_authority)
    ports = form.inputs, form.outputs
    lab = build_rig_article(*study.case(form.article, form.environment), settings)
    return GroundLaw(
        log10_authority=form.ground_log10_authority,
        lab=decide_stability(linear_plant(lab, settings, *ports, None), law),
        orbit=decide_stability(linear_plant(truth, settings, *ports, plan.inner), law),
    )
