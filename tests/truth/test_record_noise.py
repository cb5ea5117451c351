"""Records under noise of sensors and of forces: poles, deviations, orders, and what noise is taken for."""

import numpy as np
import pytest
import scipy.stats
from shaken_plant import POLES, pole_error, shaken

from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.record_spectra import driven_lines
from middeck.identification.record_fit.sensor_or_force_noise import (
    covering_variance,
    denominator,
    likelier_variance,
    noise_variance,
)
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats


def test_forces_that_shake_the_article_are_known_by_its_poles(campaign):
    errors = {"flat": [], "motion": []}
    for seed in campaign(40):
        record = shaken(seed, 300, motion=0.3)
        for weighting, found in errors.items():
            found.append(pole_error(fit_record(record, states=4, sampled=True, weighting=weighting).model))
    # Forces of 30 % peak where the response does: the flat weights take the peaks for response. The rms error
    # of the poles is some 0.8 of theirs; one seed alone may go either way.
    rms = {weighting: np.sqrt(np.mean(np.square(found))) for weighting, found in errors.items()}
    assert rms["motion"] < 0.9 * rms["flat"]


def test_stated_deviations_are_those_of_repeated_records(campaign):
    z = []
    for seed in campaign(40):
        fitted = fit_record(shaken(seed, noise=0.5), states=4, sampled=True, weighting="output")
        order = np.argsort(natural_hz(fitted.model))
        truth = np.abs(POLES) / (2.0 * np.pi), -np.real(POLES) / np.abs(POLES)
        z += list((natural_hz(fitted.model)[order] - truth[0]) / fitted.uncertainty.natural_hz[order])
        z += list((damping_ratio(fitted.model)[order] - truth[1]) / fitted.uncertainty.damping[order])
    # n unit normals: the rms that has probability 0.99 (chi-square); weights estimated from the same lines
    # widen it by a tenth.
    low, high = np.sqrt(scipy.stats.chi2([len(z)] * 2).ppf([0.005, 0.995]) / len(z))
    assert 0.9 * low < np.sqrt(np.mean(np.square(z))) < 1.1 * high


@pytest.mark.parametrize("noise", repeats([{"motion": 0.2}, {"noise": 0.3}]))
def test_the_order_is_that_of_the_truth_for_either_noise(noise):
    fitted = fit_record(shaken(3, 200, **noise), sampled=True)
    assert fitted.model.states == 4
    assert "minimum description length" in fitted.order_reason
    assert "held out" in fitted.order_reason


def test_noise_of_forces_is_smooth_once_their_poles_are_taken_out():
    rng = np.random.default_rng(0)
    s = 2j * np.pi * np.linspace(0.001, 0.499, 499)
    poles = np.concatenate([POLES, POLES.conj()])
    A = np.prod(1.0 - np.exp(poles)[:, None] * np.exp(-s), axis=0)
    r = (rng.standard_normal((1, 499, 40)) + 1j * rng.standard_normal((1, 499, 40))) / A[:, None]
    v = noise_variance(r, denominator(s, poles, 1.0))
    # 40 experiments times 31 lines of a Hann window: the average scatters by 4 %.
    np.testing.assert_allclose(v[0, :, 0] * np.abs(A) ** 2 / 2.0, 1.0, atol=0.2)


def test_lines_that_a_signal_drives_have_a_noise_of_their_own():
    rng, lines = np.random.default_rng(1), np.arange(600)
    driven = lines % 3 == 0
    phase = np.exp(2j * np.pi * rng.random((1, 600, 1)))
    turn = np.exp(1j * np.pi * (lines + 1) / 601)
    U = np.where(driven, 1.0, 1e-8)[None, :, None] * phase + 0.1 / (1.0 - turn.conj())[:, None]
    np.testing.assert_array_equal(driven_lines(U, turn), driven)
    assert driven_lines(U + 1e-3 * phase, turn) is None  # noise of what is measured
    assert driven_lines(phase * (driven & (lines < 60))[:, None], turn) is None  # a model follows twenty
    by_chance = rng.standard_normal((1, 600, 1)) + 1j * rng.standard_normal((1, 600, 1))
    assert driven_lines(by_chance, turn) is None
    size = np.where(driven, 3.0, 0.01)[None, :, None]
    r = size * (rng.standard_normal((1, 600, 40)) + 1j * rng.standard_normal((1, 600, 40)))
    v = noise_variance(r, driven=driven)
    # 40 columns times 31 lines of a Hann window: the average scatters by 4 %.
    np.testing.assert_allclose(v / (2.0 * size**2), 1.0, atol=0.2)


def test_forces_beside_the_noise_of_sensors_are_known_where_a_narrow_peak_is_followed():
    """Of a peak of a line or two the fit leaves nothing: its flanks tell the forces."""
    s, pole, lines = 2j * np.pi * np.linspace(0.001, 0.5, 800), np.array([-0.0015 + 0.4j]), 800
    poles = np.concatenate([pole, pole.conj()])
    shape = denominator(s, poles, 1.0)
    peak = int(np.argmin(shape))
    forces, sensors = shape.min() * 100.0 / shape, 1.0
    truth = forces + sensors
    left = np.ones((1, lines, 1))
    left[0, peak - 1 : peak + 2] = 0.02
    before, after = [], []
    for seed in range(20):
        re, im = np.random.default_rng(seed).standard_normal((2, lines)) * np.sqrt(0.5)
        r = ((re + 1j * im) * np.sqrt(truth * left[0, :, 0]))[None, :, None]
        before.append(likelier_variance(r, shape, left)[0, peak, 0] / truth[peak])
        after.append(covering_variance(r, shape, left)[0, peak, 0] / truth[peak])
        quiet = slice(peak + 60, None)
        np.testing.assert_allclose(np.mean(covering_variance(r, shape, left)[0, quiet, 0]), 1.0, atol=0.25)
    assert np.median(before) < 0.4
    assert 0.7 < np.median(after) < 1.4


def test_deviations_cover_noise_of_the_measured_input(campaign):
    """Narrower than a line: the input's noise shakes the model, not the article, where the fit follows it."""
    z, rate, count, hz, zeta = [], 100.0, 1500, 3.0, 0.004
    w, size = 2.0 * np.pi * hz, 32768
    f = np.fft.rfftfreq(size, 1.0 / rate)
    G = 1.0 / (w**2 - (2.0 * np.pi * f) ** 2 + 4j * np.pi * zeta * w * f)
    for seed in campaign(60):
        rng = np.random.default_rng(seed)
        U = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) * ((f > 0.2) & (f < 40.0))
        u, y = (np.fft.irfft(X)[:count] for X in (U, G * U))
        u = u + 0.01 * u.std() * rng.standard_normal(count)
        y = y + 0.003 * y.std() * rng.standard_normal(count)
        u, y = (x[None, None, :, None] for x in (u, y))
        ports = (Port("force", "N"),), (Port("tip", "m"),)
        record = Record(sample_hz=rate, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=False)
        fitted = fit_record(record, states=2)
        z.append((natural_hz(fitted.model)[0] - hz) / fitted.uncertainty.natural_hz[0])
        z.append((damping_ratio(fitted.model)[0] - zeta) / fitted.uncertainty.damping[0])
    # Unit normals: the rms that has probability 0.999 (chi-square), a fifth wider for estimated noise.
    assert np.sqrt(np.mean(np.square(z))) < 1.2 * np.sqrt(scipy.stats.chi2(len(z)).ppf(0.999) / len(z))
