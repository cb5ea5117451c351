"""Weights of a sampled model's lines: held-out errors that differ by chance do not outvote the likelihood."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from middeck import Port, Record, fit_record
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.record_fit.simulate_record import record_nrmse
from repeats import repeats

RATE_HZ, SAMPLES = 100.0, 2000
# Held-out samples are simulated best, by up to 3 %, with all lines weighed alike on the first four.
SEEDS = [5, 14, 20, 22, *(s for s in range(40) if s not in (5, 14, 20, 22))]


def shaken(seed: int) -> tuple[float, Record]:
    """A mode under a known held force and three tenths of another, and its frequency."""
    rng = np.random.default_rng(seed)
    hz = rng.uniform(8.0, 20.0)
    omega, zeta = 2.0 * np.pi * hz, rng.uniform(0.01, 0.02)
    mode = ([omega**2], [1.0, 2.0 * zeta * omega, omega**2])
    b, a, _ = scipy.signal.cont2discrete(mode, 1.0 / RATE_HZ, "zoh")
    u, other = rng.standard_normal((2, SAMPLES))
    y = scipy.signal.lfilter(b.ravel(), a, u + 0.3 * other)
    y += 0.01 * np.std(y) * rng.standard_normal(SAMPLES)
    u, y = (x[None, None, :, None] for x in (u, y))
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    return hz, Record(sample_hz=RATE_HZ, u=u, y=y, periodic=False, held=True, **ports)


@pytest.mark.parametrize("seed", repeats(SEEDS, 2))
def test_noise_of_forces_leaves_a_residual_that_is_noise(seed):
    hz, record = shaken(seed)
    fit = fit_record(record, states=2, sampled=True)
    assert not [warning for warning in fit.warnings if "correlated with the inputs" in warning]
    assert abs(natural_hz(fit.model)[0] - hz) < 4.0 * fit.uncertainty.natural_hz[0]


def gliding(seed: int) -> tuple[Record, Record]:
    """Two halves of a record: a strong mode that glides by 1 %, and a weak one that two states leave out."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.standard_normal(SAMPLES // 4), 4)
    glide = 1.0 + 0.01 * np.sin(2.0 * np.pi * 1.3 * np.arange(SAMPLES) / RATE_HZ)
    steady = np.ones(SAMPLES)
    y = stepped(4.0 * glide, 0.05, u) + 0.15 * stepped(20.0 * steady, 0.01, u)
    y += 1e-4 * np.std(y) * rng.standard_normal(SAMPLES)
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    first, second = (
        Record(
            sample_hz=RATE_HZ,
            u=u[None, None, at, None],
            y=y[None, None, at, None],
            periodic=False,
            held=True,
            **ports,
        )
        for at in (slice(0, SAMPLES // 2), slice(SAMPLES // 2, None))
    )
    return first, second


def stepped(hz: np.ndarray, zeta: float, u: np.ndarray) -> np.ndarray:
    """A mode of unit static gain, exact over each sample with its frequency of that sample."""
    state, y = np.zeros(2), np.empty(len(u))
    for k, omega in enumerate(2.0 * np.pi * hz):
        y[k] = state[0]
        block = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2.0 * zeta * omega, omega**2], [0.0, 0.0, 0.0]])
        step = scipy.linalg.expm(block / RATE_HZ)
        state = step[:2, :2] @ state + step[:2, 2] * u[k]
    return y


def test_samples_kept_out_choose_the_weights_where_much_is_left():
    """Weights that follow what is left pass over the strong mode, which all lines weighed alike follow."""
    first, second = gliding(0)
    by_default, by_noise = (
        record_nrmse(fit_record(first, states=2, sampled=True, **weights).model, second)[0]
        for weights in ({}, {"weighting": "output"})
    )
    assert by_default < 0.25 < 0.8 < by_noise
