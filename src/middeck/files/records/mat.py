"""MATLAB records: version 5 by SciPy, version 7.3 as the HDF5 that it is."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp
from scipy.io.matlab import MatlabOpaque

from middeck.errors import DataError
from middeck.files.disk.atomic import replacing
from middeck.files.records.columns import Side
from middeck.files.records.hdf5 import opened, pick, plain
from middeck.files.records.own_layout import build_raw, contents_of, is_own
from middeck.files.records.raw import SAME_RATE, ChannelHeader, Raw, channel_fault, raw_matrix
from middeck.files.records.stamps import (
    is_even,
    last_digit,
    mean_step,
    open_share,
    rate_of,
    warning_on_seconds,
)
from middeck.signals.fault import RecordFault
from middeck.signals.record import Record

# Variables of a system in state space, as `write_mat` and other programs write it.
SYSTEM = frozenset("ABCD")
SIDES: dict[str, Side] = {"u": "input", "y": "output"}
RATES = ("fs", "Fs", "Ts", "sample_hz")
TIMES = ("t", "time", "Time")
LINES = 8192  # lines whose stamps show the last digit
# Version 5 counts bytes in 32 bits.
MOST_BYTES = 2**31
SPARSE = "MATLAB_sparse"  # attribute of a group: the number of rows
MOST_FILLED = 2**26  # entries of a sparse matrix that is filled: half a gigabyte


def read_mat(file: Path, variable: str) -> Raw:
    """A record of the package's layout, u and y with fs or Ts, or the matrix ``variable``, of either version.

    A field of a structure is named with it: ``run.force``. If one structure alone has u and y, it is the run,
    at the rate that it or what lies beside it states.
    """
    arrays = mat_arrays(file)
    stem = "" if variable else _run_of(arrays)
    fields = {name.removeprefix(stem): x for name, x in arrays.items() if name.startswith(stem)}
    if is_own(list(fields)) and not variable:
        stated = _stated(arrays, stem)
        _refuse_rates(_rates(stated), stated, SAME_RATE, file)
        return build_raw({k: _four_axes(v) if k in ("u", "y") else v for k, v in fields.items()}, str(file))
    if set(fields) >= SYSTEM and not variable:
        raise DataError(
            "is a linear system in state space (a plant, a fitted model or a compensator), not a record",
            where=str(file),
            hint="`qualify` takes one as plant or law; for the other verbs keep models and laws as JSON",
        )
    if {"u", "y"} <= set(fields) and not variable:
        return _sides(arrays, stem, file)
    return raw_matrix(arrays[pick(arrays, variable, file)], file)


def _run_of(arrays: dict[str, np.ndarray]) -> str:
    """Beginning of the names in the one structure that has u and y: ``run.``.

    Empty where there is none or several are, or where another u or y lies beside it.
    """
    stems = [name[:-1] for name in arrays if name.endswith(".u") and f"{name[:-1]}y" in arrays]
    outer = [level for stem in stems for level in _levels(stem)[1:]]
    alone = len(stems) == 1 and not any(f"{level}{name}" in arrays for level in outer for name in SIDES)
    return stems[0] if alone else ""


def _levels(stem: str) -> list[str]:
    """Beginnings of the names in a structure, and in those that it lies in: ``e.run.``, ``e.`` and none."""
    parts = stem.split(".")[:-1]
    return ["".join(f"{part}." for part in parts[:k]) for k in range(len(parts), -1, -1)]


def _sides(arrays: dict[str, np.ndarray], stem: str, file: Path) -> Raw:
    """One run in u and y [sample, channel], with the rate fs [Hz], the period Ts [s] or the times t [s]."""
    heads: list[ChannelHeader] = []
    columns: list[np.ndarray] = []
    for name, side in SIDES.items():
        value = arrays[f"{stem}{name}"]
        matrix = raw_matrix(value.reshape(-1, 1) if value.ndim == 2 and len(value) == 1 else value, file)
        width = len(matrix.x)
        heads += [ChannelHeader(name if width == 1 else f"{name}{k}", "", side) for k in range(1, width + 1)]
        columns += matrix.x
    lengths = sorted({x.size for x in columns})
    if len(lengths) > 1:
        what = f"u and y have {lengths[0]} and {lengths[-1]} samples"
        raise DataError(what, where=str(file), hint="samples in rows, as many of each")
    sample_hz, share, faults = _rate(arrays, stem, lengths[0], heads[0], file)
    return Raw(sample_hz=sample_hz, heads=tuple(heads), x=tuple(columns), rate_share=share, faults=faults)


def _rate(
    arrays: dict[str, np.ndarray], stem: str, samples: int, head: ChannelHeader, file: Path
) -> tuple[float | None, float, tuple[RecordFault, ...]]:
    """The rate [Hz] of all that states one, None where nothing does; the share that it leaves open."""
    stated = _stated(arrays, stem)
    rates = _rates(stated)
    share, faults = SAME_RATE, ()
    times = {n: x.ravel() for n, x in _around(arrays, stem, TIMES).items() if x.size == samples > 1}
    for name, time in times.items():
        rate, digit = _rate_of_times(time, f"{file}, {name}")
        rates[name], share = rate, max(share, open_share(rate, samples, digit))
        if not stated:
            doubt = warning_on_seconds(rate, rate == 1.0, float(time[0]))
            what = doubt or f"the times {name}, taken as seconds, give {rate:.9g} Hz: no fs or Ts is there"
            hint = "state the rate (fs or Ts) if it is another one"
            faults = (channel_fault("rate", "serious" if doubt else "note", head, what, hint),)
    _refuse_rates(rates, stated, share, file)
    doubts = () if times else _warnings_on_rates(stated, head)  # the times say the same rate
    return next(iter(rates.values()), None), share, faults or doubts


def _warnings_on_rates(stated: dict[str, float], head: ChannelHeader) -> tuple[RecordFault, ...]:
    """A fault where a rate below 1 Hz is stated: rather a period as fs, or a rate as Ts."""
    rates = _rates(stated)
    slow = next((n for n in stated if rates[n] < 1.0), None)
    if slow is None:
        return ()
    meant, hz = ("period", 1.0 / stated[slow]) if rates[slow] == stated[slow] else ("rate", stated[slow])
    what = f"{slow} = {stated[slow]:g} means {rates[slow]:.6g} Hz: if it is a {meant}, it is {hz:.6g} Hz"
    hint = "fs, Fs and sample_hz are rates [Hz], Ts is a period [s]: rename it, unless it is meant so"
    return (channel_fault("rate", "serious", head, what, hint),)


def _around(arrays: dict[str, np.ndarray], stem: str, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Arrays of these ``names`` in the structure and beside it, the innermost first, by full names."""
    every = [f"{level}{name}" for level in _levels(stem) for name in names]
    return {name: arrays[name] for name in every if name in arrays}


