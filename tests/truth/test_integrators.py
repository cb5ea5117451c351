"""Single poles at zero: a wheel seen by its rate, from a response to a plant and to a file."""

import numpy as np
import pytest
import scipy.signal
from pole_zero_form import response_of_form

from middeck.errors import ConfigError
from middeck.files.measured.models import load_fitted, write_model
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import MeasurementModel, model_response, natural_hz
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.pole_zero_gain import pole_zero_gain
from middeck.identification.record_fit.simulate_record import simulate_record
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse, evaluate_plant

INPUTS = (Port("torque", "N m"), Port("force", "N"))
OUTPUTS = (Port("wheel", "rad/s"), Port("bus", "rad/s"))
F = np.arange(0.2, 20.0, 0.05)
HZ = np.array([3.0, 9.0])
W = 2.0 * np.pi * HZ
POLES = -0.01 * W + 1j * W * np.sqrt(1.0 - 1e-4)
# The rate of a mode: phi psi s / (s^2 + ...).
C = POLES / (2j * POLES.imag) * np.array([[1.0, 0.8], [-0.3, 0.6]])
PSI = np.array([[1.0, 0.4], [0.7, -0.5]])
Q = {1: 8.0 * np.outer([1.0, -0.2], [0.9, 0.5]), 2: np.array([[8.0, 1.0], [-2.0, 4.0]])}


def truth(rank=1):
    none = np.zeros((2, 2))
    return MeasurementModel(
        poles=POLES,
        shapes=C,
        participation=PSI,
        direct=none,
        lower=none,
        delay_s=np.zeros(2),
        inputs=INPUTS,
        outputs=OUTPUTS,
        integral=Q[rank],
    )


def measured(rank=1, deviation=0.0, seed=0):
    H = model_response(truth(rank), F)
    re, im = np.random.default_rng(seed).standard_normal((2, *H.shape)) / np.sqrt(2.0)
    size = deviation * np.sqrt(np.mean(np.abs(H) ** 2))
    variance = np.full(H.shape, size**2) if deviation else None
    return FrequencyResponse(
        frequency_hz=F, H=H + size * (re + 1j * im), inputs=INPUTS, outputs=OUTPUTS, variance=variance
    )


@pytest.mark.parametrize("rank", [1, 2])
def test_exact_data_give_the_integrators_back(rank):
    fitted = fit_response(measured(rank), states=4 + rank, integrators=rank, direct=False)
    assert fitted.model.states == 4 + rank
    # Weights follow the residual down for a few rounds only: far below any noise, not to rounding.
    np.testing.assert_allclose(np.sort(natural_hz(fitted.model)), HZ, rtol=1e-7)
    np.testing.assert_allclose(fitted.model.integral, Q[rank], atol=1e-5)
    assert np.linalg.matrix_rank(fitted.model.integral, rtol=1e-9) == rank


def test_stated_deviations_of_the_integrators_are_those_of_repeated_tests(campaign):
    z = []
    for seed in campaign(60):
        fitted = fit_response(measured(2, 1e-3, seed), states=6, integrators=2, direct=False)
        p = parameters_of(fitted.covariance)
        at = [k for k, name in enumerate(p.names) if name.startswith("integral[")]
        z += list((p.values[at] - Q[2].ravel()) / p.deviation[at])
    # n unit normals: their mean square is known to sqrt(2 / n); four of those.
    assert abs(np.mean(np.square(z)) - 1.0) < 4.0 * np.sqrt(2.0 / len(z))


def test_the_order_and_its_reason_count_the_integrator():
    fitted = fit_response(measured(1, 1e-3), integrators=1)
    assert fitted.model.states == 5
    assert "1 more are at zero" in fitted.order_reason


@pytest.mark.parametrize("rank", [1, 2])
def test_the_plant_has_its_pole_exactly_at_zero(rank):
    plant = measured_plant(truth(rank), u=["torque", "force"], y=["wheel", "bus"])
    poles = np.linalg.eigvals(plant.system.A)
    assert np.sum(poles == 0.0) == rank
    assert len(poles) == 4 + rank
    assert plant.state_names[-rank:] == tuple(f"integrator {k + 1}" for k in range(rank))
    # Rounding of states near a pole.
    np.testing.assert_allclose(
        evaluate_plant(plant, F).H, model_response(truth(rank), F), rtol=1e-9, atol=1e-9
    )


def test_a_file_keeps_the_integrators_and_their_covariance(tmp_path):
    fitted = fit_response(measured(1, 1e-3), states=5, integrators=1, direct=False)
    write_model(tmp_path / "wheel.json", fitted.model, fitted.covariance)
    model, covariance = load_fitted(tmp_path / "wheel.json")
    assert model == fitted.model
    np.testing.assert_array_equal(covariance.matrix, fitted.covariance.matrix)


def test_poles_and_zeros_of_a_path_hold_the_integrator():
    form = pole_zero_gain(truth(), "wheel", "torque")
    assert np.sum(form.poles == 0.0) == 1
    assert form.static_gain is None
    np.testing.assert_allclose(response_of_form(form, F), model_response(truth(), F)[:, 0, 0], rtol=1e-8)


@pytest.mark.parametrize("delay_s", [0.0, 0.013])
def test_held_inputs_are_integrated_exactly(delay_s):
    """Of 1/s, held and late: the sum of the samples, with a fraction of the last."""
    rng = np.random.default_rng(0)
    ports, one = ((Port("torque", "N m"),), (Port("rate", "rad/s"),)), np.ones((1, 1))
    wheel = MeasurementModel(
        poles=np.zeros(0),
        shapes=np.zeros((1, 0)),
        participation=np.zeros((0, 1)),
        direct=0 * one,
        lower=0 * one,
        delay_s=[delay_s],
        inputs=ports[0],
        outputs=ports[1],
        integral=one,
    )
    u = rng.standard_normal(200)
    fine = np.repeat(u, 100)
    y = scipy.signal.lfilter([0.0, 1e-4], [1.0, -1.0], np.r_[np.zeros(round(delay_s * 1e4)), fine])
    record = Record(
        sample_hz=100.0,
        u=u[None, None, :, None],
        y=y[: 100 * len(u) : 100][None, None, :, None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=False,
    )
    # Rounding of the transform and of the sum.
    off = simulate_record(wheel, record, between="hold") - record.y
    assert np.linalg.norm(off.ravel()) < 1e-10 * np.linalg.norm(record.y.ravel())
    assert simulate_record(wheel, record).shape == record.y.shape


def test_integrators_exclude_rigid_modes():
    with pytest.raises(ConfigError, match="same free motion twice"):
        fit_response(measured(), states=8, integrators=1, rigid=1)
