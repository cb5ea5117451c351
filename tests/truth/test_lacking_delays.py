"""A card that samples late, unequal delays and a filter of one output are named; clean data are not doubted.

The truth is a closed form: two modes, their delays, and what the record adds to those.
"""

import functools

import numpy as np
import pytest

from middeck import FrequencyResponse, Port, Record, fit_record, fit_response
from middeck.errors import FitError
from middeck.identification.model.measurement_model import damping_ratio, natural_hz, path_delay
from repeats import repeats

RATE, SAMPLES = 100.0, 500
HZ, ZETA = np.array([5.3, 14.1]), np.array([0.02, 0.015])
SHAPES = np.array([[900.0, 4000.0], [1200.0, -3000.0]])
DRIVEN = np.array([[1.0, 0.7], [-0.6, 0.9]])
DELAY_S = np.array([0.004, 0.009])
INPUTS, OUTPUTS = (Port("left", "N"), Port("right", "N")), (Port("tip", "m"), Port("root", "m"))


def _response(f, late_s=0.0):
    """Two inputs, two outputs; ``late_s`` is what each path is late by beside its output's delay."""
    s = 2j * np.pi * f[:, None, None]
    w = 2.0 * np.pi * HZ
    q = 1.0 / (s**2 + 2.0 * ZETA * w * s + w**2)
    return np.einsum("om,klm,mi->koi", SHAPES, q, DRIVEN) * np.exp(-s * (DELAY_S[:, None] + late_s))


def _measured(seed, late_s=0.0, by=1.0, noise=0.01):
    rng, f = np.random.default_rng(seed), np.arange(1.0, 40.0, 0.1)
    H = _response(f, late_s) * (by(f)[:, None] if callable(by) else by)
    size = noise * np.sqrt(np.mean(np.abs(H) ** 2, axis=(0, 2)))[:, None] * np.ones(2)
    error = (rng.standard_normal((2, *H.shape)).T @ np.array([1.0, 1.0j])).T * np.sqrt(0.5) * size
    variance = np.broadcast_to(size**2, H.shape).copy()
    return FrequencyResponse(frequency_hz=f, H=H + error, inputs=INPUTS, outputs=OUTPUTS, variance=variance)


def _record(seed, late_s=0.0, noise=1e-3):
    """One period of two experiments, from the spectra of a multisine."""
    rng, f = np.random.default_rng(seed), np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    driven = (f > 0.5) & (f < 40.0)
    U = driven[:, None, None] * np.exp(2j * np.pi * rng.random((len(f), 2, 2)))
    Y = np.zeros_like(U)
    Y[driven] = np.einsum("koi,kie->koe", _response(f[driven], late_s), U[driven])
    u, y = (np.fft.irfft(x, SAMPLES, axis=0).transpose(2, 0, 1)[:, None] for x in (U, Y))
    y = y + noise * y.std(axis=(0, 1, 2)) * rng.standard_normal(y.shape)
    return Record(sample_hz=RATE, u=u, y=y, inputs=INPUTS, outputs=OUTPUTS, periodic=True)


ROUTES = {
    "response": lambda seed, late_s: fit_response(_measured(seed, late_s), states=4),
    "record": lambda seed, late_s: fit_record(_record(seed, late_s), states=4),
}


@functools.cache
def _fit(route, seed, delay):
    return ROUTES[route](seed, np.array(delay))


@pytest.mark.parametrize("route", ROUTES)
def test_an_input_that_is_recorded_late_is_named(route):
    """The delays of both outputs are then neither path's, by nine of their deviations."""
    late_s = 0.1e-3
    fit = _fit(route, 1, ((0.0, -late_s),) * 2)
    assert np.any(np.abs(fit.model.delay_s - DELAY_S) > 4.0 * fit.uncertainty.delay_s)
    (warning,) = [w for w in fit.warnings if "is recorded" in w]
    assert warning.startswith("input right: ")
    assert "later than the others" in warning
    assert float(warning.split()[4]) == pytest.approx(1e3 * late_s, rel=0.2)
    assert fit.delay_standing == ("doubtful", "doubtful")


@pytest.mark.parametrize("route", ROUTES)
def test_a_path_with_a_delay_of_its_own_is_named(route):
    late_s = 0.4e-3 if route == "response" else 0.1e-3
    fit = _fit(route, 1, ((0.0, 0.0), (late_s, 0.0)))
    (warning,) = [w for w in fit.warnings if "than to the others" in w]
    assert warning.startswith("output root: ")


