"""Force that saturates behind its measurement, and dry friction: what is left goes by a law of its own."""

import dataclasses

import numpy as np
import pytest
from sine_record import RATE, deviations_off, driven, record_of, sines, summed
from struck_plant import response

from middeck.identification.record_fit.fit_record import fit_record
from repeats import repeats

FINER, WAIT = 4, 800  # samples of the simulation in one of the record, and those until it has forgotten rest


def article(rng):
    """Two or three modes from 3 to 25 Hz, apart by a tenth or more."""
    hz = np.cumsum(np.concatenate([[rng.uniform(3.0, 8.0)], rng.uniform(4.0, 8.0, rng.integers(1, 3))]))
    phi = rng.choice([-1, 1], len(hz)) * rng.uniform(0.4, 1.0, len(hz)) * 8.0 * hz**2
    return hz, rng.uniform(0.005, 0.02, len(hz)), phi, 0.0


def shaken(plant, rng, force):
    """The record of a command, in whose place ``force(command)`` acts; noise of 0.1 % of the output."""
    t = np.arange(FINER * (3000 + WAIT)) / (FINER * RATE)
    u = summed(*sines(rng, (0.5, 40.0), 1500), t)
    f = np.fft.rfftfreq(len(t), t[1])
    y = np.fft.irfft(np.fft.rfft(force(u)) * response(*plant, 2j * np.pi * f), len(t))
    u, y = u[::FINER][WAIT:], y[::FINER][WAIT:]
    return record_of(u, y + 1e-3 * y.std() * rng.standard_normal(len(y)))


def rubbing(plant, rng, share):
    """The record of an article on which dry friction of this ``share`` of the force's rms acts at its tip."""
    hz, zeta, phi, _ = plant
    t = np.arange(FINER * (3000 + WAIT)) / (FINER * RATE)
    u = summed(*sines(rng, (0.5, 40.0), 1500), t)
    omega, shape = 2.0 * np.pi * hz, np.sqrt(np.abs(phi))
    # Each mode turns exactly under a force held over a step; friction is smooth below a small speed.
    pole = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    turn = np.exp(pole * t[1])
    gain = (turn - 1.0) / pole / (1j * np.imag(pole))
    x, y, most, slow = np.zeros(len(hz), complex), np.empty(len(t)), share * u.std(), 0.0
    for k, force in enumerate(u):
        y[k], speed = shape @ np.real(x), shape @ np.real(pole * x)
        slow = max(slow, 0.02 * abs(speed))
        x = turn * x + gain * shape * (force - most * np.tanh(speed / max(slow, 1e-300)))
    u, y = u[::FINER][WAIT:], y[::FINER][WAIT:]
    return record_of(u, y + 1e-3 * y.std() * rng.standard_normal(len(y)))


# Gains of saturated force were 10 to 60 of their deviations too small, 9 of 12 in silence.
@pytest.mark.parametrize("soft", repeats([True, False]))
def test_force_that_saturates_behind_its_measurement_is_reported(soft, campaign):
    def force(u):
        return np.tanh(0.3 * u / u.std()) * u.std() if soft else np.clip(u, -2.2 * u.std(), 2.2 * u.std())

    for seed in campaign(24):
        rng = np.random.default_rng([421, seed])
        plant = article(rng)
        fit = fit_record(shaken(plant, rng, force), states=2 * len(plant[0]))
        assert any("cube" in line for line in fit.warnings)


def repeated(plant, rng, force, periods=4):
    """Steady periods of a multisine, in whose place ``force(command)`` acts; noise as above."""
    hz, zeta, phi, _ = plant
    count, f = 1000 * FINER, np.fft.rfftfreq(1000 * FINER, 1.0 / (FINER * RATE))
    u = np.fft.irfft(np.exp(2j * np.pi * rng.uniform(size=len(f))) * ((f >= 0.5) & (f <= 40.0)), count)
    y = np.fft.irfft(np.fft.rfft(force(u)) * response(hz, zeta, phi, 0.0, 2j * np.pi * f), count)
    u, y = (np.tile(x[::FINER], periods) for x in (u, y))
    record = record_of(u, y + 1e-3 * y.std() * rng.standard_normal(len(y)))
    shape = (1, periods, 1000, 1)
    return dataclasses.replace(record, u=record.u.reshape(shape), y=record.y.reshape(shape), periodic=True)


# Gains were 8 to 39 of their deviations too small, 15 of 16 in silence.
def test_force_that_saturates_is_reported_where_it_repeats_too(campaign):
    for seed in campaign(24):
        rng = np.random.default_rng([424, seed])
        plant = article(rng)
        linear, saturated = (
            fit_record(repeated(plant, rng, force), states=2 * len(plant[0]))
            for force in (lambda u: u, lambda u: np.tanh(0.3 * u / u.std()) * u.std())
        )
        assert not linear.warnings
        assert any("cube" in line for line in saturated.warnings)


# Frequencies were up to 56 deviations off where what is left was laid to poles beyond the band.
@pytest.mark.parametrize("share", repeats([0.003, 0.01], 1))
def test_dry_friction_on_the_article_is_reported(share, campaign):
    for seed in campaign(12):
        rng = np.random.default_rng([422, seed])
        plant = article(rng)[:2]
        plant = *plant, np.abs(8.0 * plant[0] ** 2), 0.0  # friction acts where the force does
        fit = fit_record(rubbing(plant, rng, share), states=2 * len(plant[0]))
        assert any("sign of the velocity" in line for line in fit.warnings)


def test_what_a_linear_article_leaves_goes_by_no_cube_and_no_direction(campaign):
    for seed in campaign(60):
        rng = np.random.default_rng([423, seed])
        plant = article(rng)
        fit = fit_record(driven(plant, rng, 3000, (0.5, 40.0), noise=1e-3), states=2 * len(plant[0]))
        assert not fit.warnings
        assert np.abs(deviations_off(fit, plant)).max() < 4.5
