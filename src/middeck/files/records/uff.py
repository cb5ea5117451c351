"""Universal files: time functions as records, frequency responses as responses."""

import dataclasses
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.errors import DataError
from middeck.files.disk.atomic import replacing
from middeck.files.json.channels import build_channel
from middeck.files.records.columns import Side
from middeck.files.records.raw import SAME_RATE, ChannelHeader, Raw, channel_fault
from middeck.files.records.uff58 import AXES, NONE, RESPONSE, TIME, Dataset, Place, read_values
from middeck.files.records.uff58_write import Header, stated, write_58, write_count
from middeck.files.records.uff_cut import warnings_on_whole
from middeck.files.records.uff_sets import is_si, scan
from middeck.signals.fault import RecordFault
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

FORCE = 13  # specific data type "excitation force": what was put in
# Specific data type -> unit in SI, for a file that leaves the label empty; and the way back.
UNITS = {8: "m", 11: "m/s", 12: "m/s^2", 9: "N", FORCE: "N", 15: "Pa", 5: "K"}
QUANTITY = {"m": 8, "m/s": 11, "m/s^2": 12, "Pa": 15}
OURS = "middeck 1"
LONGEST = 80  # characters of a line of text
# Share of a sample by which channels that were sampled together may seem to start apart.
APART = 0.01
WHOLE = 1 << 20
# Share of the highest frequency by which lines may be off an even spacing: rounding.
EVEN = 1e-12
# Nodes that the format has as numbers, in ten columns; 0 is none there.
NUMBERED = re.compile(r"[1-9][0-9]{0,9}", re.ASCII)


@record(kw_only=True)
class Experiment:
    """One experiment: a data set for each channel, the samples that they share, and their rate [Hz]."""

    heads: tuple[ChannelHeader, ...]
    sets: tuple[Dataset, ...]
    skips: tuple[int, ...]  # samples by which a channel began before the last one
    samples: int
    sample_hz: float
    periods: int | None
    held: bool | None = None
    faults: tuple[RecordFault, ...] = ()


def read_uff(file: Path, variable: str) -> Raw:
    """The time functions as one record; raises `DataError` if its experiments differ in length."""
    runs = read_runs(file)
    lengths = sorted({r.samples for r in runs})
    if len(lengths) > 1 or len({(r.sample_hz, r.periods, r.held, r.heads) for r in runs}) > 1:
        raise DataError(
            f"{len(runs)} experiments of unlike channels, rates or lengths ({lengths} samples)",
            where=str(file), hint="cut them to one length; load_campaign takes experiments of unlike lengths",
        )  # fmt: skip
    raws = [raw_run(file, run) for run in runs]
    x = tuple(np.concatenate(channels) for channels in zip(*(r.x for r in raws), strict=True))
    faults = sum((r.faults for r in raws), ())
    head, hint = raws[0].heads[-1], "count the channels of the test"
    sets = [data for run in runs for data in run.sets]
    faults += tuple(
        channel_fault("truncated", "note", head, doubt, hint, experiment=None)
        for doubt in warnings_on_whole([d for d in sets if _side(d) == "output"], sets, file)
    )
    return dataclasses.replace(raws[0], x=x, faults=faults)


def raw_run(file: Path, run: Experiment) -> Raw:
    """One experiment of a file."""
    columns = [np.concatenate(list(pieces_channel(file, run, k, WHOLE))) for k in range(len(run.sets))]
    periods = run.periods or 1
    x = tuple(c.reshape(1, periods, -1) for c in columns)
    return Raw(
        sample_hz=run.sample_hz,
        heads=run.heads,
        x=x,
        periodic=run.periods is not None,
        faults=run.faults,
        held=run.held,
    )


def pieces_channel(file: Path, run: Experiment, channel: int, size: int) -> Iterator[np.ndarray]:
    """Samples of one channel that all channels share, ``size`` at a time; the last piece may be shorter."""
    skip, left, held = run.skips[channel], run.samples, np.empty(0)
    for values in read_values(file, run.sets[channel], size):
        shared = values[skip : skip + left, -1]
        skip, left = max(0, skip - len(values)), left - len(shared)
        held = np.concatenate([held, shared])
        while len(held) >= size:
            yield held[:size]
            held = held[size:]
    if len(held):
        yield held


