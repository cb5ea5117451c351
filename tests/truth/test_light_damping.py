"""Modes that hardly decay within a record: their numbers hold, and no warning doubts them."""

import numpy as np
import pytest
from sine_record import deviations_off, driven

from middeck.identification.record_fit.fit_record import fit_record
from repeats import repeats

# Of modes from 3 to 25 Hz; from 6 to 18 Hz, their band narrow; nearly without noise; one light among others.
KINDS = {
    "narrow band": ((6.0, 18.0), (1e-4, 1e-3), (4.0, 22.0), 1e-3),
    "quiet": ((3.0, 25.0), (1e-4, 1e-3), (0.5, 40.0), 1e-4),
    "light": ((3.0, 25.0), (1e-4, 1e-3), (0.5, 40.0), 1e-3),
    "mixed": ((3.0, 25.0), (1e-4, 2e-2), (0.5, 40.0), 1e-3),
}


def light(kind, seed):
    """Two or three modes apart by a tenth, and their record of half a minute."""
    within, ratios, band_hz, noise = KINDS[kind]
    rng = np.random.default_rng([411, seed])
    while True:
        hz = np.sort(rng.uniform(*within, 2 + seed % 2))
        if np.min(np.diff(hz) / hz[1:]) > 0.1:
            break
    zeta = np.exp(rng.uniform(*np.log(ratios), len(hz)))
    phi = rng.choice([-1, 1], len(hz)) * rng.uniform(0.4, 1.0, len(hz)) * 8.0 * hz**2
    plant = hz, zeta, phi, rng.uniform(0.0, 0.02)
    return driven(plant, rng, 3000, band_hz, noise=noise), plant


def test_a_mode_that_loses_little_of_its_motion_within_the_record_has_its_damping(campaign):
    """Before, a pole lost a tenth of it at least, which biased other modes too, and was called undamped."""
    for seed in campaign(20):
        rng = np.random.default_rng([412, seed])
        plant = np.array([6.0, 9.0]), np.array([5e-5, 0.01]), np.array([300.0, -700.0]), 0.004
        fit = fit_record(driven(plant, rng, 3000, (0.5, 40.0), noise=1e-4), states=4)
        assert not fit.warnings
        assert np.abs(deviations_off(fit, plant)).max() < 4.0


# Before, 5 to 15 in 100 were doubted, or began at a delay that suits two phases alone and stayed there.
@pytest.mark.parametrize("kind", repeats(KINDS))
def test_modes_that_hardly_decay_within_a_record_are_fitted_without_a_doubt(kind, campaign):
    off, reported = [], []
    for seed in campaign(120, share=40):
        record, plant = light(kind, seed)
        fit = fit_record(record, states=2 * len(plant[0]))
        off.append(deviations_off(fit, plant))
        reported += fit.warnings
    z = np.concatenate(off)
    assert np.abs(z).max() < 4.5  # of some thousand numbers
    assert np.sqrt(np.mean(z**2)) < 1.0 + 3.0 / np.sqrt(2.0 * len(z))
    assert len(reported) <= len(off) / 50, reported
