"""Pairs that a model without delays spends on one are no modes; a damped mode of the article is one."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from middeck.identification.fit.stands_for_delay import stands_for_delay
from middeck.identification.model.measurement_model import MeasurementModel, model_response, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

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


def said(fitted):
    return [w for w in fitted.warnings if "stand for a delay" in w]


def test_a_damped_pair_of_a_sampled_model_that_stands_for_a_delay_is_no_sound_mode():
    fitted = fit_record(held([(6.0, 0.01)], 3), states=4, sampled=True)
    light = int(np.argmin(np.abs(natural_hz(fitted.model) - 6.0)))
    assert fitted.standing[light] == "sound"
    assert [s for m, s in enumerate(fitted.standing) if m != light and fitted.model.is_pair[m]] == [
        "doubtful"
    ]
    # Three samples, and what the hold makes of a displacement: within a sample of it.
    (warning,) = said(fitted)
    assert float(warning.split("delay of about ")[1].split()[0]) == pytest.approx(30.0, abs=10.0)


def test_a_damped_mode_of_the_article_is_one():
    fitted = fit_record(held([(6.0, 0.01), (14.0, 0.6)], 0), states=4, sampled=True)
    assert not said(fitted)
    assert set(fitted.standing) == {"sound"}


def test_a_delay_is_told_from_a_mode_as_far_as_the_data_tell():
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
