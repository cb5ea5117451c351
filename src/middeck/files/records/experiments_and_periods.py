"""Checks of every record, several experiments together, and runs cut into periods."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.signals.ports import Port, same_ports
from middeck.signals.record import Record

# Scatter of the input over its periods, as a share of their mean: signals that do not repeat have 1 and more,
# a measured input that repeats has its sensor's noise.
REPEATS = 0.5
# What makes records alike that differ in this.
ALIKE = {
    "sampling rate [Hz]": "resample them alike",
    "inputs": "name the channels and their units alike",
    "outputs": "name the channels and their units alike",
    "periods and samples": "cut them alike",
}


def join_records(records: Sequence[Record], names: Sequence[str]) -> Record:
    """``records`` as the experiments of one; raises `DataError` unless they are of one form."""
    if not records:
        raise DataError("no record given", hint="name at least one file")
    first = records[0]
    for name, other in zip(names[1:], records[1:], strict=True):
        pairs = [
            ("sampling rate [Hz]", first.sample_hz, other.sample_hz, other.sample_hz == first.sample_hz),
            ("inputs", first.inputs, other.inputs, same_ports(first.inputs, other.inputs)),
            ("outputs", first.outputs, other.outputs, same_ports(first.outputs, other.outputs)),
            (
                "periods and samples",
                *(_length(r) for r in (first, other)),
                first.u.shape[1:3] == other.u.shape[1:3],
            ),
            ("periodic", first.periodic, other.periodic, first.periodic == other.periodic),
            (
                "held inputs",
                first.held,
                other.held,
                None in (first.held, other.held) or first.held == other.held,
            ),
        ]
        for what, a, b, same in pairs:
            if not same:
                raise DataError(
                    f"mismatched {what}: {_words(b)}, in {names[0]} {_words(a)}",
                    where=name,
                    hint=f"{ALIKE.get(what, 'record them alike')}, or use the files one at a time",
                )
    for k, (name, other) in enumerate(zip(names, records, strict=True)):
        twin = next((i for i in range(k) if np.array_equal(other.y, records[i].y)), None)
        if twin is not None:
            what = f"the same samples as {names[twin]}: one test counts once"
            raise DataError(what, where=name, hint="leave one of them out")
    u, y = np.concatenate([r.u for r in records]), np.concatenate([r.y for r in records])
    held = first.held if all(r.held == first.held for r in records) else None
    return dataclasses.replace(first, u=u, y=y, held=held)


def _length(record: Record) -> str:
    periods, samples = record.u.shape[1:3]
    return f"{samples} samples" if periods == 1 else f"{periods} periods of {samples} samples"


def _words(value: object) -> str:
    if isinstance(value, tuple) and all(isinstance(v, Port) for v in value):
        return ", ".join(f"{p.name} [{p.unit}]" for p in value)
    return str(value)


def split_periods(record: Record, periods: int) -> Record:
    """``record``, one run of samples, as the whole steady ``periods`` that it is known to hold.

    Raises `DataError` if it is cut already, if the samples are not so many equal periods, or if the input
    does not repeat from one to the next.
    """
    held, samples = record.u.shape[1:3]
    if held == periods and record.periodic:
        return record
    if held != 1:
        raise DataError(f"the record is cut into {held} periods, not {periods}", hint="leave periods out")
    if samples % periods:
        raise DataError(
            f"{samples} samples are not {periods} whole periods", hint="count the periods, or cut the record"
        )
    u, y = (x.reshape(len(x), periods, samples // periods, -1) for x in (record.u, record.y))
    _check_repeats(u, record.inputs)
    return dataclasses.replace(record, u=u, y=y, periodic=True)


def _check_repeats(u: Float[np.ndarray, "experiment period sample input"], inputs: Sequence[Port]) -> None:
    mean = u.mean(axis=1, keepdims=True)
    scatter = np.sqrt(np.mean((u - mean) ** 2, axis=(1, 2)))
    size = np.sqrt(np.mean((mean - u.mean(axis=(1, 2), keepdims=True)) ** 2, axis=(1, 2)))
    for e, i in np.argwhere(scatter > REPEATS * size):
        raise DataError(
            f"the input does not repeat: it scatters by {scatter[e, i] / size[e, i]:.0%} of its mean period",
            where=f"input {inputs[i].name}, experiment {e}",
            hint="count the periods; record only steady ones",
        )


def check_channels(sample_hz: float, inputs: Sequence[Port], outputs: Sequence[Port], where: str) -> None:
    """Refuse records without channels on a side, with two of one name, or without a rate."""
    for side, ports in (("input", inputs), ("output", outputs)):
        if not ports:
            hint = 'name both: name_columns(["torque [N m]"], ["angle [rad]"])'
            there = ", ".join(p.name for p in (*inputs, *outputs)[:9])
            raise DataError(f"no {side} channels; there is {there or 'none'}", where=where, hint=hint)
        names = [p.name for p in ports]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise DataError(f"two channels are named {twice[0]!r}", where=where, hint="rename one of them")
    if not (np.isfinite(sample_hz) and sample_hz > 0.0):
        raise DataError(f"sample_hz is {sample_hz}; must be > 0 Hz", where=where, hint="state the rate")


def check_shape(record: Record, where: str) -> Record:
    """``record``, unless it has no samples."""
    if 0 in record.u.shape:
        raise DataError(f"no samples: u has shape {record.u.shape}", where=where, hint="record it again")
    return record


def check_finite(record: Record, where: str) -> Record:
    """``record``, unless a sample is not a finite number."""
    for ports, x in ((record.inputs, record.u), (record.outputs, record.y)):
        for port, channel in zip(ports, np.moveaxis(x, 3, 0), strict=True):
            bad = np.argwhere(~np.isfinite(channel))
            if len(bad):
                e, p, k = bad[0]
                raise DataError(
                    f"{len(bad)} samples are not finite numbers, the first in experiment {e}, period {p}, "
                    f"sample {k}",
                    where=f"{where}, channel {port.name}",
                    hint="cut the record before the gap or repair the channel",
                )
    return record
