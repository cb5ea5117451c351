"""Spectra of a record's experiments on the lines to be fitted, each with a transient of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.errors import FitError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.problem.data import Data, Transient
from middeck.signals.record import Record

# Without a band, lines count up to where the inputs are this far (in power) below their strongest.
FAINTEST = 1e-6
# Lines over which the power of an input is averaged for that.
NEIGHBOURS = 10
# Power of a silent line over the strongest: of commands, which are known to rounding. What is measured has
# noise there, which moves no output: fitted by lines as quiet as that, a response would vanish. And how many
# driven lines a model may follow one by one, telling no noise; and the share that leaves too few others.
SILENT, FEWEST_DRIVEN, MOST_DRIVEN = 1e-12, 20, 0.8
# Share of a channel's power from which on a ramp is drift.
DRIFT = 0.1


def record_data(record: Record, band_hz: tuple[float, float] | None, *, whole: bool) -> Data:
    """Spectra of all experiments, periods taken as one run of samples; weights by each output's rms.

    Without a band, all lines but zero and the Nyquist frequency, or (not ``whole``) those that are driven.
    Raises `FitError` if none is left.
    """
    experiments, periods, samples, _ = record.u.shape
    count = periods * samples
    lines = np.arange(1, (count + 1) // 2)
    f = lines * record.sample_hz / count
    U, Y = (
        np.fft.rfft(x.reshape(experiments, count, -1), axis=1)[:, lines] / np.sqrt(count)
        for x in (record.u, record.y)
    )
    if band_hz is not None:
        keep = (f >= band_hz[0] * (1.0 - 1e-9)) & (f <= band_hz[1] * (1.0 + 1e-9))
    else:
        keep = np.ones(len(f), bool) if whole else _driven(U)
    if not keep.any():
        raise _no_line(f, record.sample_hz, band_hz)
    level = np.sqrt(np.mean(np.abs(Y[:, keep]) ** 2, axis=(0, 1)))
    weight = np.broadcast_to(1.0 / level[:, None, None], (Y.shape[2], int(keep.sum()), experiments))
    return Data(
        s=2j * np.pi * f[keep],
        H=np.moveaxis(Y[:, keep], (0, 1, 2), (2, 1, 0)),
        weight=weight,
        drive=np.moveaxis(U[:, keep], 0, 2),
        driven=driven_lines(U[:, keep], np.exp(2j * np.pi * f[keep] / record.sample_hz)),
        transient=Transient(1.0 / record.sample_hz),
    )


def _no_line(f: np.ndarray, sample_hz: float, band_hz: tuple[float, float] | None) -> FitError:
    """A rate in the wrong unit, or a step taken for a rate, puts the band beyond all lines."""
    has = f"has lines from {f[0]:.4g} to {f[-1]:.4g} Hz" if len(f) else "has no lines"
    asked = "that an input drives" if band_hz is None else f"in the band {band_hz[0]:g} to {band_hz[1]:g} Hz"
    return FitError(
        f"no line {asked}: the record, at {sample_hz:g} Hz, {has}",
        hint="check the unit of times and the sampling rate (sample_hz); or a band among these lines",
    )


def _driven(U: np.ndarray) -> np.ndarray:
    """Lines from the first to the last on which some input is not faint."""
    power = np.sum(np.abs(U) ** 2 / np.mean(np.abs(U) ** 2, axis=(0, 1)), axis=(0, 2))
    half = min(NEIGHBOURS, len(power) - 1)
    smooth = np.convolve(
        np.pad(power, half, mode="reflect"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid"
    )
    strong = np.flatnonzero(smooth > FAINTEST * smooth.max())
    return (np.arange(len(power)) >= strong[0]) & (np.arange(len(power)) <= strong[-1])


def driven_lines(
    U: Complex[np.ndarray, "experiment line input"], turn: Complex[np.ndarray, " line"]
) -> Bool[np.ndarray, " line"] | None:
    """Lines on which inputs are more than rounding and a ramp; None for few, or most. ``turn``: exp(s T).

    A signal that repeats within the record, or that leaves lines out, drives some lines only. A ramp, as is
    taken out of inputs, is on all: where half of them or more hold nothing else, their median is its size.
    """
    ramp = (1.0 / (1.0 - turn.conj()))[:, None]
    left = U - ramp * np.median(np.real(U / ramp), axis=1, keepdims=True)
    power = np.sum(np.abs(left) ** 2 / np.mean(np.abs(U) ** 2, axis=(0, 1)), axis=(0, 2))
    driven = power > SILENT * power.max()
    return driven if FEWEST_DRIVEN < np.sum(driven) < MOST_DRIVEN * len(driven) else None


def with_one_input(record: Record, *, level: bool) -> Record:
    """The record with the mean period as the input of all: differences are noise of its measurement.

    On silent lines, where that noise moves nothing, the input is then zero. Without the mean of each, if
    ``level``.
    """
    u = record.u.mean(axis=1, keepdims=True)
    u = u - u.mean(axis=2, keepdims=True) if level else u
    return dataclasses.replace(record, u=np.tile(u, (1, record.u.shape[1], 1, 1)))


def without_drift(record: Record) -> Record:
    """A record without each channel's mean, nor its ramp where that has over a tenth of its power.

    The transient of a fit has a ramp anyway; but starts, and samples held out, would suffer. A lesser ramp is
    left: it may be slow response, which a short record can ill spare.
    """

    def level(x: np.ndarray) -> np.ndarray:
        run = x.reshape(len(x), -1, x.shape[3])
        flat = run - run.mean(axis=1, keepdims=True)
        even = _without_polynomial(run, 1)
        drifts = np.sum(even**2, axis=1, keepdims=True) < (1.0 - DRIFT) * np.sum(
            flat**2, axis=1, keepdims=True
        )
        return np.where(drifts, even, flat).reshape(x.shape)

    return dataclasses.replace(record, u=level(record.u), y=level(record.y))


def without_trend(record: Record, *, inputs: bool, degree: int = 1) -> Record:
    """A record without the offset and the ramp of each output, and of each input if asked.

    The transient of a fit has a ramp anyway, so that this changes no fit; but a start, and what a model is
    compared with, would suffer. A plant with a pole at zero makes of the ramp of an input more than a ramp;
    to the second ``degree``, that of a double one, a parabola is as free.
    """
    experiments, periods, samples, _ = record.u.shape

    def level(x: np.ndarray) -> np.ndarray:
        run = x.reshape(experiments, periods * samples, -1)
        return _without_polynomial(run, degree).reshape(x.shape)

    return dataclasses.replace(record, y=level(record.y), u=level(record.u) if inputs else record.u)


def _without_polynomial(
    x: Float[np.ndarray, "run sample channel"], degree: int
) -> Float[np.ndarray, "run sample channel"]:
    """Each channel without the polynomial that fits it best."""
    powers = np.vander(np.linspace(-1.0, 1.0, x.shape[1]), degree + 1)
    Q = np.linalg.qr(powers)[0]
    return x - Q @ (Q.T @ x)


def cut_samples(record: Record, first: int, last: int) -> Record:
    """Samples ``first`` to ``last`` (exclusive) of every experiment as a record of one period."""
    experiments, periods, samples, _ = record.u.shape
    u, y = (x.reshape(experiments, 1, periods * samples, -1)[:, :, first:last] for x in (record.u, record.y))
    return dataclasses.replace(record, u=u, y=y, periodic=False)


def as_fitted(record: Record, model: MeasurementModel) -> Record:
    """A run of samples without the offsets and ramps that a fit of ``model`` takes out."""
    if model.sample_hz is not None:
        return without_drift(record)
    at_zero = model.rigid is not None or model.integral is not None or bool(np.any(model.lower))
    return without_trend(record, inputs=not at_zero)
