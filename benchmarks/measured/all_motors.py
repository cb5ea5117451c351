"""Phase three: five motors and fourteen sensors in orbit, designed three ways and flown on one rig.

On the article as drawn, on the article refined in 1-g, and on a record of the rig in orbit under its PD
loops. The truths are those of the study's chapter, with friction, umbilical, limits and noise.
"""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from measured.kept import kept
from measured.rows import miss_row, row
from middeck.campaign.cases import Case
from middeck.control.law.compensator import Compensator
from middeck.files.promises.study_table import build_modal_test, build_plan
from middeck.files.studies.documents import Study, load_study
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.friction.find import find_friction
from middeck.identification.friction.remove import without_friction
from middeck.identification.spectra.estimate import estimate_response
from middeck.joints.friction import Friction
from middeck.laboratory.article_rig import build_rig_article
from middeck.laboratory.modal_test import take_modal_test
from middeck.laboratory.rig_settings import RigSettings
from middeck.laboratory.tested_article import RigArticle
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.study.chapters.promise.computation import MEASURED, SHEET, measured_ladder
from middeck.study.chapters.promise.flight import fly, launch
from middeck.study.chapters.promise.ground import run_ground_tests
from middeck.study.shared import find_modes
from middeck.updating.promise.plan import Ladder, Plan
from middeck.updating.promise.promise import design_ladder, promise
from middeck.updating.promise.stability_probability import probability_interval
from middeck.updating.refinement.bayesian_estimate import NORMAL_95
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.surveys import set_up

STUDY = Path(__file__).resolve().parents[2] / "studies" / "mace-1993.toml"
SEEDS = (1993, *range(14))
LOG10_AUTHORITY = np.array([0.0, 2.0, 4.0])
# The least and the most of 39 draws hold 95 % of others.
DRAWS = 39
# Of a joint without dry friction: nothing beside what moves it.
NO_SLIP_NM = 1e-12
LEAST_DB, ASKED_DB = -20.0, 3.0
# The record in orbit: from below the PD loops' corners at 0.03 Hz.
BAND_HZ, PERIOD_S, PERIODS = (0.03, 60.0), 32.0, 2
TORQUE_NM = np.array([0.05, 0.1, 0.1, 0.3, 0.3])
STATES = 40


class Came(NamedTuple):
    """One authority on one truth: decibels on the rig by each way, the promised levels, and CPU seconds."""

    sheet: float
    refined: float
    measured: float
    low: float
    median: float
    high: float
    seconds: float


def rows(options: Any) -> list[dict[str, Any]]:
    """Of all truths: the highest authority that both ways stabilise, and every authority."""
    of_truths = [[Came(*one) for one in truth] for truth in kept(motors_of_truth, len(SEEDS), options)]
    found = [c for truth in of_truths for c in truth]
    both = [[c for c in truth if np.isfinite((c.refined, c.measured)).all()] for truth in of_truths]
    top = [stable[-1] for stable in both]
    title = f"motors, 5 in and 14 out, {len(found)} authorities of {len(SEEDS)} truths"
    behind = [c.refined - c.measured for stable in both for c in stable]
    drawn = [c.sheet - c.measured for c in found]
    error = np.array([c.refined - c.median for c in found])
    stated = np.array([c.high - c.low for c in found]) / (2.0 * NORMAL_95)
    missed = [not c.low <= c.refined <= c.high for c in found]
    most = 100.0 * probability_interval(sum(missed), len(found), 0.9)[1]
    note = f"{sum(missed)} of {len(found)}: with 95 % confidence below {most:.0f} %"
    highest = "highest authority that both ways stabilise"
    return [
        row(title, f"{highest}: refined in 1-g, worst", "dB", max(c.refined for c in top), LEAST_DB),
        row(title, f"{highest}: on a 0-g record, worst", "dB", max(c.measured for c in top), LEAST_DB),
        row(title, "refined behind measured, largest", "dB", max(behind), ASKED_DB),
        row(title, "the same, median", "dB", np.median(behind)),
        row(title, "refined in 1-g, worst of all authorities", "dB", max(c.refined for c in found)),
        row(title, "designed on a 0-g record, unstable", "", _unstable(c.measured for c in found)),
        row(title, "as drawn, unstable", "", _unstable(c.sheet for c in found)),
        row(title, "as drawn behind measured, largest of the others", "dB", max(filter(np.isfinite, drawn))),
        row(title, "|promised median - rig|, median", "dB", np.median(abs(error)), 0.5),
        miss_row(title, "95 % intervals that miss", 100.0 * float(np.mean(missed)), note=note),
        row(title, "error over its stated deviation, rms", "", np.sqrt(np.mean((error / stated) ** 2))),
        row(title, "a truth with all of it", "CPU s", np.median([c.seconds for c in found])),
    ]  # fmt: skip


def _unstable(decibels: Iterable[float]) -> float:
    return float(np.sum(~np.isfinite(list(decibels))))


