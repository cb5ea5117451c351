"""The package's own layout, the same names in NPZ, HDF5 and MAT files."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from middeck.errors import DataError
from middeck.files.json.channels import KEYS, build_channel
from middeck.files.records.columns import Side
from middeck.files.records.commands import SCHEMA as COMMAND
from middeck.files.records.raw import ChannelHeader, Raw
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record

SCHEMA = 1
SIDES: tuple[tuple[str, Side], ...] = (("u", "input"), ("y", "output"))
NAMES = ("input_names", "input_units", "output_names", "output_units")
# What others call a rate [Hz], a period [s] and times [s]; and how far these may be off.
OTHER_RATES, OTHER_RATE = frozenset({"fs", "Fs", "Ts", "t", "time"}), 1e-3
REQUIRED = ("schema", "sample_hz", "periodic", "u", "y", *NAMES)


def is_own(names: Sequence[str]) -> bool:
    """Whether a file with arrays of these ``names`` is intended to have this layout."""
    return "schema" in names or {"u", "y", "sample_hz"} <= set(names)


def describe(
    sample_hz: float, periodic: bool, inputs: Sequence[Port], outputs: Sequence[Port], held: bool | None
) -> dict[str, Any]:
    """Everything but ``u`` and ``y``, without unknown values."""
    contents: dict[str, Any] = {
        "schema": np.int64(SCHEMA), "sample_hz": np.float64(sample_hz), "periodic": np.bool_(periodic)
    }  # fmt: skip
    if held is not None:
        contents["held"] = np.bool_(held)
    for side, ports in (("input", inputs), ("output", outputs)):
        contents[f"{side}_names"] = np.array([p.name for p in ports])
        contents[f"{side}_units"] = np.array([p.unit for p in ports])
        channels = [p.channel or Channel() for p in ports]
        for key in KEYS:
            values = [getattr(c, key) for c in channels]
            if any(v not in ("", None) for v in values):
                known = [np.nan if v is None else v for v in values]
                contents[f"{side}_{key}"] = np.array(known)
    return contents


def contents_of(record: Record) -> dict[str, Any]:
    """All arrays of ``record``."""
    head = describe(record.sample_hz, record.periodic, record.inputs, record.outputs, record.held)
    return head | {"u": record.u, "y": record.y}


def check_contents(arrays: Mapping[str, Any], where: str) -> None:
    """Raise `DataError` if one of the required arrays is missing, or if the schema is another."""
    if str(arrays.get("schema")) == COMMAND:
        raise DataError(
            "a command written by middeck excite: inputs only, no record of what came out", where=where,
            hint="play it to the article and record inputs and outputs together",
        )  # fmt: skip
    missing = [k for k in REQUIRED if k not in arrays]
    if missing:
        raise DataError(
            f"arrays missing: {', '.join(missing)}", where=where, hint=f"it holds {', '.join(arrays)}"
        )
    schema = np.asarray(arrays["schema"])
    if schema.size != 1 or schema.ravel()[0] != SCHEMA:
        raise DataError(f"schema is {schema}, this reader knows {SCHEMA}", where=where, hint="write it again")
    _refuse_other_rates(arrays, where)


def _refuse_other_rates(arrays: Mapping[str, Any], where: str) -> None:
    """Raise `DataError` where times or another rate, which the layout does not know, contradict its rate."""
    stated, samples = read_rate(arrays["sample_hz"], where), np.shape(arrays["u"])[2:3]
    for name in sorted(OTHER_RATES.intersection(arrays)):
        x = np.squeeze(np.asarray(arrays[name]))
        single = name in ("fs", "Fs", "Ts")
        if x.dtype.kind not in "fiu" or x.shape != (() if single else samples) or (not single and x.size < 2):
            continue
        step = float(x) if single else (float(x[-1]) - float(x[0])) / (len(x) - 1)
        rate = step if name in ("fs", "Fs") else 1.0 / step if step else 0.0
        # Times that fall or stand still are something else.
        if rate > 0.0 and abs(rate / stated - 1.0) > OTHER_RATE:
            raise DataError(
                f"sample_hz is {stated:g} Hz, by {name} the rate is {rate:.6g} Hz", where=where,
                hint=f"times in seconds and rates in Hz, or leave {name} out",
            )  # fmt: skip


def check_samples(name: str, shape: tuple[int, ...], dtype: np.dtype[Any], where: str) -> None:
    """Raise `DataError` unless ``u`` or ``y`` are real numbers by (experiment, period, sample, channel)."""
    if len(shape) != 4 or dtype.kind not in "fi":
        raise DataError(
            f"{name} has shape {shape} of {dtype}; must be numbers by (experiment, period, sample, channel)",
            where=where, hint="docs/how-to/your-own-record.md describes the layout",
        )  # fmt: skip


def check_lengths(u: tuple[int, ...], y: tuple[int, ...], where: str) -> None:
    """Raise `DataError` unless inputs and outputs are equally long, or one period of ``u`` stands for all."""
    if u[:3] != y[:3] and u[:3] != (y[0], 1, y[2]):
        raise DataError(
            f"mismatched lengths: u has (experiment, period, sample) {u[:3]}, y {y[:3]}", where=where,
            hint="cut inputs and outputs to the same samples",
        )  # fmt: skip


def read_rate(value: Any, where: str) -> float:
    """The one sampling rate [Hz]."""
    rate = np.asarray(value)
    if rate.size != 1 or rate.dtype.kind not in "fi":
        what = "sample_hz is not one number: channels at several rates"
        raise DataError(what, where=where, hint="resample all channels to one rate")
    return float(rate.ravel()[0])


def read_flag(arrays: Mapping[str, Any], key: str, where: str) -> bool:
    """Whether the flag ``key`` of the record is set."""
    value = arrays[key]
    flag = np.asarray(value)
    if flag.size != 1 or flag.dtype.kind not in "biu":
        raise DataError(f"{key} is {value!r}", where=where, hint="true or false")
    return bool(flag.ravel()[0])


def read_heads(arrays: Mapping[str, Any], side: Side, channels: int, where: str) -> tuple[ChannelHeader, ...]:
    """Names, units and transducers of one side."""
    names, units = np.asarray(arrays[f"{side}_names"]), np.asarray(arrays[f"{side}_units"])
    if names.size != channels or units.size != channels:
        raise DataError(
            f"{names.size} names and {units.size} units for {channels} {side} channels", where=where,
            hint=f"one of {side}_names and {side}_units for each channel",
        )  # fmt: skip
    stated = {key: _values(arrays, f"{side}_{key}", channels, where) for key in KEYS}
    known = [
        build_channel({k: v[n] for k, v in stated.items() if v}, f"{where}, {side} {name}")
        for n, name in enumerate(names.ravel())
    ]
    pairs = zip(names.ravel(), units.ravel(), known, strict=True)
    return tuple(ChannelHeader(str(name), str(unit), side, channel) for name, unit, channel in pairs)


def _values(arrays: Mapping[str, Any], key: str, channels: int, where: str) -> list[Any]:
    if key not in arrays:
        return []
    values = np.asarray(arrays[key]).ravel()
    if len(values) != channels:
        what = f"{len(values)} values of {key} for {channels} channels"
        raise DataError(what, where=where, hint="one for each; empty text or NaN where unknown")
    return [None if isinstance(v, float) and np.isnan(v) else v for v in values.tolist()]


def build_raw(arrays: Mapping[str, Any], where: str) -> Raw:
    """The record that ``arrays`` hold; raises `DataError` for anything inconsistent."""
    check_contents(arrays, where)
    u, y = np.asarray(arrays["u"]), np.asarray(arrays["y"])
    for name, x in (("u", u), ("y", y)):
        check_samples(name, x.shape, x.dtype, where)
    heads = [read_heads(arrays, side, x.shape[3], where) for (_, side), x in zip(SIDES, (u, y), strict=True)]
    check_lengths(u.shape, y.shape, where)
    u = np.broadcast_to(u, (*y.shape[:3], u.shape[3]))
    x = tuple(np.moveaxis(u, 3, 0)) + tuple(np.moveaxis(y, 3, 0))
    rate = read_rate(arrays["sample_hz"], where)
    return Raw(
        sample_hz=rate,
        heads=heads[0] + heads[1],
        x=x,
        periodic=read_flag(arrays, "periodic", where),
        held=read_flag(arrays, "held", where) if "held" in arrays else None,
    )
