"""The paper's account of Figures 4 to 7, 9 and 10, on the data sheet's articles."""

import numpy as np
import pytest

from middeck.files.studies import load_study
from middeck.identification.measurement_model import model_response
from middeck.identification.plants.plant_model import model_of_plant
from middeck.identification.plants.zeros import path_zeros
from middeck.study.claims import figure_6_claims, figure_7_claims, figure_9_claims, figure_10_claims
from middeck.study.gravity import find_modes
from middeck.study.rig_experiment import rig_plant
from middeck.study.stages import run_stages
from middeck.study.zero_g_control import study_zero_g_control
from middeck.systems.response import evaluate_plant


@pytest.fixture(scope="module")
def outcomes():
    study = load_study("studies/mace-1993.toml")
    return {name: run() for name, run in run_stages(study) if name != "mirror"}


def test_figure_4_rigid_modes_become_bounce_tilt_and_pendulum(outcomes):
    comparison = outcomes["figures 4 and 5"]
    assert comparison.orbit.kind[:10] == ("rigid",) * 10
    assert comparison.lab.kind[:10] == ("suspension",) * 10
    words = " ".join(comparison.lab.name[:10])
    assert all(word in words for word in ("bounce", "tilt", "pendulum"))


def test_figure_4_flexible_modes_are_variably_stiffened_and_destiffened(outcomes):
    ratio = outcomes["figures 4 and 5"].ratio
    assert np.any(ratio > 1.01)
    assert np.any(ratio < 0.9995)


def test_figure_5_rigid_block_is_coupled_and_flexible_modes_in_pairs_at_most(outcomes):
    comparison = outcomes["figures 4 and 5"]
    matrix = comparison.cross_orthogonality
    low, high = matrix[:10, :10], matrix[10:, 10:]
    assert np.count_nonzero(low > 0.1) > 20  # far from a diagonal of ten
    # "largely limited to couplings between pairs": at most one partner above 0.1 beside the mode itself.
    assert np.all(np.count_nonzero(high > 0.1, axis=1) <= 2)


def test_figure_6_claims_hold(outcomes):
    assert all(row["holds"] for row in figure_6_claims(outcomes["figure 6"]))


def test_figure_7_claims_hold_but_for_the_missed_target(outcomes):
    """The paper misses its 40 dB target too (36 dB); every other claim holds."""
    rows = figure_7_claims(outcomes["figure 7"])
    failed = [row["claim"] for row in rows if not row["holds"]]
    assert failed == ["0-g reaches the 40 dB target at the top level [dB]"]


def test_figure_9_claims_hold(outcomes):
    assert all(row["holds"] for row in figure_9_claims(outcomes["figure 9"]))


def test_figure_9a_delay_is_the_rigs(outcomes):
    """Ten states and no bias: the residual's own correlation is in the stated deviation (four of them)."""
    fit = outcomes["figure 9"].fit
    assert abs(fit.model.delay_s[0] - 0.010) < 4.0 * fit.uncertainty.delay_s[0]
    assert fit.uncertainty.delay_s[0] < 1e-4


def test_figure_10_claims_hold(outcomes):
    assert all(row["holds"] for row in figure_10_claims(outcomes["figure 10"]))


def test_figure_10b_zeros_are_the_articles(outcomes):
    """The bus angle's zeros of the right half-plane, against those of the modes that the rig was built of."""
    sensors = outcomes["figure 10"]
    study = load_study("studies/mace-1993.toml")
    modes = find_modes(*study.case(study.siso.article, study.siso.environment))
    article = model_of_plant(rig_plant(modes, study.siso.actuator, study.sito.sensors))
    truth = path_zeros(article, study.sito.sensors[1], study.siso.actuator)
    found = sensors.sensors[2]
    wrong = found.zeros.is_nonminimum_phase
    true_hz = truth.frequency_hz[truth.is_nonminimum_phase]
    assert len(true_hz) == wrong.sum() == 2
    # Four standard deviations of each: a false alarm in 1e4 studies.
    off = np.abs(found.zeros.frequency_hz[wrong] - true_hz)
    assert np.all(off < 4.0 * found.frequency_deviation_hz[wrong])
    assert off[0] < 0.02
    # Payload and encoder: every zero of the article is in the left half-plane.
    for sensor in (study.siso.sensor, study.sito.sensors[0]):
        whole = model_of_plant(rig_plant(modes, study.siso.actuator, (sensor,)))
        assert not path_zeros(whole, sensor, study.siso.actuator).is_nonminimum_phase.any()


def test_figure_10_plant_has_the_papers_ports(outcomes):
    """One torque that disturbs and controls, the payload to be kept still, encoder and bus fed back."""
    sensors = outcomes["figure 10"]
    plant = sensors.plant
    assert (plant.w, plant.u, plant.z, plant.y) == (
        ("pri_rel_z",), ("pri_rel_z",), ("pri_in_z",), ("pri_rel_z", "bus_z")
    )  # fmt: skip
    f = np.geomspace(0.1, 20.0, 300)
    # Pade 3 errs by (omega tau)^7 / 100800: 5e-5 at 20 Hz and 10 ms.
    np.testing.assert_allclose(evaluate_plant(plant, f).H, model_response(sensors.fit.model, f), rtol=1e-4)


def test_closed_form_rms_agrees_with_quadrature(outcomes):
    """The issue's 1e-10, on the loops of the study themselves."""
    assert all(sweep.quadrature_error < 1e-10 for _, sweep in outcomes["figure 7"].sweeps)


def test_closed_form_rms_agrees_with_quadrature_without_actuator_noise():
    """The filter of a noiseless actuator has poles that nearly coincide: where a pole sum fails first."""
    study = load_study("studies/mace-1993.toml", ["control.actuator_noise_ratio=0", "control.levels=5"])
    modes = {env: find_modes(*study.case("simple", env)) for env in ("orbit", "lab")}
    sweeps = study_zero_g_control(modes, study.control).sweeps
    assert all(sweep.quadrature_error < 1e-10 for _, sweep in sweeps)
