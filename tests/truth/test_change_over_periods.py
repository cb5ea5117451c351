"""Gains and delays that change over the periods of a record."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from struck_plant import FORCE, TIP

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.record import Record

RATE, SAMPLES = 64.0, 512


def recorded(seed: int, noise: float, *, gain: float = 0.0, late_s: float = 0.0) -> Record:
    """Two modes under a multisine, exact, each period with a gain and a delay of its own."""
    rng, periods = np.random.default_rng([57, seed]), [2, 4, 7][seed % 3]
    f = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    s, w = 2j * np.pi * f, 2.0 * np.pi * np.array([3.1, 9.7])
    U = np.where((f > 0.3) & (f < 22.0), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    H = np.sum([w0 / (s**2 + 0.02 * w0 * s + w0**2) for w0 in w], axis=0)
    grown = np.linspace(0.0, 1.0, periods)[:, None]
    y = np.fft.irfft(U * H * (1.0 + gain * grown) * np.exp(-s * late_s * grown), SAMPLES, axis=1)
    y += noise * y.std() * rng.standard_normal(y.shape)
    u = np.tile(np.fft.irfft(U, SAMPLES), (periods, 1))
    return Record(
        sample_hz=RATE, u=u[None, ..., None], y=y[None, ..., None], inputs=(FORCE,), outputs=(TIP,),
        periodic=True,
    )  # fmt: skip


def told(record: Record) -> str:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        estimate_response(record)
    return " ".join(str(one.message) for one in said)


def test_a_gain_that_drifts_over_the_periods_is_told(campaign: Callable[..., range]) -> None:
    """By two hundredths: it was 14 to 90 deviations of a mode's constant, in silence."""
    for seed in campaign(40):
        with pytest.warns(UserWarning, match=r"tip: its gain changes by \+0.02 "):
            measured = estimate_response(recorded(seed, 1e-2, gain=0.02))
        if seed == 0:
            fit = fit_response(measured, states=4)
            assert any("its gain changes" in text for text in fit.warnings)
            assert "sound" not in fit.standing


def test_a_delay_that_drifts_over_the_periods_is_told(campaign: Callable[..., range]) -> None:
    for seed in campaign(40):
        assert "delay changes by +0.5 ms" in told(recorded(seed, 1e-3, late_s=5e-4))


def test_steady_periods_are_not_told(campaign: Callable[..., range]) -> None:
    for seed in campaign(400):
        assert not told(recorded(seed, 10.0 ** -(seed % 4 + 1.0)))
