"""The paper's account of Figures 4 to 7 and 9, on the data sheet's articles."""

import numpy as np
import pytest

from middeck.files.studies import load_study
from middeck.study.claims import figure_6_claims, figure_7_claims, figure_9_claims
from middeck.study.gravity import find_modes
from middeck.study.stages import run_stages
from middeck.study.zero_g_control import study_zero_g_control


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


def test_closed_form_rms_agrees_with_quadrature(outcomes):
    """The issue's 1e-10, on the loops of the study themselves."""
    assert all(sweep.quadrature_error < 1e-10 for _, sweep in outcomes["figure 7"].sweeps)


def test_closed_form_rms_agrees_with_quadrature_without_actuator_noise():
    """The filter of a noiseless actuator has poles that nearly coincide: where a pole sum fails first."""
    study = load_study("studies/mace-1993.toml", ["control.actuator_noise_ratio=0", "control.levels=5"])
    modes = {env: find_modes(*study.case("simple", env)) for env in ("orbit", "lab")}
    sweeps = study_zero_g_control(modes, study.control).sweeps
    assert all(sweep.quadrature_error < 1e-10 for _, sweep in sweeps)
