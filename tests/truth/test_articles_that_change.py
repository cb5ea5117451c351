"""An article that changes slowly, and play of a sensor or an actuator, are told of; sound records are not."""

import dataclasses

import numpy as np
import pytest
from sine_record import deviations_off, driven
from struck_plant import FORCE, TIP, grid, response, shaken

from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.record import Record
from repeats import repeats

RATE, COUNT = 100.0, 3000


def random_plant(rng):
    hz = np.cumsum(rng.uniform(4.0, 8.0, 3))
    phi = rng.choice([-1, 1], 3) * rng.uniform(0.4, 1.0, 3) * 8.0 * hz**2
    return hz, rng.uniform(0.005, 0.03, 3), phi, rng.uniform(0.0, 0.02)


def shaken_at(plant, seed):
    return shaken(plant, COUNT, RATE, (0.5, 40.0), noise=1e-3, seed=seed)


def play(x, width):
    """What follows x with so much play: it stays until x has crossed half the width."""
    found, at = np.empty(len(x)), 0.0
    for k, value in enumerate(x):
        at = min(max(at, value - width), value + width)
        found[k] = at
    return found


def test_a_pole_that_changes_slowly_is_reported(campaign):
    """One frequency of three by 0.2 %, or a damping by 20 %, evenly: 17 to 60 deviations off in silence."""
    for seed in campaign(24):
        rng = np.random.default_rng([81, seed])
        hz, zeta, phi, delay_s = random_plant(rng)
        one = np.arange(3) == rng.integers(3)
        start, later = shaken_at((hz, zeta, phi, delay_s), seed), np.linspace(0.0, 1.0, COUNT)[:, None]
        assert not any("deviation" in line for line in fit_record(start, states=6).warnings)
        for end in ((hz * (1.0 - 0.002 * one), zeta), (hz, zeta * (1.0 + 0.2 * one))):
            y = (1.0 - later) * start.y + later * shaken_at((*end, phi, delay_s), seed).y
            fit = fit_record(dataclasses.replace(start, y=y), states=6)
            assert any("changes during the record" in line for line in fit.warnings)
            assert "sound" not in fit.standing


@pytest.mark.parametrize("of", repeats(["sensor", "actuator"]))
def test_play_is_reported(of, campaign):
    """Of a twentieth of the rms: delays 16 to 50 and constants 5 to 27 deviations off, half in silence."""
    for seed in campaign(24):
        rng = np.random.default_rng([82, seed])
        plant = random_plant(rng)
        size, f = grid(plant[0], plant[1], 2 * COUNT, RATE)
        u = np.fft.irfft(np.fft.rfft(rng.standard_normal(size)) * ((f > 0.5) & (f < 30.0)), size)
        H, noise = response(*plant, 2j * np.pi * f), 1e-3 * rng.standard_normal(size)
        for width, reported in ((0.0, False), (0.05, True)):
            force = play(u, width * u.std()) if of == "actuator" else u
            y = np.fft.irfft(H * np.fft.rfft(force), size)
            y = play(y, width * y.std()) if of == "sensor" else y
            runs = (x[None, None, -COUNT:, None] for x in (u, y + y.std() * noise))
            record = Record(
                sample_hz=RATE,
                **dict(zip("uy", runs, strict=True)),
                inputs=(FORCE,),
                outputs=(TIP,),
                periodic=False,
            )
            warnings = fit_record(record, states=6, sampled=False).warnings
            assert any("sign of the velocity" in line for line in warnings) == reported, (seed, warnings)
            assert reported or not any("deviation" in line for line in warnings)


def test_outputs_interpolated_between_samples_are_reported(campaign):
    """By half a sample: constants 44 to 300 deviations off, one in ten in silence."""
    for seed in campaign(24):
        record = shaken_at(random_plant(np.random.default_rng([83, seed])), seed)
        y = 0.5 * (record.y[:, :, 1:] + record.y[:, :, :-1])
        fit = fit_record(dataclasses.replace(record, u=record.u[:, :, :-1], y=y), states=6)
        assert any("deviations are too small" in line or "poles beyond" in line for line in fit.warnings), (
            fit.warnings
        )


def test_a_mode_that_lacks_is_reported_though_little_is_left(campaign):
    """States for two modes of three, the third of a fiftieth of their size."""
    for seed in campaign(24):
        hz, zeta, phi, delay_s = random_plant(np.random.default_rng([84, seed]))
        record = shaken_at((hz, zeta, phi * [1.0, 0.02, 1.0], delay_s), seed)
        assert any("correlated with the inputs" in line for line in fit_record(record, states=4).warnings)
        assert not any("deviation" in line for line in fit_record(record, states=6).warnings)


def two_experiments(rng, *plants, drives=(1.0, 1.0)):
    """Of one signal each, of half a minute together; noise of 0.1 % of the first one's output."""
    runs = [driven(plant, rng, 1500, (0.5, 40.0), noise=0.0) for plant in plants]
    u, y = (
        np.concatenate([drive * x for drive, x in zip(drives, each, strict=True)])
        for each in ([run.u for run in runs], [run.y for run in runs])
    )
    return dataclasses.replace(runs[0], u=u, y=y + 1e-3 * y[0].std() * rng.standard_normal(y.shape))


# Nine of ten with frequencies 0.1 % apart were 5 to 20 deviations off from both in silence, one of ten with
# another gain or another delay.
@pytest.mark.parametrize("of", repeats(["frequency", "gain", "delay"]))
def test_experiments_that_are_not_of_one_article_are_reported(of, campaign):
    for seed in campaign(20):
        rng = np.random.default_rng([451, seed])
        hz, zeta, phi, delay_s = random_plant(rng)
        other = {
            "frequency": (hz * (1.0 + rng.choice([-1e-3, 1e-3], len(hz))), zeta, phi, delay_s),
            "gain": (hz, zeta, phi * rng.uniform(0.95, 0.99), delay_s),
            "delay": (hz, zeta, phi, delay_s + 1e-4),
        }[of]
        fit = fit_record(two_experiments(rng, (hz, zeta, phi, delay_s), other), states=2 * len(hz))
        assert any("changes during the record" in line for line in fit.warnings)


def test_experiments_of_one_article_are_not_doubted(campaign):
    for seed in campaign(40):
        rng = np.random.default_rng([452, seed])
        plant = random_plant(rng)
        record = two_experiments(rng, plant, plant, drives=(1.0, rng.choice([0.3, 1.0])))
        fit = fit_record(record, states=2 * len(plant[0]))
        assert not fit.warnings
        assert np.abs(deviations_off(fit, plant)).max() < 4.5