def read_runs(file: Path) -> list[Experiment]:
    """The experiments of a file: the n-th time that a channel comes, it belongs to the n-th.

    Raises `DataError`, naming the channel, for unlike rates, starts that are not whole samples apart, and
    channels that do not come equally often.
    """
    sets = [d for d in scan(file) if d.kind == TIME]
    if not sets:
        raise DataError(
            "no time functions (data set 58, function type 1)", where=str(file),
            hint="export time histories; load_response reads frequency responses",
        )  # fmt: skip
    for data in sets:
        if data.numbers != 1:
            what = "a time function with complex or unevenly spaced values"
            raise DataError(what, where=f"{file}:{data.line}", hint="export it evenly spaced and real")
    channels: dict[tuple[object, ...], list[Dataset]] = {}
    for data in sets:
        channels.setdefault(_key(data), []).append(data)
    heads = _heads(list(channels.values()), file)
    most = max(map(len, channels.values()))
    for head, data in zip(heads, channels.values(), strict=True):
        if len(data) != most:
            what = f"{len(data)} time functions, other channels have {most}"
            raise DataError(what, where=f"{file}, channel {head.name}", hint="one for each experiment")
        other = next((d for d in data if d.unit != data[0].unit), None)
        if other is not None:
            what = f"in {other.unit or 'no stated unit'}, in the first experiment in {data[0].unit or 'none'}"
            where = f"{file}:{other.line}, channel {head.name}"
            raise DataError(what, where=where, hint="export all experiments in one unit")
    return [_run(heads, together, file) for together in zip(*channels.values(), strict=True)]


def _key(data: Dataset) -> tuple[object, ...]:
    """Key of a channel: place and quantity; the first text where a file has no places."""
    if _is_ours(data):
        return data.texts[0], _side(data)
    placed = data.response.number or data.response.direction or data.response.name
    return (data.response, data.quantity) if placed else (data.texts[0], data.quantity)


def _heads(channels: Sequence[Sequence[Dataset]], file: Path) -> tuple[ChannelHeader, ...]:
    texts = [c[0].texts[0] for c in channels]
    # One text for all functions is a title, no name.
    named = len(set(texts)) == len(texts) and "" not in texts and NONE not in texts
    named = named and all(d.texts[0] == c[0].texts[0] for c in channels for d in c)
    ours = all(_is_ours(c[0]) for c in channels)
    names = texts if named or ours else [_place_name(c[0].response) for c in channels]
    return tuple(_head(name, c[0], file) for name, c in zip(names, channels, strict=True))


def _head(name: str, data: Dataset, file: Path) -> ChannelHeader:
    node, direction = data.response.node, _direction(data.response)
    of_channel = _stated_channel(data.texts[4]) if _is_ours(data) else {}
    table = of_channel | {"node": node, "direction": direction}
    channel = build_channel(table, f"{file}:{data.line}, channel {name}")
    unit = data.unit if data.unit or _is_ours(data) else UNITS.get(data.quantity) if is_si(file) else None
    return ChannelHeader(name, unit, _side(data), channel)


def _stated_channel(text: str) -> dict[str, Any]:
    """The channel in a text of `_known`."""
    of_channel: dict[str, Any] = dict(re.findall(r"(role|gain|calibrated)=(\S+)", text))
    raw_unit = re.search(r"raw_unit=(.*)", text)
    gain = {"gain": float(of_channel["gain"])} if "gain" in of_channel else {}
    return of_channel | gain | ({} if raw_unit is None else {"raw_unit": raw_unit.group(1)})


def _is_ours(data: Dataset) -> bool:
    return data.texts[3].startswith(OURS)


def _side(data: Dataset) -> Side:
    if _is_ours(data):
        return "input" if " input" in data.texts[3] else "output"
    return "input" if data.quantity == FORCE else "output"


def _direction(place: Place) -> str:
    return ("-" if place.direction < 0 else "+") + AXES[abs(place.direction)] if place.direction else ""


def _place_name(place: Place) -> str:
    return f"{place.node or '0'}{_direction(place)}"


