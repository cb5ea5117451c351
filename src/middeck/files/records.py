"""Measured records from NPZ and CSV files, and back to NPZ."""

from __future__ import annotations

import csv
import re
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.files.atomic import replacing
from middeck.systems.ports import Port
from middeck.systems.record import Record

SCHEMA = 1
NPZ_KEYS = (
    "schema",
    "sample_hz",
    "periodic",
    "u",
    "y",
    "input_names",
    "input_units",
    "output_names",
    "output_units",
)
# Share of a time step by which a time stamp may be off: more than the rounding of printed stamps, and 0.4
# degrees of phase at a tenth of the sampling rate.
JITTER = 0.01
# Scatter of the input over its periods, as a share of their mean: signals that do not repeat have 1 and more,
# a measured input that repeats has its sensor's noise.
REPEATS = 0.5


def load_record(path: str | Path) -> Record:
    """The record in an NPZ or CSV file.

    NPZ holds ``u`` (experiment, period or 1, sample, input), ``y`` (experiment, period, sample, output),
    ``sample_hz``, ``periodic``, ``input_names``, ``input_units``, ``output_names``, ``output_units`` and
    ``schema`` = 1; an ``u`` of one period stands for all. CSV begins with a line such as
    ``time [s],u:torque [N m],y:angle [rad]`` and is one experiment of one run, not known to be periodic
    (`split_periods`).

    Raises `DataError`, naming file and channel, if the file is missing, truncated, empty or inconsistent, or
    if a sample is not a finite number.
    """
    file = Path(path)
    if not file.is_file():
        raise DataError("no such file", where=str(path), hint="check the path")
    if file.stat().st_size == 0:
        raise DataError("the file is empty", where=str(path), hint="copy or record it again")
    readers = {".npz": _read_npz, ".csv": _read_csv}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise DataError(
            f"no reader for {file.suffix!r} files", where=str(path), hint="convert to .npz or .csv"
        )
    return _checked(reader(file), str(path))


def load_records(paths: Sequence[str | Path]) -> Record:
    """Several files as the experiments of one record: same rate, ports, periods and length."""
    records = [load_record(p) for p in paths]
    if not records:
        raise DataError("no record given", hint="name at least one file")
    first = records[0]
    for path, other in zip(paths[1:], records[1:], strict=True):
        pairs = [
            ("sampling rate [Hz]", first.sample_hz, other.sample_hz),
            ("inputs", first.inputs, other.inputs),
            ("outputs", first.outputs, other.outputs),
            ("periods and samples", first.u.shape[1:3], other.u.shape[1:3]),
            ("periodic", first.periodic, other.periodic),
        ]
        for what, a, b in pairs:
            if a != b:
                raise DataError(
                    f"mismatched {what}: {_words(b)}, in {paths[0]} {_words(a)}",
                    where=str(path),
                    hint="resample or cut the files alike, or use them one at a time",
                )
    u, y = np.concatenate([r.u for r in records]), np.concatenate([r.y for r in records])
    return Record(first.sample_hz, u, y, first.inputs, first.outputs, first.periodic)


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
    return Record(record.sample_hz, u, y, record.inputs, record.outputs, periodic=True)


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


def write_record(path: str | Path, record: Record) -> None:
    """Write ``record`` as NPZ (double precision), whole or not at all."""
    contents: dict[str, Any] = {
        "schema": np.int64(SCHEMA),
        "sample_hz": np.float64(record.sample_hz),
        "periodic": np.bool_(record.periodic),
        "u": record.u,
        "y": record.y,
        "input_names": np.array([p.name for p in record.inputs]),
        "input_units": np.array([p.unit for p in record.inputs]),
        "output_names": np.array([p.name for p in record.outputs]),
        "output_units": np.array([p.unit for p in record.outputs]),
    }
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **contents)


def _words(value: object) -> str:
    if isinstance(value, tuple) and all(isinstance(v, Port) for v in value):
        return ", ".join(f"{p.name} [{p.unit}]" for p in value)
    return str(value)


def _read_npz(file: Path) -> Record:
    where = str(file)
    arrays = _npz_arrays(file)
    missing = [k for k in NPZ_KEYS if k not in arrays]
    if missing:
        raise DataError(
            f"arrays missing: {', '.join(missing)}", where=where, hint=f"it holds {', '.join(arrays)}"
        )
    if arrays["schema"].shape != () or arrays["schema"] != SCHEMA:
        raise DataError(f"schema is {arrays['schema']}, this reader knows {SCHEMA}", where=where)
    for key in ("u", "y"):
        if arrays[key].ndim != 4 or arrays[key].dtype.kind not in "fi":
            raise DataError(
                f"{key} has shape {arrays[key].shape} of {arrays[key].dtype}; must be numbers by "
                "(experiment, period, sample, channel)",
                where=where,
            )
    if arrays["sample_hz"].shape != () or arrays["sample_hz"].dtype.kind not in "fi":
        raise DataError(
            "sample_hz is not one number: channels at several rates", where=where, hint="resample"
        )
    u, y = arrays["u"], arrays["y"]
    if u.shape[1] == 1 and y.shape[1] > 1:
        u = np.repeat(u, y.shape[1], axis=1)
    inputs = _ports(arrays, "input", u.shape[3], where)
    outputs = _ports(arrays, "output", y.shape[3], where)
    if u.shape[:3] != y.shape[:3]:
        raise DataError(
            f"mismatched lengths: u has (experiment, period, sample) {u.shape[:3]}, y {y.shape[:3]}",
            where=where,
            hint="cut inputs and outputs to the same samples",
        )
    return Record(float(arrays["sample_hz"]), u, y, inputs, outputs, bool(arrays["periodic"]))


