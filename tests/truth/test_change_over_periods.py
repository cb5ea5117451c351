"""Gains and delays that change over the periods of a record."""

from __future__ import annotations

import dataclasses
import re
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from struck_plant import FORCE, TIP

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.record import Record
from middeck.systems.plants.response import in_band

RATE, SAMPLES = 64.0, 512


def recorded(
    seed: int, noise: float, *, gain: float = 0.0, late_s: float = 0.0, from_rest: float = 0.0
) -> Record:
    """Two modes under a multisine, exact, each period with a gain and a delay of its own.

    Free motion of the modes, ``from_rest`` times the response, dies out from the first sample on.
    """
    rng, periods = np.random.default_rng([57, seed]), [2, 4, 7][seed % 3]
    f = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    s, w = 2j * np.pi * f, 2.0 * np.pi * np.array([3.1, 9.7])
    U = np.where((f > 0.3) & (f < 22.0), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    H = np.sum([w0 / (s**2 + 0.02 * w0 * s + w0**2) for w0 in w], axis=0)
    grown = np.linspace(0.0, 1.0, periods)[:, None]
    y = np.fft.irfft(U * H * (1.0 + gain * grown) * np.exp(-s * late_s * grown), SAMPLES, axis=1)
    t = np.arange(y.size) / RATE
    free = np.sum([np.exp(-0.01 * w0 * t) * np.sin(w0 * t + k) for k, w0 in enumerate(w)], axis=0)
    y += from_rest * y.std() * free.reshape(y.shape)
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


def test_a_change_is_told_beside_a_transient_and_in_a_run(campaign: Callable[..., range]) -> None:
    """A record that began at rest, or was not said to be periods, was asked for no change."""
    for seed in campaign(40):
        begun = recorded(seed, 1e-2, gain=0.05, from_rest=0.5)
        assert re.search(r"transient.* its gain changes by at least \+0.0[12]", told(begun))
        run = recorded(seed, 1e-2, gain=0.03)
        u, y = (x.reshape(1, 1, -1, 1) for x in (run.u, run.y))
        run = dataclasses.replace(run, u=u, y=y, periodic=False)
        assert re.search(r"its gain changes by (at least )?\+0.0[123]", told(run))


def test_transients_are_no_changes(campaign: Callable[..., range]) -> None:
    for seed in campaign(100):
        assert "changes" not in told(recorded(seed, 10.0 ** -(seed % 4 + 1.0), from_rest=0.5))


def test_lines_in_a_band_keep_what_is_known_of_all() -> None:
    """Warnings, the hold and the covariance were lost, and a fit of a part in a band was sound in silence."""
    taken = dataclasses.replace(recorded(1, 1e-2, gain=0.02), held=True)
    with pytest.warns(UserWarning, match="gain changes"):
        measured = estimate_response(taken)
    part = in_band(measured, (1.0, 12.0))
    assert (part.warnings, part.hold_s) == (measured.warnings, 1.0 / RATE)
    assert part.warnings
    assert part.covariance is not None
    assert len(part.covariance.outputs) == len(part.covariance.inverse_power) == len(part.H)


def test_steady_periods_are_not_told(campaign: Callable[..., range]) -> None:
    for seed in campaign(400):
        assert not told(recorded(seed, 10.0 ** -(seed % 4 + 1.0)))