def _run(heads: tuple[ChannelHeader, ...], sets: tuple[Dataset, ...], file: Path) -> Experiment:
    rates = [_sample_hz(d) for d in sets]
    for head, data, rate in zip(heads, sets, rates, strict=True):
        if abs(rate - rates[0]) > SAME_RATE * rates[0]:
            raise DataError(
                f"unlike rates: {rate:g} Hz, {heads[0].name} has {rates[0]:g} Hz",
                where=f"{file}:{data.line}, channel {head.name}", hint="resample all channels to one rate",
            )  # fmt: skip
    starts = np.array([d.first for d in sets])
    skips = (starts.max() - starts) * rates[0]
    if np.abs(skips - np.rint(skips)).max() > APART:
        worst = int(np.abs(skips - np.rint(skips)).argmax())
        raise DataError(
            f"misaligned starts: {skips[worst]:.3f} samples before the last channel",
            where=f"{file}:{sets[worst].line}, channel {heads[worst].name}",
            hint="resample all channels to the same instants",
        )
    whole = tuple(int(s) for s in np.rint(skips))
    samples = min(d.count - s for d, s in zip(sets, whole, strict=True))
    periods = _stated_number(sets[0], "periods")
    if samples < 1 or (periods is not None and samples % int(periods)):
        what = f"{samples} samples are in all channels"
        raise DataError(what, where=str(file), hint="the channels were not recorded together")
    faults = _cut_faults(heads, sets, whole, samples)
    count, held = None if periods is None else int(periods), _stated_number(sets[0], "held")
    return Experiment(
        heads=heads,
        sets=sets,
        skips=whole,
        samples=samples,
        sample_hz=rates[0],
        periods=count,
        held=None if held is None else bool(held),
        faults=faults,
    )


def _cut_faults(
    heads: tuple[ChannelHeader, ...], sets: tuple[Dataset, ...], skips: tuple[int, ...], samples: int
) -> tuple[RecordFault, ...]:
    """A fault for each channel that lost samples which others lack."""
    found: list[RecordFault] = []
    for head, data, skip in zip(heads, sets, skips, strict=True):
        end = data.count - skip - samples
        if skip or end:
            what = f"begins {skip} samples before and ends {end} after what all channels have: cut"
            hint = "check that the channels were triggered together"
            found.append(channel_fault("starts", "note", head, what, hint, experiment=None))
    return tuple(found)


def _stated_number(data: Dataset, key: str) -> float | None:
    found = re.search(rf"\b{key}=(\S+)", data.texts[3]) if _is_ours(data) else None
    return float(found.group(1)) if found else None


def _sample_hz(data: Dataset) -> float:
    """The rate [Hz]: as stated, or the roundest that fits the digits of the printed step.

    A step of 1.66667E-04 s stands for 6000 Hz, not for 5999.99.
    """
    assert data.step is not None
    exact_hz = _stated_number(data, "hz")
    if exact_hz is not None and abs(exact_hz * data.step - 1.0) < SAME_RATE:
        return exact_hz
    mantissa = re.match(r"[+-]?([\d.]*)", data.step_text)
    digits = len(mantissa.group(1).replace(".", "").lstrip("0")) if mantissa else 1
    slack = 0.5 * 10.0 ** (np.floor(np.log10(data.step)) - digits + 1)
    rounded = (float(f"{1.0 / data.step:.{d}g}") for d in range(1, 10))
    return next((r for r in rounded if abs(1.0 / r - data.step) <= slack), 1.0 / data.step)


def write_uff(path: Path, held: Record, *, binary: bool = True) -> None:
    """Write ``held`` as data sets 58b, or 58 in ASCII with 13 digits; one for each channel and experiment."""
    experiments, periods, _, _ = held.u.shape
    more = f"hz={held.sample_hz!r}" + (f" periods={periods}" if held.periodic else "")
    more += "" if held.held is None else f" held={int(held.held)}"
    with replacing(path) as temporary, open(temporary, "wb") as stream:
        write_count(stream, experiments * (held.u.shape[3] + held.y.shape[3]))
        for e in range(experiments):
            for side, ports, x in (("input", held.inputs, held.u), ("output", held.outputs, held.y)):
                for k, port in enumerate(ports):
                    header = _header(port, f"{OURS} {side} {more}", side, str(path))
                    write_58(stream, header, 0.0, 1.0 / held.sample_hz, x[e, :, :, k].ravel(), binary=binary)


def _header(port: Port, ours: str, side: str, where: str) -> Header:
    channel = port.channel or Channel()
    quantity = FORCE if side == "input" and port.unit in ("N", "N m") else QUANTITY.get(port.unit, 1)
    texts = (stated(port.name), NONE, NONE, ours, _known(channel))
    place = _place(channel, f"{where}, channel {port.name}")
    return Header(
        texts=texts,
        kind=TIME,
        response=place,
        reference=Place("", 0, 0),
        axis=17,
        axis_unit="s",
        quantity=quantity,
        unit=port.unit,
    )


def _known(channel: Channel) -> str:
    keys = ("role", "gain", "calibrated", "raw_unit")  # the last may hold blanks
    return " ".join(f"{k}={v}" for k in keys if (v := getattr(channel, k)) not in ("", None)) or NONE


