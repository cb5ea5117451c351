"""Measured records from NPZ, HDF5, MAT, CSV and universal files, or runs of the engine; streamed; and back.

record = load_record("run.mat", name_columns(["torque [N m]"], ["angle [rad]"], sample_hz=256.0))
stream = open_record("night.h5")
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import DataError
from middeck.files.disk.kind_of_content import NO_RECORD, looks_like
from middeck.files.records.columns import Columns, columns_beside, name_columns
from middeck.files.records.experiments_and_periods import (
    check_channels,
    check_finite,
    check_shape,
    join_records,
    split_periods,
)
from middeck.files.records.formats import HDF5, RUN, SUFFIXES, UFF, reader_of, unknown_ending
from middeck.files.records.raw import build_record
from middeck.signals.fault import RecordFault
from middeck.signals.record import Campaign, Record, RecordStream, stream_record
from middeck.values import record

if TYPE_CHECKING:
    from middeck.systems.plants.response import FrequencyResponse

__all__ = [
    "Columns",
    "Reading",
    "check_finite",
    "join_records",
    "load_campaign",
    "load_record",
    "load_records",
    "load_response",
    "name_columns",
    "open_record",
    "read_record",
    "split_periods",
    "write_record",
    "write_response",
    "write_stream",
]


@record
class Reading:
    """A record as its file has it, NaN samples included, and the faults that the reader found."""

    record: Record
    faults: tuple[RecordFault, ...]


@named_kinds
def load_record(path: str | Path, columns: Columns | None = None) -> Record:
    """The record in a file; its ending gives the kind (docs/how-to/your-own-record.md describes each).

    ``columns`` (`name_columns`), or else a TOML file beside it, adds what the file lacks: rate, inputs and
    outputs, names, units and transducers.

    Raises `DataError`, naming file and channel, if the file is missing, truncated, empty or inconsistent, or
    if a sample is not a finite number; `ConfigError` for a wrong TOML file. Warns of what the reader doubts,
    such as a last number that was cut, or times that are hardly seconds.
    """
    found = read_record(path, columns)
    taken = check_finite(found.record, str(path))
    for fault in found.faults:
        if fault.severity != "note":
            warnings.warn(f"{path}: {fault.in_a_line}", stacklevel=3)
    return taken


def read_record(path: str | Path, columns: Columns | None = None) -> Reading:
    """`load_record` for records with gaps: missing samples are NaN, and `Reading.faults` says which.

    Raises `DataError` and `ConfigError` as `load_record` does, but for samples that are not finite.
    """
    file = require_record(path)
    named = columns if columns is not None else columns_beside(file)
    raw = reader_of(file)(file, "" if named is None else named.variable)
    taken = build_record(raw, named, str(path))
    stated = named is not None and named.sample_hz is not None
    # Times that agree with a stated rate leave no doubt of it.
    faults = (f for f in raw.faults if not (stated and f.kind == "rate"))
    return Reading(check_shape(taken, str(path)), tuple(faults))


def load_records(paths: Sequence[str | Path], columns: Columns | None = None) -> Record:
    """Several files as the experiments of one record: same rate, ports, periods and length."""
    return join_records([load_record(p, columns) for p in paths], [str(p) for p in paths])


def load_campaign(paths: Sequence[str | Path], columns: Columns | None = None) -> Campaign:
    """Files of one test article whose experiments may differ in length and kind.

    Raises `DataError` as `load_record` does, and for unlike rates or channels.
    """
    if isinstance(paths, (str, Path)):  # whose letters would be taken for files
        paths = [paths]
    return Campaign(tuple(r for p in paths for r in _experiments(p, columns)))


def _experiments(path: str | Path, columns: Columns | None) -> list[Record]:
    """One record, or one for each experiment of a universal file, where they may differ in length."""
    file = require_record(path)
    if file.suffix.lower() not in UFF:
        return [load_record(path, columns)]
    from middeck.files.records.uff import raw_run, read_runs

    named = columns if columns is not None else columns_beside(file)
    taken = [build_record(raw_run(file, run), named, str(path)) for run in read_runs(file)]
    return [check_finite(check_shape(r, str(path)), str(path)) for r in taken]


def load_response(path: str | Path) -> FrequencyResponse:
    """The frequency responses (function type 4) of a universal file.

    Outputs are the response ends, inputs the reference ends. A line at 0 Hz is left out, with a warning.

    Raises `DataError` if there are none, if one is missing between an input and an output, or if their
    frequencies differ.
    """
    from middeck.files.records.uff import read_response

    return read_response(require_record(path))


@named_kinds
def open_record(path: str | Path, columns: Columns | None = None) -> RecordStream:
    """The record in a file as a stream of blocks, for one that is longer than memory.

    NPZ, HDF5, CSV and universal files are read piece by piece; MAT, NPY and run files are held whole. Raises
    `DataError` and `ConfigError` as `load_record` does; what is wrong with samples is found as they are read.
    """
    from middeck.files.records import streams

    file = require_record(path)
    named = columns if columns is not None else columns_beside(file)
    openers = {".npz": streams.stream_npz, ".csv": streams.stream_csv}
    openers |= dict.fromkeys(UFF, streams.stream_uff) | dict.fromkeys(HDF5, streams.stream_hdf5)
    opener = openers.get(file.suffix.lower())
    if opener is None or (named is not None and named.variable):
        return stream_record(load_record(path, named))
    stream = opener(file, named)
    check_channels(stream.sample_hz, stream.inputs, stream.outputs, str(path))
    if stream.samples < 1:
        raise DataError("no samples", where=str(path), hint="record it again")
    return stream


def write_record(path: str | Path, record: Record, *, ascii: bool = False) -> None:
    """Write ``record``, whole or not at all; the ending says as which kind (not NPY or a run).

    Every kind but ASCII universal files (``ascii``; 13 digits) keeps every digit of the samples; CSV keeps
    nine of the rate, and not whether inputs were held. Raises `DataError` for what the kind cannot hold.
    """
    file, suffix = Path(path), Path(path).suffix.lower()
    match suffix:
        case ".npz":
            from middeck.files.records.npz import write_npz as write
        case ".mat":
            from middeck.files.records.mat import write_mat as write
        case ".h5" | ".hdf5":
            from middeck.files.records.hdf5 import write_hdf5 as write
        case ".csv":
            return write_stream(path, stream_record(record))
        case _ if suffix in UFF:
            from middeck.files.records.uff import write_uff

            return write_uff(file, record, binary=not ascii)
        case _:
            raise unknown_ending(file, "writer", [s for s in SUFFIXES if s not in (".npy", RUN)])
    write(file, record)


def write_response(path: str | Path, response: FrequencyResponse, *, ascii: bool = False) -> None:
    """Write the frequency responses as data sets 58b (58 if ``ascii``) of a universal file, type 4.

    Every digit is kept but in ASCII: 13 of the response, and 7 of frequencies that are not evenly spaced. The
    variance is not, as the format has no place for it, nor for warnings, nor, if a line of text is full, for
    a hold of the inputs: what would be read again without them is warned of. Raises `DataError` for another
    ending, a name or unit that is too long, or values that are not finite.
    """
    from middeck.files.records.uff import write_uff_response

    file = Path(path)
    if file.suffix.lower() not in UFF:
        raise unknown_ending(file, "writer of responses", UFF)
    if not (np.isfinite(response.H).all() and len(response.H)):
        raise DataError("a response without lines, or not finite", where=str(path), hint="leave lines out")
    write_uff_response(file, response, binary=not ascii)
    for what in _not_kept(response):
        warnings.warn(f"{path}: {what}", UserWarning, stacklevel=2)


def _not_kept(response: FrequencyResponse) -> list[str]:
    from middeck.files.records.uff import keeps_hold

    found = [f"the file does not keep a warning on the response: {what}" for what in response.warnings]
    if not keeps_hold(response):
        found.append(
            "the file does not say that the inputs were held, and a fit of it has the hold in its delay and "
            f"its gains; set hold_s={response.hold_s!r} in what is read again"
        )
    return found


def write_stream(path: str | Path, stream: RecordStream) -> None:
    """Write a stream as HDF5 or, if it is one experiment, as CSV, without holding it."""
    file = Path(path)
    if file.suffix.lower() in HDF5:
        from middeck.files.records.hdf5 import write_hdf5_stream as write
    elif file.suffix.lower() == ".csv":
        from middeck.files.records.csv_text import write_csv as write
    else:
        raise unknown_ending(file, "writer of streams", [*HDF5, ".csv"])
    write(file, stream)


def require_record(path: str | Path) -> Path:
    """The path of a file that may hold a record; `DataError` for what is missing, empty or something else."""
    file = Path(path)
    if file.is_dir():
        raise DataError("is a folder, not a file", where=str(path), hint="name the record in it")
    if not file.is_file():
        raise DataError("no such file", where=str(path), hint="check the path")
    if file.stat().st_size == 0:
        raise DataError("the file is empty", where=str(path), hint="copy or record it again")
    kind = looks_like(path)
    if kind in NO_RECORD:
        raise DataError(
            f"looks like {kind}, not a record", where=str(path), hint=f"one of {', '.join(SUFFIXES)}"
        )
    return file
