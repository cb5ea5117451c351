"""Lines that a clean sweep hardly excites are noise and raise no doubt; a mode that moves or lacks does."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest
import scipy.signal

from middeck import Port, Record, estimate_response, fit_response
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.search.fit_warnings import warnings_on_model
from middeck.systems.plants.response import FrequencyResponse
from repeats import repeats

RATE_HZ, SECONDS, STATES = 200.0, 30.0, 6
DOUBTS = ("scatters by", "unexplained")


def swept(seed: int) -> tuple[np.ndarray, Record]:
    """Three modes swept through in half a minute, and their frequencies."""
    rng = np.random.default_rng(seed)
    modal_hz, zeta = np.sort(rng.uniform(3.0, 22.0, 3)), rng.uniform(0.005, 0.02, 3)
    time = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    u = scipy.signal.chirp(time, 0.5, SECONDS, 80.0, method="logarithmic")
    y = np.zeros(len(time))
    for hz, damping in zip(modal_hz, zeta, strict=True):
        omega = 2.0 * np.pi * hz
        mode = ([omega**2 * rng.uniform(0.5, 1.5)], [1.0, 2.0 * damping * omega, omega**2])
        b, a, _ = scipy.signal.cont2discrete(mode, 1.0 / RATE_HZ, "zoh")
        y += scipy.signal.lfilter(b.ravel(), a, u)
    y += 0.05 * np.std(y) * rng.standard_normal(len(y))
    u, y = (x[None, None, :, None] for x in (u, y))
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    return modal_hz, Record(sample_hz=RATE_HZ, u=u, y=y, periodic=False, held=True, **ports)


@pytest.mark.parametrize("seed", repeats(range(40), 2))
def test_a_clean_sweep_raises_no_doubt(seed):
    modal_hz, record = swept(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        response = estimate_response(record)
    fit = fit_response(response, states=STATES)
    assert not [warning for warning in fit.warnings if any(word in warning for word in DOUBTS)]
    found, order = natural_hz(fit.model), np.argsort(natural_hz(fit.model))
    assert np.all(np.abs(found[order] - modal_hz) < 4.0 * fit.uncertainty.natural_hz[order])


def test_noise_on_all_lines_alike_still_raises_both():
    _, record = swept(0)
    response = estimate_response(record, band_hz=(2.0, 25.0))
    rms = np.sqrt(np.mean(np.abs(response.H) ** 2))
    rng = np.random.default_rng(1)
    noise = 0.3 * rms * (rng.standard_normal((2, *response.H.shape)).T @ [1.0, 1j]).T / np.sqrt(2.0)
    noisy = dataclasses.replace(
        response, H=response.H + noise, variance=np.full(response.H.shape, (0.3 * rms) ** 2), covariance=None
    )
    message = " ".join(fit_response(noisy, states=STATES).warnings)
    assert all(word in message for word in DOUBTS)


def test_a_mode_that_moves_while_it_is_measured_raises_a_doubt():
    """The peak scatters and weighs nothing: a mode that had moved by 2 % was fitted in silence."""
    rng, size, factors = np.random.default_rng(5), 2000, np.repeat([1.0, 1.02], 4)
    f = np.fft.rfftfreq(size, 1.0 / RATE_HZ)
    drive = np.exp(2j * np.pi * rng.uniform(size=len(f))) * ((f > 1.0) & (f < 40.0))
    modal = 9.0 * factors[:, None]
    y = np.fft.irfft(drive * modal**2 / (modal**2 - f**2 + 0.02j * modal * f), size)
    y += 0.01 * np.std(y) * rng.standard_normal(y.shape)
    u = np.tile(np.fft.irfft(drive, size), (len(factors), 1))
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    record = Record(sample_hz=RATE_HZ, u=u[None, ..., None], y=y[None, ..., None], periodic=True, **ports)
    fit = fit_response(estimate_response(record, band_hz=(1.5, 35.0)), states=2)
    found, deviation = natural_hz(fit.model), fit.uncertainty.natural_hz
    assert np.all(np.abs(found - modal) > 4.0 * deviation)  # no frequency that it had: the doubt is due
    assert any("scatters by" in warning for warning in fit.warnings)


def test_a_mode_that_the_model_lacks_raises_a_doubt_though_its_lines_weigh_little():
    f = np.arange(1.0, 101.0)
    H = np.where(f > 90.0, 10.0, 1.0)[:, None, None] + 0j
    variance = np.where(f > 90.0, 2.0, 1e-6)[:, None, None]
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    measured = FrequencyResponse(frequency_hz=f, H=H, variance=variance, **ports)
    residual = np.where(f > 90.0, -10.0, 0.0)[:, None, None] + 0j
    warnings = warnings_on_model(measured, np.array([0.96]), 0.4, residual)
    assert [words for words in warnings if "96% of the response unexplained" in words]