def _stated(arrays: dict[str, np.ndarray], stem: str) -> dict[str, float]:
    return {n: float(x.item()) for n, x in _around(arrays, stem, RATES).items() if x.size == 1}


def _rates(stated: dict[str, float]) -> dict[str, float]:
    """Rates [Hz] of what is ``stated``, some of it periods [s]."""
    return {n: 1.0 / v if n.rpartition(".")[2] == "Ts" and v else v for n, v in stated.items()}


def _refuse_rates(rates: dict[str, float], stated: dict[str, float], share: float, file: Path) -> None:
    """Raise `DataError` unless all ``rates`` are one, up to a ``share`` of it."""
    first = next(iter(rates.values()), 1.0)
    if all(np.isfinite(r) and r > 0.0 and abs(r / first - 1.0) <= share for r in rates.values()):
        return
    each = ", ".join(f"{n} = {stated[n]:g}" if n in stated else f"{n} for {r:g} Hz" for n, r in rates.items())
    raise DataError(f"no one sampling rate: {each}", where=str(file), hint="fs [Hz], or Ts = 1 / fs [s]")


def _rate_of_times(time: np.ndarray, where: str) -> tuple[float, float]:
    """The rate [Hz] of even stamps, and a unit of their last digit [s]; refuses others."""
    if time.dtype.kind not in "fiu":
        raise DataError(f"times of {time.dtype}", where=where, hint="numbers, in seconds")
    digit = last_digit(str(t) for t in time[:LINES])
    since = time.astype(float) - float(time[0])
    index = np.arange(len(since))
    step = mean_step(float(index @ since), float(since.sum()), len(since))
    if not (np.isfinite(since).all() and is_even(since, index, step, digit)):
        hint = "resample; if they are no times, leave the array out and state fs [Hz]"
        raise DataError("times that are not in even steps", where=where, hint=hint)
    return rate_of(step, len(since), digit), digit


def mat_arrays(file: Path) -> dict[str, np.ndarray]:
    """All variables by name, of either version; those of a structure as ``run.force``, cells as texts."""
    with open(file, "rb") as stream:
        begin = stream.read(19)
    if begin.startswith((b"# Created by Octave", b"Octave-1", b"\x89HDF")):
        raise DataError("Octave's own form or HDF5, not a MAT file", where=str(file), hint="save it with -v7")
    return _read_73(file) if begin == b"MATLAB 7.3 MAT-file" else _read_5(file)


def _four_axes(x: np.ndarray) -> np.ndarray:
    """MATLAB drops axes of one at the end: one output, one sample."""
    return x.reshape(*x.shape, *(1,) * (4 - x.ndim)) if x.ndim < 4 else x


