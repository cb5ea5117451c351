"""Contents of a file, or a plain matrix, before its channels have sides: the form of all readers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from middeck.errors import DataError
from middeck.files.records.columns import Columns, NamedColumn, Side
from middeck.files.records.experiments_and_periods import check_channels
from middeck.signals.fault import RecordFault, Severity
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record
from middeck.values import record

# Printed time stamps and abscissas carry about six digits.
SAME_RATE = 1e-5


@record
class ChannelHeader:
    """Name (empty if the file has none), unit (None: likewise) and side of a channel."""

    name: str
    unit: str | None
    side: Side
    channel: Channel | None = None


def channel_fault(
    kind: str,
    severity: Severity,
    head: ChannelHeader,
    what: str,
    hint: str,
    *,
    experiment: int | None = 0,
    samples: tuple[tuple[int, int], ...] = (),
) -> RecordFault:
    """A fault of one channel that the reader of a file found; outputs are named where it has no side."""
    return RecordFault(
        kind=kind,
        severity=severity,
        side=head.side or "output",
        channel=head.name,
        experiment=experiment,
        samples=samples,
        what=what,
        hint=hint,
    )


@dataclass(frozen=True, kw_only=True)  # views of what was read, not copies
class Raw:
    """Channels as read: for each head an array (experiment, period, sample).

    ``rate_share`` is the share by which the file leaves its rate open.
    """

    sample_hz: float | None
    heads: tuple[ChannelHeader, ...]
    x: tuple[np.ndarray, ...]
    periodic: bool = False
    faults: tuple[RecordFault, ...] = ()
    rate_share: float = SAME_RATE
    held: bool | None = None


@record
class Chosen:
    """Positions in the file of the channels to keep, and their ports."""

    u: tuple[int, ...]
    y: tuple[int, ...]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


def build_record(raw: Raw, columns: Columns | None, where: str) -> Record:
    """The record of ``raw``, its channels named, chosen and described by ``columns``.

    Raises `DataError` where neither says the rate, a unit, or which channels are inputs and which outputs.
    """
    chosen = choose(raw.heads, columns, where)
    rate = sampling_rate(raw, columns, where)
    check_channels(rate, chosen.inputs, chosen.outputs, where)
    shape = raw.x[0].shape if raw.x else (1, 1, 0)
    u, y = (
        np.stack([raw.x[k] for k in side], axis=-1) if side else np.empty((*shape, 0))
        for side in (chosen.u, chosen.y)
    )
    return Record(
        sample_hz=rate,
        u=u,
        y=y,
        inputs=chosen.inputs,
        outputs=chosen.outputs,
        periodic=raw.periodic,
        held=raw.held,
    )


def sampling_rate(raw: Raw, columns: Columns | None, where: str) -> float:
    """The rate that the file, ``columns`` or both state [Hz]."""
    stated, given = raw.sample_hz, None if columns is None else columns.sample_hz
    if stated is None:
        if given is None:
            raise DataError("no sampling rate", where=where, hint="state it: name_columns(sample_hz=RATE)")
        return given
    if given is not None and abs(given - stated) > raw.rate_share * stated:
        what = f"sampled at {stated:.9g} Hz; {given:.9g} Hz were stated"
        raise DataError(what, where=where, hint="leave the rate out: the file says it")
    return stated if given is None else given


def choose(heads: tuple[ChannelHeader, ...], columns: Columns | None, where: str) -> Chosen:
    """Inputs and outputs of a file, in their order, and their names."""
    named = () if columns is None else columns.named
    if any(c.side for c in named):
        picks = [(_position(heads, c, n, where), c) for n, c in enumerate(named)]
    else:
        by_column = {_position(heads, c, n, where): c for n, c in enumerate(named)}
        picks = [(k, by_column.get(k, NamedColumn(name=h.name, side=""))) for k, h in enumerate(heads)]
    sides: dict[str, list[tuple[int, Port]]] = {"input": [], "output": [], "": []}
    for k, column in picks:
        side = column.side or heads[k].side
        sides[side].append((k, _port(heads[k], column, where)))
    if sides[""]:
        held = ", ".join(heads[k].name or f"column {k + 1}" for k, _ in sides[""])
        raise DataError(
            f"nothing says which channels are inputs and which outputs: {held}", where=where,
            hint='name them: name_columns(["torque [N m]"], ["angle [rad]"])',
        )  # fmt: skip
    u, y = (tuple(k for k, _ in sides[side]) for side in ("input", "output"))
    if twice := [k for n, k in enumerate((*u, *y)) if k in (*u, *y)[:n]]:
        what = f"channel {heads[twice[0]].name or twice[0] + 1} is named twice"
        raise DataError(what, where=where, hint="each once, as an input or as an output")
    inputs, outputs = (tuple(port for _, port in sides[side]) for side in ("input", "output"))
    return Chosen(u, y, inputs, outputs)


def _by_number(name: str) -> str:
    return f"{name}=NAME" if name.isdigit() else f"2={name}"


def _position(heads: tuple[ChannelHeader, ...], column: NamedColumn, listed: int, where: str) -> int:
    """The channel meant: by number, else by name, else in a file without names by its place in the list."""
    names = [h.name for h in heads]
    if column.number is None and any(names):
        meant = [k for k, h in enumerate(heads) if h.name == column.name and column.side in (h.side, "")]
        if len(meant) == 1 and column.side:  # an input and an output may have one name
            return meant[0]
        if names.count(column.name) == 1:
            return names.index(column.name)
        what = "no channel is" if column.name not in names else "two channels are"
        raise DataError(
            f"{what} named {column.name!r}", where=where,
            hint=f"one of {', '.join(names)}; or by number, counted from 1 without "
            f"the column of time: {_by_number(column.name)}",
        )  # fmt: skip
    position = listed if column.number is None else column.number - 1
    if not 0 <= position < len(heads):
        what = f"column {position + 1} is named {column.name!r}, the file has {len(heads)}"
        hint = f"columns are counted from 1{', without that of time' if any(names) else ''}"
        raise DataError(what, where=where, hint=hint)
    if names[position] != column.name and column.name in names:
        what = f"column {position + 1} is {names[position]!r}, {column.name!r} is column "
        hint = "leave the number out; columns are counted from 1, without that of time"
        raise DataError(what + str(names.index(column.name) + 1), where=where, hint=hint)
    return position


def _port(head: ChannelHeader, column: NamedColumn, where: str) -> Port:
    unit = head.unit if column.unit is None else column.unit
    if head.unit and unit != head.unit:
        raise DataError(
            f"is in {head.unit!r}; {unit!r} was stated", where=f"{where}, channel {head.name}",
            hint="leave the unit out: the file says it; nothing is converted",
        )  # fmt: skip
    if unit is None and not column.side and head.side:
        raise DataError(
            "the file does not say its unit", where=f"{where}, channel {head.name}",
            hint=f'state it: name_columns([], ["{head.name} [m/s^2]"]), or in a file of channels beside it',
        )  # fmt: skip
    return Port(column.name, unit or "", column.channel or head.channel)


def raw_matrix(matrix: np.ndarray, file: Path) -> Raw:
    """``matrix`` as one experiment of one run; raises `DataError` unless it is two-dimensional and real.

    A matrix with more columns than rows is refused: it has its samples in rows.
    """
    if matrix.ndim != 2 or matrix.dtype.kind not in "fiu":
        raise DataError(
            f"an array of shape {matrix.shape} of {matrix.dtype}; must be numbers by (sample, channel)",
            where=str(file), hint="docs/how-to/your-own-record.md shows how to reorder axes",
        )  # fmt: skip
    rows, columns = matrix.shape
    if columns > rows > 0:
        raise DataError(
            f"{rows} rows of {columns} columns: fewer samples than channels", where=str(file),
            hint="transpose it"
        )  # fmt: skip
    heads = tuple(ChannelHeader("", None, "") for _ in range(columns))
    return Raw(sample_hz=None, heads=heads, x=tuple(x[None, None].astype(float) for x in matrix.T))
