"""Lines that a clean sweep hardly excites are all noise: they weigh nothing in a fit, and raise no doubt."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest
import scipy.signal

from middeck import Port, Record, estimate_response, fit_response
from middeck.identification.model.measurement_model import natural_hz
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
    assert not [said for said in fit.warnings if any(word in said for word in DOUBTS)]
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
    said = " ".join(fit_response(noisy, states=STATES).warnings)
    assert all(word in said for word in DOUBTS)
