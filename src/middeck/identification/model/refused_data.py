"""Refuse what cannot be identified, by channel and reason, before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError, FitError
from middeck.signals.ports import Port
from middeck.signals.record import Record, RecordStream
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record as frozen

FEWEST_SAMPLES = 16
# Mean of |H|^2 / variance below which there is nothing but noise: that of noise alone is 1.
ALL_NOISE = 1.2
# A channel whose swing is within this share of its level is constant up to rounding.
ROUNDING = 1e-13


def check_word(what: str, word: object, words: Sequence[object]) -> None:
    """Raise `ConfigError` for an option that is none of its ``words``; None passes.

    >>> check_word("cost", "logarithmic", ("weighted", "logarithmic"))
    """
    if word is not None and word not in words:
        raise ConfigError(f"{what} {word!r} is none", hint=f"one of {', '.join(map(str, words))}")


def check_record(record: Record) -> None:
    """Raise `DataError` for a channel that is not finite or constant, and for too few samples."""
    experiments, periods, samples, _ = record.u.shape
    if record.y.shape[:3] != (experiments, periods, samples):
        raise DataError(
            f"inputs have {record.u.shape[:3]} samples, outputs {record.y.shape[:3]}",
            hint="u and y of one shape (experiment, period, sample), the channels apart",
        )
    if experiments * periods == 0 or samples < FEWEST_SAMPLES:
        raise DataError(
            f"{experiments} experiments of {periods} periods of {samples} samples are too few",
            hint=f"at least one period of {FEWEST_SAMPLES} samples",
        )
    _check_channels(record.u, record.inputs, "input")
    _check_channels(record.y, record.outputs, "output")


def _check_channels(x: np.ndarray, ports: tuple[Port, ...], side: str) -> None:
    if len(ports) != x.shape[3]:
        raise DataError(
            f"{len(ports)} {side}s are named, the record has {x.shape[3]}", hint="one Port for each channel"
        )
    for port, channel in zip(ports, np.moveaxis(x, 3, 0), strict=True):
        bad = ~np.isfinite(channel)
        if bad.any():
            e, p, k = np.argwhere(bad)[0]
            raise DataError(
                f"{bad.sum()} samples are not finite, first in experiment {e}, period {p}, sample {k}",
                where=f"{side} {port.name}",
                hint="cut the record before the gap, or repair the channel",
            )
        _check_swing(float(channel.min()), float(channel.max()), port, side)


def _check_swing(low: float, high: float, port: Port, side: str) -> None:
    if high - low <= ROUNDING * max(abs(low), abs(high)):
        raise DataError(
            f"the channel is constant at {low:.6g} {port.unit}",
            where=f"{side} {port.name}",
            hint="leave the channel out, or check its cable and its gain",
        )


@frozen
class Swing:
    """Lowest and highest sample of each channel so far, inputs first, for the checks of a stream."""

    low: Float[np.ndarray, " channel"]
    high: Float[np.ndarray, " channel"]


def widen(swing: Swing | None, z: Float[np.ndarray, "sample channel"]) -> Swing:
    """The swing with further samples of inputs and outputs."""
    low, high = z.min(axis=0), z.max(axis=0)
    return (
        Swing(low, high) if swing is None else Swing(np.minimum(low, swing.low), np.maximum(high, swing.high))
    )


def check_swing(swing: Swing | None, stream: RecordStream) -> None:
    """Raise `DataError` for a stream without samples, or with a channel that never moves."""
    if swing is None:
        raise DataError(
            "the stream has no samples",
            hint="look whether the run was recorded, and at the part that was selected",
        )
    named = [(p, "input") for p in stream.inputs] + [(p, "output") for p in stream.outputs]
    for (port, side), low, high in zip(named, swing.low, swing.high, strict=True):
        _check_swing(float(low), float(high), port, side)


def check_response(measured: FrequencyResponse, unknowns: int) -> None:
    """Raise `FitError` for a response that is not finite, constant or shorter than the unknowns.

    Raises `DataError` for a variance that is none.
    """
    if not np.isfinite(measured.H).all():
        raise FitError("the response is not finite on all lines", hint="leave the bad lines out")
    _check_variance(measured)
    if (np.diff(measured.frequency_hz) <= 0.0).any() or (measured.frequency_hz <= 0.0).any():
        raise FitError(
            "the frequencies of the response are not positive and rising",
            hint="sort the lines; leave out 0 Hz and lines given twice",
        )
    numbers = 2 * measured.H.size
    if unknowns >= numbers:
        raise FitError(
            f"{unknowns} unknowns cannot be fitted to {numbers} numbers ({len(measured.H)} lines)",
            hint="fewer states, or a longer period for more lines",
        )
    for o, output in enumerate(measured.outputs):
        row = measured.H[:, o]
        if not np.any(row):
            raise FitError(
                "the response is zero on all lines",
                where=f"output {output.name}",
                hint="leave the output out, or check its cable and gain",
            )
        variance = None if measured.variance is None else measured.variance[:, o]
        if variance is not None and _is_noise(row, variance):
            raise FitError(
                ": ".join(
                    (
                        "all lines are noise: the response is no larger than its standard deviation",
                        *measured.warnings,
                    )
                ),
                where=f"output {output.name}",
                hint="more periods, a larger excitation, or leave the output out",
            )
        if np.abs(row - row.mean(axis=0)).max() <= 1e-9 * np.abs(row).max():
            raise FitError(
                "the response is constant: there is no mode to fit",
                where=f"output {output.name}",
                hint="a gain needs no model; check that the output is not the input itself",
            )


def _is_noise(row: np.ndarray, variance: np.ndarray) -> bool:
    """Whether the lines of one output are no larger than their deviations, taken together.

    A line far less certain than the middle one counts for itself alone: past the edge of the drive a few have
    thousands of times the deviation of all others.
    """
    weight = variance + np.median(variance)
    weight = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0.0)
    return bool(np.sum(weight * np.abs(row) ** 2) < ALL_NOISE * np.sum(weight * variance))


def _check_variance(measured: FrequencyResponse) -> None:
    variance = measured.variance
    if variance is None:
        return
    bad = ~(np.isfinite(variance) & (variance >= 0.0))
    if bad.any():
        k, o, i = np.argwhere(bad)[0]
        raise DataError(
            f"the variance of {bad.sum()} entries is negative or not finite, "
            f"first {variance[k, o, i]:.6g} at {measured.frequency_hz[k]:.6g} Hz",
            where=_path(measured, o, i),
            hint="give sigma^2 of every line, zero or more; leave bad lines out, or give no variance at all",
        )


def check_logarithms(measured: FrequencyResponse) -> None:
    """Raise `DataError` for a line that is exactly zero: it has no logarithm."""
    zero = measured.H == 0.0
    if zero.any():
        k, o, i = np.argwhere(zero)[0]
        raise DataError(
            f"{zero.sum()} entries of the response are exactly zero, first at "
            f"{measured.frequency_hz[k]:.6g} Hz: they have no logarithm",
            where=_path(measured, o, i),
            hint="leave the lines out, or take cost 'weighted'",
        )


def _path(measured: FrequencyResponse, output: int, column: int) -> str:
    return f"output {measured.outputs[output].name}, input {measured.inputs[column].name}"
