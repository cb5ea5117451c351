import dataclasses

import numpy as np
import pytest
from shaken_plant import U2, Y2, a_plant, pole_error, shaken

from middeck.errors import ConfigError, DataError, FitError
from middeck.identification.model.measurement_model import (
    model_response,
    natural_hz,
)
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.simulate_record import record_nrmse
from middeck.signals.record import Record
from repeats import repeats


@pytest.mark.parametrize("experiments", repeats([2, 1]))
def test_a_record_without_noise_gives_the_exact_model(experiments):
    record = shaken(0, experiments=experiments)
    fitted = fit_record(record, states=4, sampled=True, weighting="flat")
    # The search ends where a step promises 1e-3 of a cost in units of what is left: far below any noise.
    assert pole_error(fitted.model) < 1e-7
    f = np.linspace(0.01, 0.49, 50)
    np.testing.assert_allclose(model_response(fitted.model, f), model_response(a_plant(), f), atol=1e-5)
    assert record_nrmse(fitted.model, record, state_share=0.2).max() < 1e-6


def a_structure(seed, samples, *, noise=0.01):
    """Three modes of 1 %, two of them 6 % apart, under noise up to 80 Hz, cut from four times its length."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(4 * samples, 1.0 / 256.0)
    on = (f > 0.5) & (f < 80.0)
    U = on[:, None] * (rng.standard_normal((len(f), 2)) + 1j * rng.standard_normal((len(f), 2)))
    s, omega = 2j * np.pi * f[:, None], 2.0 * np.pi * STRUCTURE_HZ
    modes = omega**2 / (s**2 + 0.02 * omega * s + omega**2)
    phi, psi = np.array([[1.0, 0.7, -0.5], [0.6, -0.8, 0.9]]), np.array([[1.0, -0.5, 0.8], [0.4, 0.9, 0.7]])
    Y = np.exp(-s * STRUCTURE_DELAY_S) * np.einsum("om,km,im,ki->ko", phi, modes, psi, U)
    u, y = (np.fft.irfft(X, n=4 * samples, axis=0)[samples : 2 * samples] for X in (U, Y))
    y = y / y.std(axis=0) + noise * rng.standard_normal(y.shape)
    return Record(sample_hz=256.0, u=u[None, None], y=y[None, None], inputs=U2, outputs=Y2, periodic=False)


STRUCTURE_HZ, STRUCTURE_DELAY_S = np.array([2.5, 9.0, 9.6]), 0.007


@pytest.mark.parametrize("seed", repeats([0, 1]))
def test_a_record_as_short_as_a_free_decay_is_fitted_from_its_samples(seed):
    # Four seconds: 0.25 Hz from line to line, where the slowest mode is 0.05 Hz wide.
    fitted = fit_record(a_structure(seed, 1024))
    assert fitted.model.states == 6
    hz, sigma = natural_hz(fitted.model), fitted.uncertainty.natural_hz
    # Six unit normals of a run: all below four with probability 0.9998.
    assert np.abs((np.sort(hz) - STRUCTURE_HZ) / sigma[np.argsort(hz)]).max() < 4.0
    assert np.abs((fitted.model.delay_s - STRUCTURE_DELAY_S) / fitted.uncertainty.delay_s).max() < 4.0


def test_what_cannot_be_fitted_is_refused():
    record = shaken(0, 60)
    with pytest.raises(FitError, match="unknowns"):
        fit_record(record, states=30, sampled=True)
    with pytest.raises(ConfigError, match="0 states"):
        fit_record(record, states=0)
    with pytest.raises(ConfigError, match="sampled model"):
        fit_record(record, sampled=True, delay=True)
    with pytest.raises(DataError, match="constant"):
        fit_record(dataclasses.replace(record, u=0 * record.u), sampled=True)
    with pytest.raises(FitError, match="no line"):
        fit_record(record, states=2, sampled=True, band_hz=(0.6, 0.9))


def test_noise_alone_is_refused():
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((2, 1, 1, 600, 1))
    noise = Record(sample_hz=1.0, u=u, y=y, inputs=U2[:1], outputs=Y2[:1], periodic=False)
    with pytest.raises(FitError, match="noise"):
        fit_record(noise, states=4, sampled=True, weighting="flat")