def _npz_arrays(file: Path) -> dict[str, np.ndarray]:
    try:
        # Opened here, as np.load leaves a file open that it cannot read.
        with open(file, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, AttributeError, KeyError) as error:
        # AttributeError: np.load took the file for a single array, which is no archive.
        raise DataError(
            f"truncated or not an NPZ archive: {error}", where=str(file), hint="copy or record it again"
        ) from None


def _ports(arrays: dict[str, np.ndarray], side: str, channels: int, where: str) -> tuple[Port, ...]:
    names, units = arrays[f"{side}_names"], arrays[f"{side}_units"]
    if names.shape != (channels,) or units.shape != (channels,):
        raise DataError(
            f"{names.size} names and {units.size} units for {channels} {side} channels", where=where,
            hint=f"one of {side}_names and {side}_units for each channel",
        )  # fmt: skip
    return tuple(Port(str(n), str(u)) for n, u in zip(names, units, strict=True))


def _read_csv(file: Path) -> Record:
    try:
        with open(file, encoding="utf-8-sig", newline="") as stream:
            rows = [(n, r) for n, r in enumerate(csv.reader(stream), 1) if r and not r[0].startswith("#")]
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"not CSV text: {error}", where=str(file), hint="save it as UTF-8 CSV") from None
    if not rows:
        raise DataError("the file has no lines", where=str(file), hint="copy or record it again")
    roles = _csv_header(rows[0][1], f"{file}:{rows[0][0]}")
    table = _csv_numbers(rows[1:], [name for _, name, _ in roles], file)
    columns = {side: [i for i, (role, _, _) in enumerate(roles) if role == side] for side in "uy"}
    ports = {s: tuple(Port(roles[i][1], roles[i][2]) for i in columns[s]) for s in "uy"}
    u, y = (table[None, None, :, columns[s]] for s in "uy")
    return Record(_csv_rate(table[:, 0], file), u, y, ports["u"], ports["y"], periodic=False)


def _csv_header(cells: list[str], where: str) -> list[tuple[str, str, str]]:
    """Role ("t", "u", "y"), name and unit of each column."""
    advice = "the first line must read like: time [s],u:torque [N m],y:angle [rad]"
    roles: list[tuple[str, str, str]] = []
    for index, cell in enumerate(cells):
        found = re.fullmatch(r"\s*(?:(u|y):)?\s*([^\[\]:]+?)\s*\[([^\]]*)\]\s*", cell)
        if found is None or (index > 0) != (found.group(1) is not None):
            raise DataError(f"column {index + 1} is headed {cell!r}", where=where, hint=advice)
        roles.append((found.group(1) or "t", found.group(2), found.group(3).strip()))
    if roles[0][1:] != ("time", "s"):
        raise DataError(f"the first column is {cells[0]!r}, not time [s]", where=where, hint=advice)
    return roles


def _csv_numbers(rows: list[tuple[int, list[str]]], names: list[str], file: Path) -> np.ndarray:
    table = np.empty((len(rows), len(names)))
    for k, (line, cells) in enumerate(rows):
        if len(cells) != len(names):
            raise DataError(
                f"mismatched lengths: {len(cells)} values for {len(names)} columns",
                where=f"{file}:{line}",
                hint="the file may be truncated here; cut or mend the line",
            )
        try:
            table[k] = [float(c) for c in cells]
        except ValueError as error:
            raise DataError(
                str(error), where=f"{file}:{line}", hint="numbers with a decimal point only"
            ) from None
    return table


def _csv_rate(time: Float[np.ndarray, " sample"], file: Path) -> float:
    """Sampling rate [Hz]; refuses a column that does not rise by even steps."""
    if len(time) < 2:
        raise DataError(f"{len(time)} samples give no sampling rate", where=str(file), hint="record longer")
    if not np.isfinite(time).all():
        raise DataError("time is not finite", where=f"{file}, sample {int(np.argmin(np.isfinite(time)))}")
    step = (time[-1] - time[0]) / (len(time) - 1)
    late = np.abs(time - time[0] - step * np.arange(len(time)))
    if step <= 0.0 or late.max() > JITTER * step:
        worst = int(late.argmax())
        raise DataError(
            f"uneven time steps: sample {worst} is {late[worst]:.3g} s off steps of {step:.6g} s",
            where=f"{file}, channel time",
            hint="resample all channels to one rate",
        )
    return float(f"{1.0 / step:.9g}")  # decimal stamps carry no more digits


def _checked(record: Record, where: str) -> Record:
    """Refuse records without channels or samples, without a rate, or with samples that are not finite."""
    if record.u.shape[3] == 0 or record.y.shape[3] == 0:
        side = "input" if record.u.shape[3] == 0 else "output"
        raise DataError(f"no {side} channels", where=where, hint="name at least one input u and one output y")
    if 0 in record.u.shape:
        raise DataError(f"no samples: u has shape {record.u.shape}", where=where, hint="record it again")
    if not (np.isfinite(record.sample_hz) and record.sample_hz > 0.0):
        raise DataError(f"sample_hz is {record.sample_hz}; must be > 0 Hz", where=where)
    for ports, x in ((record.inputs, record.u), (record.outputs, record.y)):
        names = [p.name for p in ports]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise DataError(f"two channels are named {twice[0]!r}", where=where, hint="rename one of them")
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
