"""A delay that a fit without one lacks is named, and no other thing is taken for one."""

import numpy as np
import pytest

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.fit.missing_delay import missing_delay
from middeck.signals.ports import Port
from middeck.systems.plants.response import FrequencyResponse

F = np.arange(0.2, 30.0, 0.05)
S = 2j * np.pi * F
HZ, ZETA, GAIN = (3.1, 8.7, 17.0), (0.01, 0.008, 0.012), np.array([[1.0, 0.7, 0.9], [-0.6, 0.8, 0.5]])
DELAY = 0.0113


def rates(delay_s=(DELAY, DELAY), *, modes=2, noise=1e-3):
    """Two rates of a free body with modes, each late by its own delay."""
    H = np.zeros((len(F), 2, 1), complex)
    for o, delay in enumerate(delay_s):
        H[:, o, 0] = (2.0, 1.2)[o] / S
        for m in range(modes):
            w = 2.0 * np.pi * HZ[m]
            H[:, o, 0] += GAIN[o, m] * S / (S**2 + 2.0 * ZETA[m] * w * S + w**2)
        H[:, o, 0] *= np.exp(-S * delay)
    size = noise * np.sqrt(np.mean(np.abs(H) ** 2, axis=(0, 2), keepdims=True))
    re, im = np.random.default_rng(4).standard_normal((2, *H.shape)) / np.sqrt(2.0)
    ports = tuple(Port(name, "rad/s") for name in ("hub", "tip"))
    variance = np.broadcast_to(size**2, H.shape).copy()
    return FrequencyResponse(
        frequency_hz=F,
        H=H + size * (re + 1j * im),
        inputs=(Port("torque", "N m"),),
        outputs=ports,
        variance=variance,
    )


def hints(fitted):
    return [w for w in fitted.warnings if "--delay output --relative-degree 1" in w]


def test_a_lacking_delay_is_named_in_place_of_modes():
    fitted = fit_response(rates(), states=5, integrators=1)
    message = hints(fitted)
    assert [w.split(":")[0] for w in message] == ["output hub", "output tip"]
    assert not any("modes that the model lacks" in w for w in fitted.warnings)
    # The poles are those of a model without the delay; a twentieth of it is enough for a hint.
    np.testing.assert_allclose(missing_delay(rates(), fitted.model), DELAY, rtol=0.05)
    as_told = fit_response(rates(), states=5, integrators=1, delay="output", relative_degree=1)
    # Four deviations of a delay that the fit knows itself.
    assert np.all(np.abs(as_told.model.delay_s - DELAY) < 4.0 * as_told.uncertainty.delay_s)
    assert np.all(as_told.error < 0.05 * fitted.error)
    assert not hints(as_told)


def test_only_the_output_that_is_delayed_is_named():
    fitted = fit_response(rates((0.0, DELAY)), states=5, integrators=1)
    tau = missing_delay(rates((0.0, DELAY)), fitted.model)
    assert tau[0] == 0.0
    assert tau[1] == pytest.approx(DELAY, rel=0.05)  # as above
    assert [w.split(":")[0] for w in hints(fitted)] == ["output tip"]


def test_a_lacking_mode_is_no_delay():
    fitted = fit_response(rates((0.0, 0.0), modes=3), states=5, integrators=1)
    assert any("modes that the model lacks" in w or "unexplained" in w for w in fitted.warnings)
    assert not hints(fitted)


@pytest.mark.parametrize("delay_s", [(0.0, 0.0), (DELAY, DELAY)])
def test_a_fit_that_follows_to_the_noise_says_nothing(delay_s):
    fitted = fit_response(rates(delay_s, noise=0.01), integrators=1)
    assert not hints(fitted)


def driven_point(power, unit, *, noise=3e-3):
    """Three modes in the band and one above it, by a force: a velocity (1) or an acceleration (2)."""
    s = 2j * np.pi * (f := np.arange(2.0, 30.0, 0.05))
    H = np.zeros(len(f), complex)
    for hz, size in zip((6.0, 11.0, 19.0, 60.0), (0.8, -0.6, 0.9, -0.5), strict=True):
        w = 2.0 * np.pi * hz
        H += size * w ** (1 - power) * s**power / (s**2 + 0.02 * w * s + w**2)
    H *= np.exp(-s * DELAY)
    size = noise * np.sqrt(np.mean(np.abs(H) ** 2))
    re, im = np.random.default_rng(4).standard_normal((2, len(f))) / np.sqrt(2.0)
    return FrequencyResponse(
        frequency_hz=f,
        H=(H + size * (re + 1j * im))[:, None, None],
        inputs=(Port("force", "N"),),
        outputs=(Port("tip", unit),),
        variance=np.full((len(f), 1, 1), size**2),
    )


def test_a_delay_of_an_acceleration_is_advised_with_the_constant_that_it_has():
    """With relative degree one the best fit leads by milliseconds, or leaves a tenth of the response."""
    measured = driven_point(2, "m/s^2")
    remarks = [w for w in fit_response(measured, states=6).warnings if "--delay output" in w]
    assert len(remarks) == 1
    assert "--relative-degree 0" in remarks[0]
    # Modes above the band leave some hundredths of a millisecond.
    found = fit_response(measured, states=6, delay="output")
    assert found.model.delay_s[0] == pytest.approx(DELAY, abs=1e-4)


def test_a_constant_term_does_not_tell_the_delay_of_a_velocity():
    measured = driven_point(1, "m/s")
    constant = fit_response(measured, states=6, delay="output", relative_degree=0)
    off = abs(constant.model.delay_s[0] - DELAY)
    assert off > 4.0 * constant.uncertainty.delay_s[0]
    assert constant.delay_standing == ("doubtful",)
    assert any("constant term separates" in w for w in constant.warnings)
    usual = fit_response(measured, states=6, delay="output")
    assert usual.model.delay_s[0] == pytest.approx(DELAY, abs=2e-4)
    assert not np.any(usual.model.direct)
