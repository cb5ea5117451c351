"""The zero-order hold of a computer's commands, and responses and records without it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse, ResponseCovariance


def hold_response(frequency_hz: Float[np.ndarray, " line"], period_s: float) -> Complex[np.ndarray, " line"]:
    """(1 - exp(-s T)) / (s T) at s = j omega: delayed by T / 2, attenuated by sin(x) / x, x = omega T / 2.

    >>> H = hold_response(np.array([0.0, 25.0]), 0.01)
    >>> H[0] == 1.0, round(float(np.degrees(np.angle(H[1]))), 9)
    (np.True_, -45.0)
    """
    turns = np.asarray(frequency_hz, dtype=float) * period_s
    return np.sinc(turns) * np.exp(-1j * np.pi * turns)


def release_hold(measured: FrequencyResponse) -> FrequencyResponse:
    """The response with the hold of its inputs divided out: that of the plant behind it, up to aliasing.

    A response without a hold, or with an unknown one, is returned unchanged.
    """
    if not measured.hold_s:
        return measured
    hold = hold_response(measured.frequency_hz, measured.hold_s)[:, None, None]
    power = np.abs(hold) ** 2
    known = measured.covariance
    return dataclasses.replace(
        measured,
        H=measured.H / hold,
        variance=None if measured.variance is None else measured.variance / power,
        covariance=None if known is None else ResponseCovariance(known.outputs / power, known.inverse_power),
        hold_s=0.0,
    )


def release_inputs(record: Record) -> Record:
    """The record with its inputs as they leave the hold, up to half the rate; outputs unchanged.

    A record without a hold, or with an unknown one, is returned unchanged.
    """
    if not record.held:
        return record
    run = record.u if record.periodic else record.u.reshape(len(record.u), 1, -1, record.u.shape[3])
    samples = run.shape[2]
    hold = hold_response(np.fft.rfftfreq(samples), 1.0)
    u = np.fft.irfft(np.fft.rfft(run, axis=2) * hold[:, None], n=samples, axis=2)
    return dataclasses.replace(record, u=u.reshape(record.u.shape), held=False)
