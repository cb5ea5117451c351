"""Samples lost in records whose inputs drive a part of all frequencies, with noise of the sensor beyond."""

import dataclasses
from collections.abc import Callable

import numpy as np
from struck_plant import shaken

from middeck.identification.faults.lost_samples_and_feedback import find_relation_faults
from middeck.signals.record import Record

RATE, COUNT = 50.0, 1500


def band_limited(seed: int) -> Record:
    """Two modes under noise in 1-11 Hz, 1 % noise of the sensor up to half the rate."""
    rng = np.random.default_rng([281, seed])
    hz, zeta = np.array([rng.uniform(2.0, 4.0), rng.uniform(6.0, 9.0)]), 10.0 ** rng.uniform(-2.3, -1.6, 2)
    plant = hz, zeta, rng.uniform(0.4, 1.0, 2) * rng.choice([-1, 1], 2) * hz**2, 0.0
    return shaken(plant, COUNT + 20, RATE, (1.0, 11.0), noise=1e-2, seed=seed)


def test_samples_lost_in_an_input_are_placed_by_what_it_drives(campaign: Callable[..., range]) -> None:
    """Made white, three quarters of both signals were noise: of 100 losses 18 were found."""
    placed: list[bool] = []
    for seed in campaign(100, 10):
        rng, whole = np.random.default_rng([282, seed]), band_limited(seed)
        at, lost = int(rng.integers(300, 1200)), int(rng.integers(3, 13))
        sound = dataclasses.replace(whole, u=whole.u[:, :, :COUNT], y=whole.y[:, :, :COUNT])
        assert find_relation_faults(sound) == []
        u = np.delete(whole.u, slice(at, at + lost), axis=2)[:, :, :COUNT]
        found = find_relation_faults(dataclasses.replace(sound, u=u))
        assert all(f"answers {lost} samples later" in f.what for f in found), seed
        assert all(abs(f.samples[0][0] - at) < 60 for f in found), seed
        placed.append(bool(found))
    assert np.mean(placed) >= 0.9
