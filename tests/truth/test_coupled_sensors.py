"""AC-coupled sensors (s tau / (1 + s tau)): a hammer's is taken out, any other is told; clean ones are not.

The coupling is made by its closed form on a padded Fourier transform.
"""

import dataclasses
import functools

import numpy as np
import pytest
from struck_plant import FORCE, TIP, response, shaken, struck

from middeck import FrequencyResponse, fit_record, fit_response
from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.blows import locate_blows
from middeck.identification.impact.coupled_force import released_force
from middeck.identification.impact.fit_of_blows import fit_impact
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.record import Record
from repeats import repeats

RATE = 200.0
PLANT = (np.array([6.0, 17.0]), np.array([0.02, 0.01]), [300.0, -800.0], 0.011)
BLOWS = [(1.0, 0.01, 50.0), (5.2, 0.01, 70.0), (9.1, 0.01, 40.0), (13.9, 0.01, 60.0)]


def _factor(s, tau):
    return s * tau / (1.0 + s * tau)


def _coupled(x, tau):
    """Channels [1, 1, sample, 1] through a coupling; padded until its tail has decayed."""
    size = int(2 ** np.ceil(np.log2(x.shape[2] + 25.0 * tau * RATE)))
    s = 2j * np.pi * np.fft.rfftfreq(size, 1.0 / RATE)
    return np.fft.irfft(np.fft.rfft(x, size, axis=2) * _factor(s, tau)[:, None], size, axis=2)[
        :, :, : x.shape[2]
    ]


@functools.cache
def _quiet():
    return struck(PLANT, BLOWS, 3600, RATE, noise=0.0)


def _blows(seed, *, force=None, tip=None, noise=1e-3):
    record = _quiet()
    u, y = record.u, record.y
    u = u if force is None else _coupled(u, force)
    y = y if tip is None else _coupled(y, tip)
    rng = np.random.default_rng(seed)
    u = u + 1e-4 * u.max() * rng.standard_normal(u.shape)
    return dataclasses.replace(record, u=u, y=y + noise * y.std() * rng.standard_normal(y.shape))


def _lead(fit):
    return float(abs(fit.model.delay_s[0] - PLANT[3]) / fit.uncertainty.delay_s[0])


@pytest.mark.parametrize(("tau", "of"), repeats([(4.0, "response"), (0.5, "response"), (9.0, "samples")]))
def test_the_tail_of_a_coupled_hammer_is_taken_out(tau, of):
    test = average_blows(_blows(1, force=tau))
    (warning,) = [w for w in test.warnings if "AC-coupled" in w]
    assert float(warning.split("time constant of ")[1].split()[0]) == pytest.approx(tau, rel=0.1)
    fit = fit_impact(test, of=of)
    assert fit.warnings == ()
    assert fit.model.states == 4
    assert _lead(fit) < 4.0


@pytest.mark.parametrize("seed", repeats(range(8)))
def test_a_hammer_without_coupling_is_left_as_it_is(seed):
    test = average_blows(_blows(seed))
    assert test.warnings == ()
    fit = fit_impact(test, of="response")
    assert fit.warnings == ()
    assert fit.model.states == 4  # no pole stands for the noise of a level
    assert _lead(fit) < 4.0


@pytest.mark.parametrize("force", [None, 5.0])
def test_a_coupled_response_to_blows_is_reported(force):
    fit = fit_impact(average_blows(_blows(1, force=force, tip=0.7, noise=2e-4)), of="response")
    assert _lead(fit) > 4.0
    assert fit.delay_standing == ("doubtful",)
    assert any(w.startswith("output tip: is AC-coupled") for w in fit.warnings)


def test_the_level_of_a_response_counts_in_the_variance_of_its_lowest_line():
    """All blows have its error, so that their scatter does not show it (1.4 deviations without)."""
    z = []
    for seed in range(20):
        test = average_blows(_blows(seed, noise=3e-3), window_s=1.0)
        found, s = test.response, 2j * np.pi * test.response.frequency_hz + 1.0
        assert found.variance is not None
        z.append(abs(found.H[0, 0, 0] - response(*PLANT, s)[0]) / np.sqrt(found.variance[0, 0, 0]))
    assert np.sqrt(np.mean(np.square(z))) < 1.1


def _measured(seed, factor=1.0):
    rng, f = np.random.default_rng(seed), np.arange(0.5, 40.0, 0.1)
    H = response(*PLANT, 2j * np.pi * f) * (factor if np.isscalar(factor) else factor(2j * np.pi * f))
    size = 2e-3 * np.sqrt(np.mean(np.abs(H) ** 2))
    error = size * np.sqrt(0.5) * (rng.standard_normal((2, len(f))).T @ np.array([1.0, 1.0j]))
    variance = np.full((len(f), 1, 1), size**2)
    H = (H + error)[:, None, None]
    return FrequencyResponse(frequency_hz=f, H=H, inputs=(FORCE,), outputs=(TIP,), variance=variance)


@pytest.mark.parametrize(
    ("who", "factor"),
    [("output tip", lambda s: _factor(s, 2.0)), ("input force", lambda s: 1.0 / _factor(s, 2.0))],
)
def test_a_response_names_the_coupled_side_and_its_time_constant(who, factor):
    fit = fit_response(_measured(1, factor), states=4)
    assert fit.delay_standing == ("doubtful",)
    (warning,) = [w for w in fit.warnings if "AC-coupled" in w]
    assert warning.startswith(who)
    assert float(warning.split("some ")[1].split()[0]) == pytest.approx(2.0, rel=0.25)


@pytest.mark.parametrize("seed", repeats(range(10)))
def test_responses_without_coupling_are_not_doubted(seed):
    assert fit_response(_measured(seed)).warnings == ()


def test_a_record_tells_a_coupled_response():
    record = shaken(PLANT, 1500, RATE, (0.3, 60.0), noise=0.0)
    y = _coupled(record.y, 1.0)
    y = y + 1e-3 * y.std() * np.random.default_rng(0).standard_normal(y.shape)
    fit = fit_record(dataclasses.replace(record, y=y), states=4, sampled=False)
    assert _lead(fit) > 4.0
    assert fit.delay_standing == ("doubtful",)
    assert any(w.startswith("output tip: is AC-coupled") for w in fit.warnings)


def test_an_estimate_of_a_clipped_record_that_does_not_repeat_says_so():
    """Distortion of noise is noise, so that gains are too small on all lines and none scatters."""
    record = shaken(PLANT, 3000, RATE, (0.3, 60.0), noise=1e-3)
    limit = 0.5 * np.abs(record.y).max()
    with pytest.warns(UserWarning, match="output tip.* clipped: "):
        estimate_response(dataclasses.replace(record, y=np.clip(record.y, -limit, limit)))


@pytest.mark.parametrize("seed", [4, 26, 58])
def test_a_force_that_drifts_at_random_is_not_ac_coupled(seed):
    """A random walk that falls at the blow of each of three experiments, to 0.3 % of the blow."""
    rng, time = np.random.default_rng(seed), np.arange(600) / 500.0
    force = 50.0 * np.exp(-(((time - 0.2) / 0.004) ** 2)) + 0.05 * rng.standard_normal((3, 600))
    force = force + 0.15 * np.cumsum(rng.standard_normal((3, 600)), axis=1) / 25.0
    u = force[:, None, :, None]
    record = Record(sample_hz=500.0, u=u, y=u, inputs=(FORCE,), outputs=(TIP,), periodic=False)
    assert released_force(force, locate_blows(record), 500.0).tau_s == np.inf