def _place(channel: Channel, where: str) -> Place:
    sign = -1 if channel.direction.startswith("-") else 1
    axis = channel.direction.lstrip("+-")
    if axis not in AXES:
        what = f"direction {channel.direction!r} has no code in a universal file"
        raise DataError(what, where=where, hint="+x to -rz, or another kind of file")
    direction = sign * AXES.index(axis)
    if NUMBERED.fullmatch(channel.node):
        return Place("", int(channel.node), direction)
    return Place(channel.node, 0, direction)


def read_response(file: Path) -> FrequencyResponse:
    """The frequency responses (function type 4): outputs are the response ends, inputs the reference ends."""
    sets = [d for d in scan(file) if d.kind == RESPONSE]
    if not sets:
        what = "no frequency responses (data set 58, function type 4)"
        raise DataError(
            what, where=str(file), hint="a file of frequency responses; load_record reads time functions"
        )
    found = _by_ends(sets, file)
    for doubt in warnings_on_whole(sets, sets, file):
        warnings.warn(f"{file}: {doubt}", UserWarning, stacklevel=3)
    outputs, inputs = (list(dict.fromkeys(ends[k] for ends in found)) for k in range(2))
    lines: np.ndarray | None = None
    H = np.empty((sets[0].count, len(outputs), len(inputs)), complex)
    for o, output in enumerate(outputs):
        for i, at in enumerate(inputs):
            data = found.get((output, at))
            where = f"{file}, {_end_name(output)} by {_end_name(at)}"
            if data is None:
                raise DataError("no response between them", where=where, hint="export all, or one input")
            frequency, values = _response(file, data)
            lines = frequency if lines is None else lines
            if len(frequency) != len(lines) or np.abs(frequency - lines).max() > SAME_RATE * lines[-1]:
                raise DataError("other frequencies than the first", where=where, hint="export them alike")
            H[:, o, i] = values
    assert lines is not None
    if not (np.diff(lines) > 0.0).all():
        hz = lines[1 + int(np.argmin(np.diff(lines)))]
        what = f"frequencies do not rise: {hz:.6g} Hz does not stand above the one before it"
        raise DataError(what, where=str(file), hint="export them in order, each once")
    _check_units(found, outputs, inputs, file)
    kept = slice(int(lines[0] == 0.0), None)  # zero hertz has no phase, and no fit a use for it
    if kept.start:
        warnings.warn(f"{file}: the line at 0 Hz, which has no phase, is left out", UserWarning, stacklevel=3)
    units = UNITS if is_si(file) else {}
    into = tuple(
        _end(at, found[outputs[0], at].divisor_unit, found[outputs[0], at].texts[2], file) for at in inputs
    )
    firsts = [found[at, inputs[0]] for at in outputs]
    out = tuple(
        _end(at, d.unit or units.get(d.quantity, ""), d.texts[4], file)
        for at, d in zip(outputs, firsts, strict=True)
    )
    rates = [_stated_number(firsts[0], key) for key in ("held", "maybe")]
    hold_s, perhaps_s = (None if hz is None else 1.0 / hz for hz in rates)
    return FrequencyResponse(
        frequency_hz=lines[kept],
        H=H[kept],
        inputs=into,
        outputs=out,
        hold_s=hold_s,
        perhaps_held_s=perhaps_s,
    )


End = tuple[Place, str]  # with the name of the port, where the file is ours


def _ends(data: Dataset) -> tuple[End, End]:
    names = data.texts[:2] if _is_ours(data) else ("", "")
    return (data.response, names[0]), (data.reference, names[1])


def _by_ends(sets: list[Dataset], file: Path) -> dict[tuple[End, End], Dataset]:
    """The responses by their ends. Raises `DataError` for unlike two of one pair, as of runs or quantities.

    One that is exported twice, the same in every number, counts once.
    """
    found: dict[tuple[End, End], Dataset] = {}
    for data in sets:
        first = found.setdefault(_ends(data), data)
        if first is not data and not _is_same(first, data, file):
            output, at = map(_end_name, _ends(data))
            what = f"a second response of {output} to {at}: the first is on line {first.line}"
            raise DataError(what, where=f"{file}:{data.line}", hint="export one run, of one quantity")
    return found


def _is_same(one: Dataset, other: Dataset, file: Path) -> bool:
    """Whether two data sets state the same function of the same quantity."""
    placed = {"line": 0, "start": 0, "size": 0, "texts": (), "step_text": ""}
    if dataclasses.replace(one, **placed) != dataclasses.replace(other, **placed):
        return False
    here, there = (np.concatenate(list(read_values(file, d, WHOLE))) for d in (one, other))
    return np.array_equal(here, there)