def motors_of_truth(truth: Case, _: Any) -> list[list[float]]:
    """Each authority's `Came`."""
    return [list(one) for one in _flown(SEEDS[truth.index])]


def _flown(seed: int) -> list[Came]:
    start = time.process_time()
    study, rng = load_study(STUDY), np.random.default_rng([seed, 514])
    settings = dataclasses.replace(study.rig, hidden_seed=seed)
    article, orbit = study.case(study.promise.article, "orbit")
    ground = run_ground_tests(study, settings, rng)
    asked = _plan(study, build_plan(
        study.promise, orbit, [t.friction for t in ground.tests], delay_s=settings.delay_s, seed=seed
    ))  # fmt: skip
    (promised,) = promise(ground.refined, asked).values()
    truth = build_rig_article(article, orbit, settings)
    refined = design_ladder(_in_orbit(ground.refined, asked), asked)
    laws = {
        **_named(SHEET, design_ladder(find_modes(article, orbit), asked)),
        **refined,
        **measured_ladder(_identified(study, truth, settings, asked, rng), asked),
    }
    came = _came(truth, study, settings, asked, laws)
    levels = {o.name: [o.level_db(s) for s in (0.025, 0.5, 0.975)] for o in promised.outlooks}
    seconds = time.process_time() - start
    for name, db in came.items():
        print(f"{seed} {name:20s} rig {db:7.2f} dB, promised {levels.get(name)}", flush=True)
    return [
        Came(came[SHEET.format(name)], came[name], came[MEASURED.format(name)], *levels[name], seconds)
        for name in refined
    ]


def _came(
    truth: RigArticle, study: Study, settings: RigSettings, asked: Plan, laws: Mapping[str, Compensator]
) -> dict[str, float]:
    """Decibels in orbit: exact ones with linear joints, and what friction adds on the rig under one noise.

    A flight alone errs by as much as its promise does: its record is short.
    """
    slippery = dataclasses.replace(
        settings,
        gimbal_elements=tuple(
            dataclasses.replace(e, slip_torque=NO_SLIP_NM) if isinstance(e, Friction) else e
            for e in settings.gimbal_elements
        ),
    )
    rigs = [
        launch(truth, study, each, asked, np.random.default_rng([asked.seed, 515]))
        for each in (settings, slippery)
    ]
    came: dict[str, float] = {}
    for name, law in laws.items():
        rubs, slips = (fly(rig, {name: law}, np.random.default_rng([asked.seed, 516]))[0] for rig in rigs)
        all_stable = rubs.db is not None and rubs.rig_db is not None and slips.rig_db is not None
        came[name] = rubs.db + rubs.rig_db - slips.rig_db if all_stable else np.inf
    return came


def _plan(study: Study, one_axis: Plan) -> Plan:
    """The study's plan for all motors, all angles and their rates, disturbed at both gimbals."""
    form, control = study.promise, study.control
    low, high = form.loop_band_hz
    return dataclasses.replace(
        one_axis,
        performance=control.metric,
        weights=np.array(control.metric_weights),
        disturbances=form.joints,
        intensity=np.full(len(form.joints), form.disturbance_nm / np.sqrt(2.0 * (high - low))),
        noise={"rad": control.angle_noise_rad_per_rthz, "rad/s": control.rate_noise_rad_per_s_per_rthz},
        draws=DRAWS,
        ladder=Ladder(
            drives=form.inputs,
            reads=(*control.angles, *(f"{name}{RATE}" for name in control.angles)),
            authority=10.0**LOG10_AUTHORITY,
        ),
    )


def _named(form: str, laws: Mapping[str, Compensator]) -> dict[str, Compensator]:
    return {form.format(name): law for name, law in laws.items()}


def _in_orbit(found: Refined, asked: Plan) -> Any:
    place = next(iter(asked.environments.values()))
    return set_up(found.structure, place, (), found.unknowns).solve(found.x)


def _identified(
    study: Study, truth: RigArticle, settings: RigSettings, asked: Plan, rng: np.random.Generator
) -> FitResult:
    """Fitted to a record under the PD loops, the gimbals' friction found in it and taken out."""
    assert asked.ladder is not None
    test = dataclasses.replace(
        build_modal_test(study.promise), outputs=asked.ladder.reads, torque_nm=TORQUE_NM, band_hz=BAND_HZ,
        period_s=PERIOD_S, periods=PERIODS,
    )  # fmt: skip
    taken = take_modal_test(truth, settings, test, rng, asked.inner)
    joints = [(name, name) for name in study.promise.joints]
    friction = find_friction(taken, joints, band_hz=BAND_HZ, delay_s=settings.delay_s)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        response = estimate_response(without_friction(taken, friction), band_hz=BAND_HZ)
    # Angles and rates alike fall with frequency, so that no noise passes the model.
    return fit_response(response, states=STATES, constants="complex", delay="common", relative_degree=1)
