"""Pairs that a model without delays spends on one are no modes; a damped mode of the article is one."""

import functools

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.fit.modes_that_stand_for_delay import stands_for_delay
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    model_response,
    natural_hz,
)
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from repeats import repeats

RATE = 100.0
PORTS = (Port("drive", "N"),), (Port("tip", "m"),)


def held(modes, lag, *, seed=0, count=400, noise=1e-3):
    """Modes (Hz, damping) under an input held by a computer, simulated exactly, with ``lag`` samples more."""
    rng = np.random.default_rng(seed)
    u, y = rng.standard_normal(count), np.zeros(count)
    for hz, zeta in modes:
        w = 2.0 * np.pi * hz
        numerator, denominator, _ = cont2discrete(([w**2], [1.0, 2.0 * zeta * w, w**2]), 1.0 / RATE)
        y = y + lfilter(np.ravel(numerator), denominator, u)
    y = np.concatenate([np.zeros(lag), y])[:count]
    y = y + noise * y.std() * rng.standard_normal(count)
    u, y = (x[None, None, :, None] for x in (u, y))
    return Record(sample_hz=RATE, u=u, y=y, inputs=PORTS[0], outputs=PORTS[1], periodic=False)


def warnings_of(fitted):
    return [w for w in fitted.warnings if "stand for a delay" in w]


def test_a_damped_pair_of_a_sampled_model_that_stands_for_a_delay_is_no_sound_mode():
    fitted = fit_record(held([(6.0, 0.01)], 3), states=4, sampled=True)
    light = int(np.argmin(np.abs(natural_hz(fitted.model) - 6.0)))
    assert abs(natural_hz(fitted.model)[light] - 6.0) < 4.0 * fitted.uncertainty.natural_hz[light]
    assert abs(damping_ratio(fitted.model)[light] - 0.01) < 4.0 * fitted.uncertainty.damping[light]
    # A pair follows three samples of delay within a thousandth: of the light mode's constants, 2 to 4
    # deviations.
    assert set(fitted.standing) == {"doubtful"}
    assert any("answers to single samples" in w for w in fitted.warnings)
    # Three samples, and what the hold makes of a displacement: within a sample of it.
    (warning,) = warnings_of(fitted)
    assert warning.startswith("poles at 20")
    assert float(warning.split("delay of about ")[1].split()[0]) == pytest.approx(30.0, abs=10.0)


def test_a_damped_mode_of_the_article_is_one():
    fitted = fit_record(held([(6.0, 0.01), (14.0, 0.6)], 0), states=4, sampled=True)
    assert not warnings_of(fitted)
    assert set(fitted.standing) == {"sound"}


def test_a_delay_is_distinguished_from_a_mode_as_far_as_the_data_tell():
    """Pade's approximation to a delay: a delay replaces it up to its error, and no further."""
    tau, light = 0.02, np.array([-0.3 + 40.0j, -0.5 + 110.0j])
    pade = (-3.0 + 1j * np.sqrt(3.0)) / tau
    s = 2j * np.pi * np.linspace(0.5, 35.0, 300)

    def undelayed(s):
        return sum(1.0 / ((s - p) * (s - np.conj(p))) for p in light)

    def exact(s):
        x = s * tau
        return (12.0 - 6.0 * x + x**2) / (12.0 + 6.0 * x + x**2) * undelayed(s)

    poles = np.array([*light, pade])
    residues = [1e-6 * exact(p + 1e-6) for p in poles]
    model = MeasurementModel(
        poles=poles, shapes=np.ones((1, 3)), participation=np.array(residues)[:, None], direct=[[0.0]],
        lower=[[0.0]], delay_s=[0.0], inputs=PORTS[0], outputs=PORTS[1],
    )  # fmt: skip
    H = model_response(model, s.imag / 2.0 / np.pi)[:, 0, 0]
    np.testing.assert_allclose(H, exact(s), rtol=1e-4, atol=1e-9)
    error = np.abs(np.exp(-s * tau) * undelayed(s) - H)
    coarse, fine = (np.full((1, len(s), 1), 1.0 / (k * np.sqrt(np.sum(error**2)))) for k in (0.2, 1e-3))
    U, nothing = np.ones((len(s), 1, 1)), np.zeros((1, len(s), 1))
    found, delay_s = stands_for_delay(model, s, U, nothing, coarse)
    assert found.tolist() == [2]
    # Two narrow peaks, each of any phase, fix a delay no better.
    assert delay_s == pytest.approx(tau, rel=0.3)
    assert stands_for_delay(model, s, U, nothing, fine)[0].size == 0