def _check_units(
    found: dict[tuple[End, End], Dataset], outputs: list[End], inputs: list[End], file: Path
) -> None:
    """Raise `DataError` where responses state other units of one output, or of one input."""
    for (output, at), data in found.items():
        first, divisor = found[output, inputs[0]], found[outputs[0], at]
        if (data.quantity, data.unit) != (first.quantity, first.unit):
            end, one, other = output, data.unit, first.unit
        elif data.divisor_unit != divisor.divisor_unit:
            end, one, other = at, data.divisor_unit, divisor.divisor_unit
        else:
            continue
        what = f"{_end_name(end)} in {one or 'no stated unit'} here, in {other or 'none'} on line "
        line = first.line if end is output else divisor.line
        raise DataError(f"{what}{line}", where=f"{file}:{data.line}", hint="export all in one unit")


def _end_name(end: End) -> str:
    return end[1] or _place_name(end[0])


def _end(end: End, unit: str, text: str, file: Path) -> Port:
    place, name = end
    table = _stated_channel(text) if name else {}
    channel = build_channel(
        table | {"node": place.node, "direction": _direction(place)}, f"{file}, channel {_end_name(end)}"
    )
    return Port(_end_name(end), unit, None if channel == Channel() else channel)


def _response(file: Path, data: Dataset) -> tuple[np.ndarray, np.ndarray]:
    values = np.concatenate(list(read_values(file, data, WHOLE)))
    if not np.isfinite(values).all():
        raise DataError("a value is not finite", where=f"{file}:{data.line}", hint="leave that line out")
    if data.step is None:
        frequency, part = values[:, 0], values[:, 1:]
    else:
        first, step = (
            exact if (exact := _stated_number(data, key)) is not None else printed
            for key, printed in (("first", data.first), ("step", data.step))
        )
        frequency, part = first + step * np.arange(data.count), values
    return frequency, part[:, 0] + 1j * part[:, 1] if part.shape[1] == 2 else part[:, 0] + 0j


def write_uff_response(path: Path, held: FrequencyResponse, *, binary: bool = True) -> None:
    """Write ``held`` as data sets 58b, or 58 in ASCII, of function type 4; its variance has no place."""
    f = held.frequency_hz
    step, ours = _even_step(f), _ours(held)
    with replacing(path) as temporary, open(temporary, "wb") as stream:
        write_count(stream, held.H[0].size)
        for o, i in np.ndindex(held.H.shape[1:]):
            header = _response_header(held.outputs[o], held.inputs[i], ours, str(path))
            H = held.H[:, o, i]
            if step is not None:
                write_58(stream, header, float(f[0]), step, H, binary=binary)
            else:
                rows = np.column_stack([f, np.real(H), np.imag(H)])
                write_58(stream, header, 0.0, None, rows, binary=binary)


def _even_step(f: np.ndarray) -> float | None:
    step = float(f[-1] - f[0]) / (len(f) - 1) if len(f) > 1 else 1.0
    even = step > 0.0 and np.abs(f - f[0] - step * np.arange(len(f))).max() <= EVEN * f[-1]
    return step if even else None


def _ours(held: FrequencyResponse) -> str:
    """The line of text for our reader: also at which rate inputs were or may have been held, if that fits."""
    step, text = _even_step(held.frequency_hz), f"{OURS} response"
    if step is not None:
        text += f" first={float(held.frequency_hz[0])!r} step={step!r}"
    for key, period in (("held", held.hold_s), ("maybe", held.perhaps_held_s)):
        more = "" if period is None else f" {key}={1.0 / period if period else np.inf:.12g}"
        text += more if len(text + more) <= LONGEST else ""
    return text


def keeps_hold(held: FrequencyResponse) -> bool:
    """Whether a file of the response says over which time its inputs were held."""
    return not held.hold_s or " held=" in _ours(held)


def _response_header(output: Port, at: Port, ours: str, where: str) -> Header:
    ends = [port.channel or Channel() for port in (output, at)]
    places = [_place(c, f"{where}, channel {p.name}") for c, p in zip(ends, (output, at), strict=True)]
    texts = (stated(output.name), stated(at.name), _known(ends[1]), ours, _known(ends[0]))
    divisor = FORCE if at.unit in ("N", "N m") else QUANTITY.get(at.unit, 0)
    quantity = QUANTITY.get(output.unit, 0)
    return Header(
        texts=texts,
        kind=RESPONSE,
        response=places[0],
        reference=places[1],
        axis=18,
        axis_unit="Hz",
        quantity=quantity,
        unit=output.unit,
        divisor=divisor,
        divisor_unit=at.unit,
    )
