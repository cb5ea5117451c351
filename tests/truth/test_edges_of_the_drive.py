"""Lines just beyond a sharp edge of the drive are leakage: no local model knows the response there."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest
from struck_plant import FORCE, TIP, response, shaken

from middeck.errors import DataError, FitError
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from repeats import repeats

PLANT = (np.array([4.9, 8.7, 13.6]), np.array([0.014, 0.02, 0.028]), [600.0, -1500.0, 4000.0], 0.011)


@pytest.mark.parametrize("seed", repeats([0, 3, 2, 1]))
def test_a_clean_record_of_band_limited_noise_is_fitted_without_a_word(seed: int) -> None:
    record = shaken(PLANT, 2048, 100.0, (2.0, 25.0), noise=1e-3, seed=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        measured = estimate_response(record)
        fitted = fit_response(measured)
    assert fitted.warnings == ()
    f = measured.frequency_hz
    assert measured.variance is not None
    deviation = np.sqrt(measured.variance[:, 0, 0])
    truth = response(*PLANT, 2j * np.pi * f)
    # Those of lines beyond the edge were 30 times the largest response, and so were their errors.
    assert deviation.max() < 0.01 * np.abs(truth).max()
    assert np.abs(measured.H[:, 0, 0] - truth).max() < 0.01 * np.abs(truth).max()
    # All but two of the driven lines are there.
    driven = np.arange(np.ceil(2.0 * 20.48), np.floor(25.0 * 20.48) + 1.0) / 20.48
    assert np.isin(np.round(driven * 20.48), np.round(f * 20.48)).sum() >= len(driven) - 2
    np.testing.assert_allclose(np.sort(natural_hz(fitted.model)), PLANT[0], rtol=1e-3)


def test_some_lines_of_no_use_do_not_make_all_of_them_noise() -> None:
    rng = np.random.default_rng(4)
    f = np.linspace(0.5, 30.0, 200)
    truth = response(*PLANT, 2j * np.pi * f)[:, None, None]
    variance = np.full(truth.shape, (0.01 * np.abs(truth).max()) ** 2)
    variance[-4:] *= 1e6
    error = rng.standard_normal((2, *truth.shape))
    H = truth + np.sqrt(0.5 * variance) * (error[0] + 1j * error[1])
    ports = shaken(PLANT, 64, 100.0, (1.0, 38.0), noise=0.0)
    measured = FrequencyResponse(
        frequency_hz=f, H=H, inputs=ports.inputs, outputs=ports.outputs, variance=variance
    )
    fitted = fit_response(measured, states=6)
    np.testing.assert_allclose(np.sort(natural_hz(fitted.model)), PLANT[0], rtol=2e-2)
    with pytest.raises(FitError, match="all lines are noise"):
        fit_response(dataclasses.replace(measured, H=H - truth), states=6)


def test_a_multisine_whose_amplitudes_fall_steeply_keeps_all_its_lines() -> None:
    """Whole periods have no leakage: of 99 driven lines 12 were left, of amplitudes as 1/f^2."""
    rng = np.random.default_rng(7)
    f = np.fft.rfftfreq(1024, 0.01)
    driven = (f > 0.05) & (f < 9.7)
    U = driven / np.maximum(f, 0.05) ** 2 * np.exp(2j * np.pi * rng.random(len(f)))
    u, y = (np.tile(np.fft.irfft(X, 1024), (8, 1)) for X in (U, response(*PLANT, 2j * np.pi * f) * U))
    y += 1e-5 * y.std() * rng.standard_normal(y.shape)
    record = Record(
        sample_hz=100.0, u=u[None, :, :, None], y=y[None, :, :, None], inputs=(FORCE,), outputs=(TIP,),
        periodic=True,
    )  # fmt: skip
    measured = estimate_response(record, method="local rational")
    np.testing.assert_allclose(measured.frequency_hz, f[driven])
    truth = response(*PLANT, 2j * np.pi * f[driven])
    assert np.abs(measured.H[:, 0, 0] - truth).max() < 1e-3 * np.abs(truth).max()


@pytest.mark.parametrize("band_hz", [(10.2, 25.0), (10.6, 25.0), (12.0, 25.0)])
def test_a_band_beside_the_drive_is_refused_wherever_it_begins(band_hz: tuple[float, float]) -> None:
    """Leakage from a drive outside the band was taken for a drive: responses off by thousands of times."""
    record = shaken(PLANT, 2048, 100.0, (1.0, 10.0), noise=1e-4)
    with pytest.raises(DataError, match="inputs' spectra are as smooth as a transient"):
        estimate_response(record, band_hz=band_hz)


@pytest.mark.parametrize("seed", repeats(range(8), 2))
def test_a_linear_sweep_is_estimated_where_it_turns_from_line_to_line(seed: int) -> None:
    """At its ends a sweep is as smooth as a motion that decays: those lines erred by up to 560 times the
    largest response, and each of nine clean records was said to leave up to all of it unexplained."""
    rng = np.random.default_rng([244, seed])
    hz = np.cumsum([rng.uniform(6.0, 8.0), rng.uniform(4.0, 8.0)])
    plant = hz, rng.uniform(0.01, 0.02, 2), 400.0 * hz * rng.choice([-1.0, 1.0], 2), 0.011
    rate, count, size = 100.0, 2000, 2**13
    t = np.arange(count) / rate
    first, last = rng.uniform(0.5, 1.5), rng.uniform(32.0, 40.0)
    u = np.sin(2.0 * np.pi * (first + 0.5 * (last - first) * t / t[-1]) * t)
    f = np.fft.rfftfreq(size, 1.0 / rate)
    y = np.fft.irfft(response(*plant, 2j * np.pi * f) * np.fft.rfft(u, size), size)[:count]
    y += 3e-3 * y.std() * rng.standard_normal(count)
    record = Record(
        sample_hz=rate,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=(FORCE,),
        outputs=(TIP,),
        periodic=False,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        measured = estimate_response(record)
    truth = response(*plant, 2j * np.pi * measured.frequency_hz)
    assert measured.variance is not None
    assert np.sqrt(measured.variance.max()) < 0.2 * np.abs(truth).max()
    assert np.abs(measured.H[:, 0, 0] - truth).max() < 0.2 * np.abs(truth).max()
    assert measured.frequency_hz[0] < 5.0
    assert measured.frequency_hz[-1] > 0.9 * last
    fitted = fit_response(measured, states=4)
    assert not any("unexplained" in line or "scatters" in line for line in fitted.warnings)
    np.testing.assert_allclose(np.sort(natural_hz(fitted.model)), hz, rtol=1e-3)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.8])
def test_a_sweep_that_rest_follows_keeps_its_lines(part: float) -> None:
    """It turns from line to line as little as one that ends with the record, but nothing moves at the ends:
    a response right to 1 % was left out up to 12 Hz, and modes with it."""
    rng = np.random.default_rng(77)
    rate, count, size = 100.0, 4000, 2**14
    t, last = np.arange(count) / rate, part * count / rate
    u = np.sin(2.0 * np.pi * (1.0 + 0.5 * 39.0 * t / last) * t) * (t < last)
    f = np.fft.rfftfreq(size, 1.0 / rate)
    y = np.fft.irfft(response(*PLANT, 2j * np.pi * f) * np.fft.rfft(u, size), size)[:count]
    y += 1e-3 * y.std() * rng.standard_normal(count)
    record = Record(
        sample_hz=rate,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=(FORCE,),
        outputs=(TIP,),
        periodic=False,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        measured = estimate_response(record, band_hz=(0.5, 38.0))
    truth = response(*PLANT, 2j * np.pi * measured.frequency_hz)
    assert measured.frequency_hz[[0, -1]] == pytest.approx([0.5, 38.0])
    assert np.abs(measured.H[:, 0, 0] - truth).max() < 0.05 * np.abs(truth).max()