def test_a_filter_of_the_outputs_alone_is_reported():
    """Four poles at 45 Hz: no delay is like that."""
    poles = 2.0 * np.pi * 45.0 * np.exp(1j * np.pi * np.array([0.625, 0.875, 1.125, 1.375]))
    fit = fit_response(
        _measured(1, by=lambda f: np.prod(poles / (poles - 2j * np.pi * f[:, None]), axis=1)[:, None]),
        states=4,
    )
    assert any("a filter before this channel alone" in w for w in fit.warnings)


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("seed", repeats(range(2, 12)))
def test_equal_clocks_are_not_doubted(route, seed):
    fit = _fit(route, seed, 0.0)
    assert fit.warnings == ()
    assert np.all(np.abs(fit.model.delay_s - DELAY_S) < 4.0 * fit.uncertainty.delay_s)


WIDE_HZ = np.array([2.1, 4.0, 9.0, 17.0, 31.0])


def _wide(seed, late_s):
    """A fit of five modes by two inputs and outputs; one path is later than the others."""
    rng, f = np.random.default_rng(seed), np.arange(1.0, 40.0, 0.1)
    s, w = 2j * np.pi * f[:, None, None], 2.0 * np.pi * WIDE_HZ
    shape, driven = rng.uniform(0.5, 1.5, (2, 2, 5)) * rng.choice([-1.0, 1.0], (2, 2, 5))
    H = np.einsum("om,klm,im->koi", shape * w**1.5, 1.0 / (s**2 + 0.03 * w * s + w**2), driven)
    H = H * np.exp(-s * (DELAY_S[:, None] + np.array([[0.0, 0.0], [late_s, 0.0]])))
    size = np.sqrt(np.mean(np.abs(H) ** 2, axis=(0, 2)))[:, None] * np.full(2, 0.01)
    error = (rng.standard_normal((2, *H.shape)).T @ np.array([1.0, 1.0j])).T * np.sqrt(0.5) * size
    variance = np.broadcast_to(size**2, H.shape).copy()
    return fit_response(
        FrequencyResponse(frequency_hz=f, H=H + error, inputs=INPUTS, outputs=OUTPUTS, variance=variance),
        states=10,
    )


def test_only_modes_that_the_delay_moves_are_doubted():
    """A delay that is told moves what it moves: what is known of the other modes holds."""
    sound = 0
    for seed in range(4):
        fit = _wide(seed, 0.1e-3)
        assert any("than to the others" in w for w in fit.warnings)
        assert "doubtful" in fit.standing
        hz, zeta, std = natural_hz(fit.model), damping_ratio(fit.model), fit.uncertainty
        for m in (m for m, standing in enumerate(fit.standing) if standing == "sound"):
            truth = WIDE_HZ[np.argmin(np.abs(WIDE_HZ - hz[m]))]
            assert abs(hz[m] - truth) < 4.0 * std.natural_hz[m]
            assert abs(zeta[m] - 0.015) < 4.0 * std.damping[m]
            sound += 1
    assert sound >= 6


UNORDERED = {
    "response": lambda seed, late_s: fit_response(_measured(seed, late_s, noise=0.05)),
    "record": lambda seed, late_s: fit_record(_record(seed, late_s)),
}
PATHS_S = ((0.0, 0.031), (0.062, 0.012))
UNASKED = repeats([("record", 1, PATHS_S), ("response", 1, ((0.0, 0.006), (0.004, 0.001)))])


@pytest.mark.parametrize(("route", "seed", "lag"), UNASKED)
def test_delays_of_paths_are_found_without_being_asked_for(route, seed, lag):
    """One delay of each output would need tens of modes to follow them, or lead its input."""
    late_s = np.array(lag)
    fit = UNORDERED[route](seed, late_s)
    assert fit.warnings == ()
    assert "each path has a delay of its own" in fit.order_reason
    np.testing.assert_allclose(natural_hz(fit.model), HZ, rtol=1e-3)
    np.testing.assert_allclose(path_delay(fit.model), DELAY_S[:, None] + late_s, atol=2e-4)


def test_a_lead_for_want_of_delays_of_paths_is_reported_so():
    with pytest.raises(FitError) as caught:
        fit_response(_measured(1, np.array(PATHS_S) - 0.05), states=4, delay="output")
    assert "delay='path'" in str(caught.value)
