"""Blows that differ, and noise of their force: said or counted, against exact motion."""

import dataclasses

import numpy as np
import pytest
import scipy.signal as ss
from exact_blows import deviations_off, exact_blows

from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.fit_of_blows import fit_impact
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.uncertainty.parameter_deviations import parameters_of

RATE, HZ, ZETA = 200.0, np.array([13.0]), np.array([0.013])
TWO_HZ, TWO_ZETA = np.array([9.0, 17.0]), np.array([0.03, 0.025])


def in_a_row(scatter, *, seed):
    """Five blows in one record, so soon that the article never rests; the response to each is scaled."""
    rng, force, y = np.random.default_rng(seed), 0.0, 0.0
    for k in range(5):
        blow = [[(0.4 + 1.1 * k + rng.uniform(0.0, 0.2), 0.09, rng.uniform(30.0, 80.0))]]
        phi = np.array([[1.0], [0.6]]) * (1.0 + scatter * rng.standard_normal())
        record = exact_blows(
            (HZ, ZETA, phi * (2.0 * np.pi * HZ) ** 2), blow, 1300, RATE, noise=0.0, force_noise=0.0
        )
        force, y = force + record.u, y + record.y
    y = y + 5e-4 * y.std() * rng.standard_normal(y.shape)
    return dataclasses.replace(record, u=force, y=y, held=False)


@pytest.mark.parametrize("scatter", [0.0, 0.05])
def test_blows_in_a_row_that_differ_are_told(scatter: float):
    """Gains were tens of deviations off in silence: what is left is as large at all times."""
    fit = fit_record(in_a_row(scatter, seed=6), states=2, sampled=False)
    found = parameters_of(fit.covariance)
    gain = found.names.index("constant[0, y0, hammer]")
    off = abs(abs(found.values[gain]) / (2.0 * np.pi * HZ[0]) ** 2 - 1.0) * (2.0 * np.pi * HZ[0]) ** 2
    assert (off > 4.0 * found.deviation[gain]) == (scatter > 0.0)
    assert any("the blows differ" in text for text in fit.warnings) == (scatter > 0.0)
    assert bool(fit.warnings) == (scatter > 0.0)


def soon(outputs, *, seed):
    """Five blows in a record, a second apart, with noise of the measured force."""
    blows = [[(0.4 + 1.03 * k, 0.08, 50.0 + 5.0 * k) for k in range(5)]]
    modes = np.array([14.8]), np.array([0.043]), np.array([[1.0], [-0.7], [0.8]])[:outputs] * 8647.0
    return exact_blows(modes, blows, 1120, RATE, noise=1e-4, force_noise=2e-4, seed=seed)


def test_the_force_at_rest_is_known_in_short_blocks():
    """Blocks shorter than two windows had no noise of the force, and modes were 7 deviations off."""
    test = average_blows(soon(3, seed=0))
    size = test.rest[test.rest != 0.0].std() / test.blocks.u.max()
    assert size == pytest.approx(2e-4, rel=0.2)


def test_noise_that_all_outputs_have_in_common_is_counted():
    """Three outputs with the noise of one force tell no more of a mode than one does."""
    one, all_three = (fit_record(soon(n, seed=0), states=2, sampled=False) for n in (1, 3))
    assert all_three.uncertainty.natural_hz[0] > 0.8 * one.uncertainty.natural_hz[0]
    assert np.abs(deviations_off(all_three, [14.8], [0.043])).max() < 4.0


def test_noise_of_a_measured_force_is_counted():
    """A mode was 4.8 deviations off: both outputs have the noise of one force."""
    hz, zeta = np.array([7.1, 19.9, 28.0]), np.array([0.031, 0.047, 0.032])
    phi = np.array([[1.0, -0.7, 0.8], [0.6, 0.9, -1.0]]) * (2.0 * np.pi * hz) ** 2
    blows = [[(0.4 + 1.3 * k + 0.0013 * k * k, 0.07, 50.0 + 7.0 * k) for k in range(4)]]
    record = exact_blows((hz, zeta, phi), blows, 1100, RATE, noise=3e-4, force_noise=2e-4, seed=2)
    fit = fit_record(record, states=6, sampled=False, band_hz=(0.5, 32.0))
    assert fit.warnings == ()
    assert np.abs(deviations_off(fit, hz, zeta)).max() < 4.0


def held_blows(*, seed):
    """A simulation whose force is held from each sample to the next."""
    shape = exact_blows(
        (TWO_HZ, TWO_ZETA, np.ones((1, 2))),
        [[(0.4 + 0.011 * k, 0.06, 50.0)] for k in range(3)],
        500,
        RATE,
        force_noise=0.0,
        seed=seed,
    )
    force = shape.u[:, 0, :, 0]
    y = np.zeros(force.shape)
    for hz, zeta, phi in zip(TWO_HZ, TWO_ZETA, (1.0, -0.7), strict=True):
        pole = 2.0 * np.pi * hz * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        grown = np.exp(pole / RATE)
        motion = ss.lfilter([0.0, (grown - 1.0) / pole], [1.0, -grown], force.astype(complex), axis=1)
        y = y + phi * (2.0 * np.pi * hz) ** 2 * motion.imag / pole.imag
    y = y + 2e-4 * y.std() * np.random.default_rng(seed).standard_normal(y.shape)
    return dataclasses.replace(shape, y=y[:, None, :, None])


def test_blows_of_a_simulation_in_steps_are_fitted_behind_their_hold():
    """A hammer's force is measured, but these are not: gains were hundreds of deviations off."""
    fit = fit_impact(average_blows(held_blows(seed=1)), states=4)
    assert fit.model.hold_s == 1.0 / RATE
    assert np.abs(deviations_off(fit, TWO_HZ, TWO_ZETA)).max() < 4.0
    found = parameters_of(fit.covariance)
    for m, hz in enumerate(TWO_HZ):
        near = int(np.argmin(np.abs(found.values[:2] - hz)))
        k = found.names.index(f"constant[{near}, y0, hammer]")
        true = (1.0, 0.7)[m] * (2.0 * np.pi * hz) ** 2
        assert abs(abs(found.values[k]) - true) < max(4.0 * found.deviation[k], 1e-3 * true)
