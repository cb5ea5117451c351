"""A fit that should not be trusted says so."""

import dataclasses

import numpy as np
import pytest

from middeck.errors import FitError
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.search.fit_warnings import warnings_on_deviations, warnings_on_model
from middeck.identification.spectra.estimate import estimate_response
from middeck.identification.uncertainty.covariance import as_exact
from middeck.signals.excitation.multisine import random_multisine
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import find_periodic_state, simulate
from middeck.systems.state_space.modal_system import ModalSystem

PERIODS, SAMPLE_HZ = 4, 128.0


@pytest.fixture(scope="module")
def shaken():
    """Two modes, 3.2 and 11.5 Hz at 1 %, four steady periods of 32 s with 0.1 % noise."""
    omega = 2.0 * np.pi * np.array([3.2, 11.5])
    modal = ModalSystem(
        omega=omega,
        zeta=[0.01, 0.01],
        psi=[[1.0], [0.7]],
        phi=[[1.0, 0.8]],
        phi_rate=[[0.0, 0.0]],
        names=("a", "b"),
    )
    rng = np.random.default_rng(5)
    u = random_multisine((0.5, 14.0), 32.0, SAMPLE_HZ, 1.0, rng)[:, None]
    sampled = sample_dynamics(modal, 1.0 / SAMPLE_HZ, 0.005)
    y, _ = simulate(sampled, u, find_periodic_state(sampled, u))
    many = np.broadcast_to(y, (PERIODS, *y.shape)) + 1e-3 * y.std() * rng.standard_normal((PERIODS, *y.shape))
    return u, many


