"""A fitted record as a modal survey: a linear rig's true modes, and what is left out or refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import rig_case
import updating_case as case

import middeck as md
from middeck import estimate_response, fit_response
from middeck.errors import ConfigError, DataError
from middeck.files.measured.models import write_model
from middeck.files.refinements.documents import load_survey_modes
from middeck.identification import FitResult
from middeck.identification.model.measurement_model import damping_ratio
from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.measured_modes import MeasuredModes, measure_modes, sensor_rows
from middeck.structure.model.article import Sensor, SensorKind, Structure
from middeck.structure.modes.solve import Modes
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import refine
from middeck.updating.residuals.fitted_survey import survey_from_fit
from middeck.updating.residuals.pairing import pair
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown

SEED = 0
# Uniform within 2 %.
GAIN_STD = 0.02 / np.sqrt(3.0)


@pytest.fixture(scope="module")
def turned() -> Modes:
    """The truth in the laboratory, its gimbals turned, so that no sensor axis is one of the world's."""
    return case.true_modes(SEED, case.sheet()[1], case.TURNED)


@pytest.fixture(scope="module")
def fit() -> FitResult:
    article = case.true_article(SEED, case.sheet()[1], case.TURNED)
    record = rig_case.take_records(article, np.random.default_rng(3), friction=None, weaker=0, period_s=32.0)
    measured = estimate_response(record, band_hz=(0.8, 30.0))
    return fit_response(measured, states=30, delay="common", direct=True)


@pytest.fixture(scope="module")
def survey(fit: FitResult) -> MeasuredModes:
    return survey_from_fit(case.sheet()[0], fit, gain_std=GAIN_STD)


def test_a_linear_rig_has_its_true_modes_within_three_deviations(survey: MeasuredModes, turned: Modes):
    pairs = pair(turned, survey)
    assert len(pairs) == len(survey.frequency_hz) >= 12
    assert survey.frequency_std_hz is not None
    off = (survey.frequency_hz[pairs[:, 1]] - turned.frequency_hz[pairs[:, 0]]) / survey.frequency_std_hz[
        pairs[:, 1]
    ]
    np.testing.assert_array_less(np.abs(off), 3.0)
    assert np.max(survey.frequency_std_hz / survey.frequency_hz) < 1e-3


def test_its_shapes_are_the_true_ones_within_their_deviations(survey: MeasuredModes, turned: Modes):
    """At sensors, whose gains are wrong by up to 2 %, and at motors, by reciprocity."""
    assert survey.node == (*rig_case.OUTPUTS, *rig_case.INPUTS)
    assert survey.direction == (*("sensor",) * 7, *("actuator",) * 5)
    true = np.asarray(sensor_rows(turned, survey.node, survey.direction) @ turned.shapes)
    pairs = pair(turned, survey)
    assurance = modal_assurance(true[:, pairs[:, 0]], survey.shape[:, pairs[:, 1]])
    assert np.min(np.diag(assurance)) > 0.999
    assert survey.shape_std is not None
    for i, j in pairs:
        phi, seen, std = true[:, i], np.real(survey.shape[:, j]), survey.shape_std[:, j]
        weighted = phi / std
        scale = (weighted @ (seen / std)) / (weighted @ weighted)
        assert np.max(np.abs(seen - scale * phi) / std) < 4.0


def test_a_sensor_channel_is_that_motion(turned: Modes):
    """On an article that gravity does not bend the same rows as rotations in the world and joint angles."""
    modes = md.solve_modes(md.solve_equilibrium(case.sheet()[0], md.Environment.orbit()))
    ports = sensor_rows(
        modes,
        ("bus_y", "pri_in_z", "pri_rel_x", "bus_y", "pri_rel_x"),
        ("sensor", "sensor", "sensor", "actuator", "actuator"),
    )
    world = sensor_rows(modes, ("n3", "pri_z", "pri_x", "n3", "pri_x"), ("ry", "rz", "angle", "ry", "angle"))
    np.testing.assert_allclose(ports @ modes.shapes, world @ modes.shapes, rtol=0.0, atol=1e-12)
    seen = measure_modes(turned, [("pri_in_x", "sensor"), ("n1", "x")])
    assert seen.channels == ("pri_in_x sensor", "n1 x")
    with pytest.raises(ConfigError, match="reads no displacement"):
        sensor_rows(turned, ("pri_in_x_rate",), ("sensor",))
    with pytest.raises(ConfigError, match="no actuator"):
        sensor_rows(turned, ("elbow",), ("actuator",))


