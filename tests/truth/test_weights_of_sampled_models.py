"""Weights of a sampled model's lines: held-out errors that differ by chance do not outvote the likelihood."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from middeck import Port, Record, fit_record
from middeck.identification.model.measurement_model import natural_hz
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
