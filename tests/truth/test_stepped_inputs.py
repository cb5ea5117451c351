"""Inputs in steps are commands that were held, also where the record does not say so."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter
from sine_record import record_of

from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.undeclared_hold import are_steps
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.signals.record import Record
from repeats import repeats

RATE, DELAY_S = 100.0, 0.01


def binary(seed: int, noise: float, samples: int = 600) -> tuple[Record, np.ndarray, np.ndarray]:
    """Light modes under held levels of four samples, exactly; their frequencies and constants."""
    rng = np.random.default_rng([91, seed])
    hz, zeta = np.array([5.2, 11.7]), np.array([0.004, 0.01])
    constants = rng.choice([-1.0, 1.0], 2) * rng.uniform(0.4, 1.0, 2) * hz**2
    u = np.repeat(rng.choice([-1.0, 1.0], (samples + 400) // 4), 4)
    y = np.zeros(len(u))
    for w, z, constant in zip(2.0 * np.pi * hz, zeta, constants, strict=True):
        pole = w * complex(-z, np.sqrt(1.0 - z * z))
        step = np.exp(pole / RATE)
        # A held force over one sample moves q' = p q + u by (e^pT - 1) / p.
        motion = lfilter([0.0, (step - 1.0) / pole], [1.0, -step], u)
        y += constant * motion.imag / pole.imag
    u, y = u[400:], np.concatenate([[0.0], y[:-1]])[400:]  # a delay of one sample
    return record_of(u, y + noise * y.std() * rng.standard_normal(samples)), hz, constants


@pytest.mark.parametrize("noise", repeats([0.15, 1e-2]))
def test_steps_are_held_though_the_record_does_not_say_so(
    noise: float, campaign: Callable[..., range]
) -> None:
    """The delay was half a sample too long, 60 to 300 deviations, a constant 16 too small, in silence."""
    for seed in campaign(20, 10):
        record, hz, constants = binary(seed, noise)
        fit = fit_record(record, states=4)
        known, order = parameters_of(fit.covariance), np.argsort(natural_hz(fit.model))
        at = [known.names.index(f"constant[{m}, tip, force]") for m in order]
        of = fit.uncertainty
        off = [
            *(known.values[at] - constants) / known.deviation[at],
            *(natural_hz(fit.model)[order] - hz) / of.natural_hz[order],
            *(fit.model.delay_s - DELAY_S) / of.delay_s,
        ]
        assert np.abs(off).max() < 4.5
        assert "given in steps" in fit.order_reason


def test_what_is_measured_is_not_in_steps() -> None:
    record = binary(0, 0.0)[0]
    noise = 1e-6 * np.random.default_rng(0).standard_normal(record.u.shape)
    release = np.where(np.arange(record.u.shape[2]) < 100, 1.0, 0.0)[None, None, :, None]
    assert are_steps(record)
    assert not are_steps(dataclasses.replace(record, u=record.u + noise))
    assert not are_steps(dataclasses.replace(record, u=release))


def test_rest_is_no_step() -> None:
    """Rest after blows, a burst or a sweep: half a sample was in the delay, in silence. Codes may toggle."""
    record, time = binary(0, 0.0)[0], np.arange(2000.0)
    rng = np.random.default_rng(3)
    blows = np.maximum(1.0 - ((time % 500.0 - 20.0) / 4.0) ** 2, 0.0)
    burst = np.where(time < 900.0, rng.standard_normal(2000), 0.0)
    sweep = np.where(time < 900.0, np.sin(1e-3 * time**2), 0.0)
    codes = np.round(50.0 * blows + 0.5 + 0.3 * rng.standard_normal(2000))
    for u in (blows, burst, sweep, codes):
        given = dataclasses.replace(
            record, u=u[None, None, :, None], y=record.y[:, :, :1].repeat(2000, axis=2)
        )
        assert not are_steps(given)


@pytest.mark.parametrize("pulses", [5, 7, 9])
def test_few_pulses_are_steps(pulses: int) -> None:
    """Jumps to rest count as those from rest: five to nine pulses were taken as band-limited."""
    starts = np.sort(np.random.default_rng(pulses).choice(np.arange(10, 570, 20), pulses, replace=False))
    train = np.zeros(600)
    for start in starts:
        train[start : start + 7] = 1.0
    assert are_steps(record_of(train, train))
    assert not are_steps(record_of(train[: starts[4]], train[: starts[4]]))
