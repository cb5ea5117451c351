"""A sensor whose gain drifts in a sweep: motion that decays while the gain grows looks less damped."""

import re

import numpy as np
import pytest
from struck_plant import grid, response
from test_hold_not_stated import record_of

from middeck.identification.record_fit.fit_record import fit_record
from repeats import LONG

RATE, COUNT = 64.0, 2048 if LONG else 1024


def swept(seed, drift):
    """Two modes under a sweep that ends with the record; ``drift`` is of the gain, from end to end."""
    rng = np.random.default_rng([255, seed])
    t = np.arange(COUNT) / RATE
    last = rng.uniform(18.0, 24.0)
    u = np.sin(2.0 * np.pi * (0.4 + 0.5 * (last - 0.4) * t * RATE / COUNT) * t)
    hz, zeta = np.array([rng.uniform(2.5, 6.0), rng.uniform(8.0, 14.0)]), rng.uniform(0.008, 0.02, 2)
    size, f = grid(hz, zeta, COUNT, RATE)
    H = response(hz, zeta, 2.0 * np.pi * hz * rng.uniform(0.4, 1.0, 2), 0.011, 2j * np.pi * f)
    y = np.fft.irfft(H * np.fft.rfft(u, size), size)[:COUNT]
    y += 1e-3 * y.std() * rng.standard_normal(COUNT)
    return fit_record(
        record_of(u, y * (1.0 + drift * (t / t[-1] - 0.5)), periodic=False, held=False), states=4
    )


@pytest.mark.parametrize("drift", [0.08, -0.08])
def test_a_gain_that_drifts_in_a_sweep_is_named_with_its_size(drift, campaign):
    """Damping was up to 104 of its deviations off, and what was said was any cause but this."""
    for seed in campaign(24):
        message = " ".join(swept(seed, drift).warnings)
        (percent,) = re.findall(r"its gain changes during the record, by ([+-][\d.]+)%", message)
        assert float(percent) == pytest.approx(100.0 * drift, rel=0.25)


def test_a_sweep_without_drift_is_not_doubted(campaign):
    assert sum(bool(swept(seed, 0.0).warnings) for seed in campaign(50)) <= 1