def test_doubtful_modes_are_left_out_by_name(fit: FitResult, survey: MeasuredModes):
    order = np.argsort(np.abs(fit.model.poles))
    lowest = int(order[np.flatnonzero(np.array(fit.standing)[order] == "sound")[0]])
    doubted = tuple("doubtful" if m == lowest else s for m, s in enumerate(fit.standing))
    less = survey_from_fit(case.sheet()[0], dataclasses.replace(fit, standing=doubted))
    np.testing.assert_array_equal(less.frequency_hz, survey.frequency_hz[1:])
    assert any("is doubtful: left out" in warning for warning in less.warnings)
    none = dataclasses.replace(fit, standing=("doubtful",) * len(fit.standing))
    with pytest.raises(DataError, match="no mode to be sure of"):
        survey_from_fit(case.sheet()[0], none)


def test_ports_and_models_that_are_no_survey_are_refused(fit: FitResult):
    article, _ = case.sheet()

    def ported(**change: object) -> Structure:
        return dataclasses.replace(article, **change)

    with pytest.raises(ConfigError, match="no sensor 'pri_rel_z'"):
        survey_from_fit(ported(sensors=article.sensors[:-1]), fit)
    with pytest.raises(ConfigError, match="no actuator 'bus_x'"):
        survey_from_fit(ported(actuators=article.actuators[1:]), fit)
    tilting = Sensor(name="bus_x", frame="n3", axis=np.eye(3)[0], kind=SensorKind.ACCELEROMETER)
    with pytest.raises(ConfigError, match="reads gravity"):
        survey_from_fit(ported(sensors=(tilting, *article.sensors[1:])), fit)
    with pytest.raises(ConfigError, match="gain_std"):
        survey_from_fit(article, fit, gain_std=2.0)
    sampled = dataclasses.replace(fit.model, sample_hz=100.0)
    with pytest.raises(DataError, match="sampled model"):
        survey_from_fit(article, dataclasses.replace(fit.covariance, model=sampled))


def test_it_is_refined_and_what_was_left_out_is_reported(survey: MeasuredModes):
    """One unknown is refined; modes of other frequencies are not paired."""
    article, lab = case.sheet()
    modulus = Unknown(name="E", parameters=("members.E",), spread=0.1)
    placed = Survey(name="rig", measured=survey, environment=lab, settings=case.TURNED)
    found = refine(article, [placed], [modulus])
    assert found.converged
    assert len(found.compared[0].pairs) >= 12
    assert any(warning.startswith("rig: the pole at") for warning in findings(found))
    far = dataclasses.replace(survey, frequency_hz=1e-3 * survey.frequency_hz)
    with pytest.raises(ConfigError, match="no measured mode resembles"):
        refine(article, [dataclasses.replace(placed, measured=far)], [modulus])


def test_a_model_file_is_a_survey(fit: FitResult, tmp_path: Path):
    file, article = tmp_path / "model.json", case.ROOT / "articles/mace-dm.toml"
    write_model(file, fit.model, fit.covariance, fit.standing)
    seen, known = load_survey_modes(file, article), survey_from_fit(case.sheet()[0], fit)
    np.testing.assert_allclose(seen.frequency_hz, known.frequency_hz, rtol=1e-12)
    np.testing.assert_allclose(seen.shape, known.shape, rtol=1e-9, atol=1e-12)
    assert seen.frequency_std_hz is not None
    assert known.frequency_std_hz is not None
    np.testing.assert_allclose(seen.frequency_std_hz, known.frequency_std_hz, rtol=1e-6)
    np.testing.assert_allclose(seen.damping, damping_ratio(fit.model)[np.isin(fit.standing, "sound")])
    write_model(file, fit.model)
    with pytest.raises(DataError, match="has no covariance"):
        load_survey_modes(file, article)
    text = file.read_text()
    write_model(file, fit.model, fit.covariance, fit.standing)
    file.write_text(file.read_text().replace('"sound"', '"splendid"'))
    with pytest.raises(DataError, match="standing is no list"):
        load_survey_modes(file, article)
    assert "standing" not in text