HZ, ZETA = np.array([6.0, 14.0]), np.array([0.01, 0.008])


def response(factor, *, seed=0, noise=1e-3, rates=False, beyond=0.0, lines=700):
    """Two modes in 1 to 30 Hz, and one ``beyond`` at 34 Hz, behind ``factor`` of s."""
    f, w = np.linspace(1.0, 30.0, lines), 2.0 * np.pi * np.append(HZ, 34.0)
    s, zeta = 2j * np.pi * f, np.append(ZETA, 0.01)
    modes = w**2 * [1.0, -1.5, beyond] / (s[:, None] ** 2 + 2.0 * zeta * w * s[:, None] + w**2)
    H = factor(s) * np.sum(modes, axis=1)
    H = H * s / w[0] if rates else H
    size = np.sqrt(lines / 700) * noise * np.sqrt(np.mean(np.abs(H) ** 2))  # as of 700 lines
    re, im = np.random.default_rng(seed).standard_normal((2, len(f))) / np.sqrt(2.0)
    return FrequencyResponse(
        frequency_hz=f,
        H=(H + size * (re + 1j * im))[:, None, None],
        inputs=PORTS[0],
        outputs=PORTS[1],
        variance=np.full((len(f), 1, 1), size**2),
    )


def turned(s):
    return np.exp(-0.02 * s)


def low_pass(hz):
    """Of Butterworth's, order two."""

    def filtered(s):
        x = s / (2.0 * np.pi * hz)
        return 1.0 / (1.0 + np.sqrt(2.0) * x + x**2)

    return filtered


@functools.cache
def fitted_behind(hz, noise):
    """The default fit of the response behind a filter."""
    return fit_response(response(low_pass(hz), noise=noise, lines=400))


@pytest.mark.parametrize("rates", repeats([False, True], 2))
def test_pairs_of_a_response_that_stand_for_a_delay_are_no_sound_modes(rates):
    fitted = fit_response(response(turned, rates=rates), constants="complex", states=8)
    (warning,) = warnings_of(fitted)
    # Complex residues take a part of it, of either sign.
    assert float(warning.split("delay of about ")[1].split()[0]) == pytest.approx(20.0, rel=0.3)
    sound = [hz for hz, one in zip(natural_hz(fitted.model), fitted.standing, strict=True) if one == "sound"]
    assert np.sort(sound) == pytest.approx(HZ, rel=1e-3)


@pytest.mark.parametrize(("hz", "noise"), repeats([(45.0, 1e-3), (80.0, 1e-3), (45.0, 1e-2), (60.0, 3e-4)]))
def test_a_delay_that_stands_for_a_filter_is_doubted_with_what_is_beside_it(hz, noise):
    """No delay is in it: stated ones were wrong by thousands of deviations, modes by twenty."""
    fitted = fitted_behind(hz, noise)
    assert fitted.delay_standing == ("doubtful",)
    assert sum("may stand for poles beyond the band" in w for w in fitted.warnings) == 1
    of = fitted.uncertainty
    for m, f in enumerate(natural_hz(fitted.model)):
        if fitted.standing[m] == "sound":
            assert np.min(np.abs(f - HZ)) < 4.0 * of.natural_hz[m]


def test_its_hint_helps():
    """The model that the warning asks for has the modes of the article, and one pair beyond the band."""
    fitted = fitted_behind(45.0, 1e-3)
    (warning,) = [w for w in fitted.warnings if "may stand for poles beyond the band" in w]
    states = int(warning.split("delay=False, ")[1].split()[0])
    instead = fit_response(
        response(low_pass(45.0), lines=400), constants="complex", delay=False, states=states
    )
    at = np.argsort(natural_hz(instead.model))[:2]
    assert np.all(np.abs(natural_hz(instead.model)[at] - HZ) < 4.0 * instead.uncertainty.natural_hz[at])
    assert all(instead.standing[m] == "sound" for m in at)


@pytest.mark.parametrize("seed", repeats(range(20)))
def test_of_a_delay_that_is_one_nothing_is_reported(seed):
    """Also not where a mode beyond the band is in the fit, which is said to stand for what is there."""
    plain = fit_response(response(turned, seed=seed))
    assert plain.warnings == ()
    more = fit_response(response(turned, seed=seed, beyond=2.0))
    assert not [x for x in more.warnings if "may stand for poles" in x]
    assert more.delay_standing == ("sound",)
    assert abs(more.model.delay_s[0] - 0.02) < 4.0 * more.uncertainty.delay_s[0]