def _read_5(file: Path) -> dict[str, np.ndarray]:
    try:
        content = scipy.io.loadmat(str(file), chars_as_strings=True, mat_dtype=False)
    except Exception as error:  # SciPy raises what it meets
        what = f"truncated or not a MAT file: {' '.join(str(error).split())}"
        raise DataError(what, where=str(file), hint="copy or record it again") from None
    found: dict[str, np.ndarray] = {}
    for name, value in content.items():
        if not name.startswith("__") and (isinstance(value, np.ndarray) or sp.issparse(value)):
            found |= _named_5(name, value)
    return found


def _named_5(name: str, value: Any) -> dict[str, np.ndarray]:
    """An array, or those in the fields of a structure: ``run.force``; a sparse one is filled with zeros."""
    if sp.issparse(value):
        _check_size(name, value.shape)
        return {name: value.toarray()}
    if value.dtype.names is None or isinstance(value, MatlabOpaque) or value.size != 1:
        return {name: _texts_5(value)}
    inner = {field: value[field].item() for field in value.dtype.names}
    fields = {field: x if sp.issparse(x) else np.asarray(x) for field, x in inner.items()}
    return {k: x for field, inner in fields.items() for k, x in _named_5(f"{name}.{field}", inner).items()}


def _texts_5(value: np.ndarray) -> np.ndarray:
    """Rows of a character matrix, or the texts in a cell array, as plain texts."""
    if value.dtype.kind == "O":
        return np.array([_text(v) for v in value.ravel()])
    return np.char.rstrip(value) if value.dtype.kind == "U" else value


def _text(value: Any) -> str:
    array = np.asarray(value)
    return "".join(map(str, array.ravel())).rstrip()


def _read_73(file: Path) -> dict[str, np.ndarray]:
    with opened(file) as archive:
        found: dict[str, Any] = {}

        def note(path: str, item: Any) -> None:
            own = isinstance(item, h5py.Dataset) and SPARSE not in item.parent.attrs
            if SPARSE in item.attrs or (own and not path.startswith("#") and not _is_struct_array(item)):
                found[path.replace("/", ".")] = item

        archive.visititems(note)
        return {name: _array_73(item, archive) for name, item in found.items()}


def _full_73(group: Any) -> np.ndarray:
    """A sparse matrix, which is a group of its entries, their rows and the beginnings of its columns."""
    begins = np.asarray(group["jc"]).ravel().astype(np.int64)
    shape = (int(group.attrs[SPARSE]), len(begins) - 1)
    _check_size(group.name, shape)
    if "data" not in group:  # without entries
        return np.zeros(shape)
    entries = plain(group["data"]).ravel(), np.asarray(group["ir"]).ravel().astype(np.int64), begins
    return sp.csc_array(entries, shape=shape).toarray()


def _check_size(name: str, shape: Any) -> None:
    if shape[0] * shape[1] > MOST_FILLED:
        raise DataError(
            f"a sparse matrix {name} of {shape[0]} rows and {shape[1]} columns",
            hint="reduce it first, or leave it out of the file",
        )


def _is_struct_array(data: Any) -> bool:
    """A field of an array of structures holds references without a class of their own."""
    return h5py.check_ref_dtype(data.dtype) is not None and "MATLAB_class" not in data.attrs


def _array_73(data: Any, archive: Any) -> np.ndarray:
    """An array with its axes in MATLAB's order, which is the file's reversed; texts as texts."""
    if SPARSE in data.attrs:
        return _full_73(data)
    kind = data.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if "MATLAB_empty" in data.attrs:
        return np.empty(tuple(int(n) for n in data[()].ravel()))
    if kind == "cell":
        # References run column by column of the cell array.
        cells = [_array_73(archive[r], archive) for r in data[()].ravel()]
        return np.array([_text(c) for c in cells])
    array = plain(data)
    if kind == "char":
        rows = array.T if array.ndim == 2 else array[None]
        return np.array(["".join(map(chr, row)).rstrip() for row in rows])
    return array.T


def write_mat(path: Path, record: Record) -> None:
    """Write ``record`` in version 5 (double precision), its texts as cell arrays."""
    if 8 * max(record.u.size, record.y.size) >= MOST_BYTES:
        raise DataError(
            "a MAT file of version 5 holds 2 GB a variable", where=str(path),
            hint="write .h5, which MATLAB reads"
        )  # fmt: skip
    contents = contents_of(record)
    cells = {k: v.astype(object) for k, v in contents.items() if v.dtype.kind == "U"}
    with replacing(path) as temporary, open(temporary, "wb") as stream:
        scipy.io.savemat(stream, contents | cells, do_compression=True, oned_as="row")