def fit(u, y):
    ports = (Port("force", "N"),), (Port("tip", "m"),)
    record = Record(
        sample_hz=SAMPLE_HZ,
        u=np.broadcast_to(u, (1, PERIODS, *u.shape)),
        y=y[None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=True,
    )
    return fit_response(estimate_response(record, band_hz=(0.5, 14.0)), states=4)


def test_a_clean_record_raises_no_doubt_of_the_record(shaken):
    result = fit(*shaken)
    assert not [w for w in result.warnings if "scatters" in w or "unexplained" in w]
    assert result.model.hold_s == 1.0 / SAMPLE_HZ
    assert result.model.delay_s[0] == pytest.approx(0.005, abs=2e-4)


def test_drift_is_reported_and_taken_out(shaken):
    u, y = shaken
    slope = np.linspace(0.0, 50.0 * y.std(), y[..., 0].size).reshape(y.shape)
    with pytest.warns(UserWarning, match="tip drifts by .*the ramp is taken out"):
        result = fit(u, y + slope)
    assert result.model.poles == pytest.approx(fit(u, y).model.poles, rel=1e-4)
    assert result.model.delay_s[0] == pytest.approx(0.005, abs=2e-4)


def test_a_spike_is_doubted(shaken):
    u, y = shaken
    spiked = y.copy()
    spiked[1, 777] += 100.0 * y.std()
    assert any("scatters" in w for w in fit(u, spiked).warnings)


def test_an_unsteady_period_is_doubted(shaken):
    u, y = shaken
    growing = y * np.array([2.0, 1.0, 1.0, 1.0])[:, None, None]
    with pytest.warns(UserWarning, match="gain changes"):
        fitted = fit(u, growing)
    assert any("scatters" in w for w in fitted.warnings)


def test_the_logarithmic_cost_wants_a_variance(shaken):
    u, y = shaken
    ports = (Port("force", "N"),), (Port("tip", "m"),)
    once = Record(
        sample_hz=SAMPLE_HZ, u=u[None, None], y=y[None, :1], inputs=ports[0], outputs=ports[1], periodic=True
    )
    with pytest.raises(FitError, match="two periods"):
        fit_response(estimate_response(once, band_hz=(0.5, 14.0)), states=4, cost="logarithmic")


def test_a_model_worse_than_none_is_refused(shaken):
    u, y = shaken
    ports = (Port("force", "N"),), (Port("tip", "m"),)
    record = Record(
        sample_hz=SAMPLE_HZ,
        u=np.broadcast_to(u, (1, PERIODS, *u.shape)),
        y=y[None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=True,
    )
    measured = estimate_response(record, band_hz=(0.5, 14.0))
    with pytest.raises(FitError, match="3 times the response") as caught:
        warnings_on_model(measured, np.array([3.0]), 1.0, 2.0 * measured.H)
    assert caught.value.where == "output tip"


def test_a_small_part_of_the_rms_says_on_which_lines_it_is_most():
    """Six decades from the strong lines to the weak: what is 90 % wrong there is 1e-6 of the rms."""
    f, H = np.arange(1.0, 101.0), np.ones((100, 1, 1), complex)
    H[70:] = 1e-6
    ports = (Port("force", "N"),), (Port("tip", "m"),)
    measured = FrequencyResponse(
        frequency_hz=f, H=H, inputs=ports[0], outputs=ports[1], variance=np.full(H.shape, 1e-18)
    )
    wrong = np.where(np.arange(100) < 70, 0.0, 0.9e-6)[:, None, None] + 0j
    error = np.sqrt(np.sum(np.abs(wrong) ** 2) / np.sum(np.abs(H) ** 2))
    (warning,) = warnings_on_model(measured, np.array([error]), 1.0, wrong)
    assert "5.9e-05% of the response's rms" in warning
    assert "exceeds half of the response on 30 of 100 frequency lines, 71-100 Hz" in warning
    noisy = dataclasses.replace(measured, variance=np.full(H.shape, 1e-12))
    (warning,) = warnings_on_model(noisy, np.array([error]), 1.0, wrong)
    assert "half of the response" not in warning  # a line of noise is not wrong
    (warning,) = warnings_on_model(measured, np.array([0.02]), 1.0, 0.02 * H)
    assert "it is 2% of the response's rms over the band;" in warning


def test_modes_outside_the_band_are_one_sentence_and_narrow_ones_no_doubt_of_samples():
    """Poles 20 and 0.1 Hz outside of 1 to 10 Hz, one of 5 Hz that is narrower than the lines are apart."""
    omega = 2.0 * np.pi * np.array([20.0, 5.0, 0.1])
    poles = omega * (-1e-4 + 1j)
    ports, one, zero = ((Port("u", "N"),), (Port("y", "m"),)), np.ones((1, 3)), np.zeros((1, 1))
    model = MeasurementModel(
        poles=poles,
        shapes=one + 0j,
        participation=one.T + 0j,
        direct=zero,
        lower=zero,
        delay_s=np.zeros(1),
        inputs=ports[0],
        outputs=ports[1],
    )
    known = as_exact(model)
    lines = np.arange(1.0, 10.0, 0.1)
    H = np.ones((len(lines), 1, 1), complex)
    measured = FrequencyResponse(
        frequency_hz=lines, H=H, inputs=ports[0], outputs=ports[1], variance=np.ones(H.shape)
    )
    of_lines = warnings_on_deviations(measured, known)
    assert [w for w in of_lines if "outside" in w] == [
        "modes at 0.1, 20 Hz: they lie outside the band 1-9.9 Hz, and represent all modes beyond it"
    ]
    assert any("half-power" in w for w in of_lines)
    of_samples = warnings_on_deviations(measured, known, of_samples=True)
    assert of_samples == [w for w in of_lines if "half-power" not in w]


def test_warnings_of_an_estimate_reach_its_fit(shaken):
    """Clipping was told by the estimate alone: the fit, its gains 1 % too small, had no warning of it."""
    u, many = shaken
    limit = 0.6 * np.abs(many[0]).max()
    ports = (Port("force", "N"),), (Port("tip", "m"),)
    once = slice(300, 3900)  # a run that does not repeat
    record = Record(
        sample_hz=SAMPLE_HZ,
        u=u[None, None, once],
        y=np.clip(many[:1, once], -limit, limit)[None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=False,
    )
    with pytest.warns(UserWarning, match="clipped"):
        measured = estimate_response(record, band_hz=(1.0, 14.0))
    assert any("clipped" in text for text in measured.warnings)
    fitted = fit_response(measured, states=4)
    assert set(measured.warnings) <= set(fitted.warnings)
    assert "sound" not in fitted.standing