def test_of_a_delay_common_to_four_paths_nothing_is_reported_in_any_unit():
    clean, unit = response(turned, noise=1e-9), 1e6
    H = unit * clean.H[::4] * np.outer([1.0, -0.6], [1.0, 0.8])
    size = np.broadcast_to(0.01 * np.sqrt(np.mean(np.abs(H) ** 2)), H.shape)
    re, im = np.random.default_rng(1).standard_normal((2, *H.shape)) / np.sqrt(2.0)
    ports = tuple(tuple(Port(p.name + k, p.unit) for k in "12" for p in side) for side in PORTS)
    paths = FrequencyResponse(
        frequency_hz=clean.frequency_hz[::4], H=H + size * (re + 1j * im), inputs=ports[0], outputs=ports[1],
        variance=size**2,
    )  # fmt: skip
    fitted = fit_response(paths, states=6, delay="common")
    assert set(fitted.standing) > {"sound"}
    assert not [w for w in fitted.warnings if "may stand for poles" in w]


@pytest.mark.parametrize("unit", [1.0, 10.0])
def test_by_likelihood_modes_are_as_sound_as_by_least_squares_in_any_unit_of_an_input(unit):
    """A pair too many asks whether poles do instead of the delay: by two costs two lengths do not compare."""
    rng, count = np.random.default_rng(0), 512
    f = np.fft.rfftfreq(count, 1.0 / RATE)
    s, w = 2j * np.pi * f, 2.0 * np.pi * HZ
    each = 1.0 / (s[:, None] ** 2 + 2.0 * ZETA * w * s[:, None] + w**2) * np.exp(-0.02 * s[:, None])
    H = np.einsum("lm,om,mi->loi", each, [[1.0, 0.7], [0.5, -0.9]], [[1.0, 0.4 / unit], [-0.6, 1.0 / unit]])
    U = np.exp(2j * np.pi * rng.random((2, len(f), 2))) * ((f > 1.0) & (f < 40.0))[:, None]
    U[1] = U[0] * [1.0, -1.0]
    U[..., 1] *= unit
    u, y = (np.fft.irfft(x, axis=1) for x in (U, np.einsum("loi,eli->elo", H, U)))
    u, y = (np.repeat(x[:, None], 4, axis=1) for x in (u, y))
    y = y + 0.02 * y.std(axis=(0, 1, 2)) * rng.standard_normal(y.shape)
    ports = tuple(tuple(Port(p.name + k, p.unit) for k in "12" for p in side) for side in PORTS)
    record = Record(sample_hz=RATE, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=True)
    measured = estimate_response(record, band_hz=(1.5, 39.0))
    for cost in ("weighted", "likelihood"):
        fitted = fit_response(measured, states=6, cost=cost)
        assert set(fitted.standing) > {"sound"}
        assert fitted.standing.count("sound") == 2
        assert set(fitted.delay_standing) == {"sound"}


@pytest.mark.parametrize(("hz", "noise"), repeats([(50.0, 3e-3), (70.0, 3e-3), (50.0, 1e-2)], 1))
def test_a_delay_of_a_record_that_stands_for_a_filter_is_doubted(hz, noise):
    rng, count = np.random.default_rng(4), 2000
    f = np.fft.rfftfreq(2 * count, 1.0 / RATE)
    s, w = 2j * np.pi * f, 2.0 * np.pi * HZ
    U = np.where((f > 1.0) & (f < 40.0), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    G = np.sum(w**2 * [1.0, -1.5] / (s[:, None] ** 2 + 2.0 * ZETA * w * s[:, None] + w**2), axis=1)
    u, y = (np.fft.irfft(x)[:count] for x in (U, low_pass(hz)(s) * G * U))
    y = y + noise * y.std() * rng.standard_normal(count)
    u, y = (x[None, None, :, None] for x in (u, y))
    record = Record(sample_hz=RATE, u=u, y=y, inputs=PORTS[0], outputs=PORTS[1], periodic=False)
    fitted = fit_record(record)
    assert fitted.delay_standing == ("doubtful",)
    assert [x for x in fitted.warnings if "may stand for poles beyond the band" in x]
