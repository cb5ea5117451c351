"""What band-limited inputs before and after a record leave in its samples: no doubt at little noise."""

import numpy as np
from sine_record import deviations_off, driven
from test_articles_that_change import random_plant

from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.record_spectra import record_data


def plant_of(seed):
    return random_plant(np.random.default_rng([461, seed]))


def test_tails_at_both_ends_are_terms_of_the_transient(campaign):
    """Without noise and from rest there is nothing but the ends; of few free samples a 1e-5th was left."""
    for seed in campaign(40):
        plant = plant_of(seed)
        record = driven(plant, np.random.default_rng(seed), 1000, (0.5, 40.0), noise=0.0, free=0.0)
        data = record_data(record, (0.5, 40.0), whole=False)
        delay = int(np.ceil(100.0 * plant[3])) + 1
        transient = type(data.transient)(0.01, delay, 1)
        w = 2.0 * np.pi * plant[0]
        pole = np.exp(0.01 * w * (-plant[1] + 1j * np.sqrt(1.0 - plant[1] ** 2)))[:, None]
        free = [1.0 / (1.0 - z * np.exp(-0.01 * data.s)) for z in (pole, pole.conj())]
        known = np.concatenate([free[0] + free[1], 1j * (free[0] - free[1])])
        B = np.concatenate([known, transient.drift_and_edges(data.s, 1)]).view(float).T
        H = np.sum(
            plant[2][:, None] / (data.s**2 + 2.0 * (plant[1] * w)[:, None] * data.s + w[:, None] ** 2), 0
        )
        left = (data.H[0, :, 0] - H * np.exp(-data.s * plant[3]) * data.U[:, 0, 0]).view(float)
        left = left - B @ np.linalg.lstsq(B, left, rcond=None)[0]
        assert np.linalg.norm(left) < 3e-7 * np.linalg.norm(data.H)


def test_hardly_any_noise_makes_no_doubt(campaign):
    """Of the noise's size, what the ends left was told of as a delay that changes, or as another's poles."""
    for seed in campaign(20):
        plant = plant_of(100 + seed)
        record = driven(plant, np.random.default_rng(seed), 1500, (0.5, 40.0), noise=1e-5)
        fit = fit_record(record, states=2 * len(plant[0]))
        assert not fit.warnings
        assert np.abs(deviations_off(fit, plant)).max() < 4.5
