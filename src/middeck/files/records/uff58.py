"""Data set 58 of the universal file format, ASCII and binary (58b): one function of one abscissa.

Fixed columns, as SDRC defined them (University of Cincinnati, Structural Dynamics Research Laboratory,
universal file formats, data set 58).
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from middeck.errors import DataError
from middeck.files.records.uff_lines import AGAIN, MARK, Cursor, fortran, to_mark
from middeck.values import record

TIME, RESPONSE = 1, 4  # function types that are read
# Ordinate data type: is complex, bytes of a real number, characters of one, numbers on an ASCII line.
ORDINATES = {2: (False, 4, 13, 6), 4: (False, 8, 20, 4), 5: (True, 4, 13, 6), 6: (True, 8, 20, 4)}
NONE = "NONE"  # in place of a name or a unit
# No measurement is beyond these: its bytes are in another order.
SANE = (1e-25, 1e25)
FEWEST = 32  # numbers by which a byte order can be judged


AXES = ("", "x", "y", "z", "rx", "ry", "rz")
"""Axes of directions by their numbers."""


@record
class Place:
    """One end of a function: a node, by name if it has one, and a direction from -6 (-rz) to 6."""

    name: str
    number: int
    direction: int

    @property
    def node(self) -> str:
        """The node as a channel names it."""
        return self.name or (str(self.number) if self.number else "")


# Abscissa of what is read: its specific data type, where it is known (0, 1: it is not), its unit and how
# programs label that. All other labels (mHz, RPM, rad/sec, orders, mm) are refused: none is guessed.
ABSCISSAS = {
    TIME: (17, "s", ("", "s", "sec", "secs", "second", "seconds", "time")),
    RESPONSE: (18, "Hz", ("", "hz", "hertz", "cps", "frequency", "cycles/s", "cycles/sec", "c/s", "1/s")),
}


@record(kw_only=True)
class Dataset:
    """One data set 58: its header, and where its numbers stand.

    Attributes:
        line: Number of its first line in the file.
        texts: The five lines of identification.
        step, step_text: Step of the abscissa and its digits as printed; None if each value has its own
            abscissa.
        quantity, unit, divisor_unit: Specific data type and unit of the ordinate, and unit of its
            denominator.
        order: Byte order of the numbers; "" for ASCII.
        start, size: Bytes of the file that hold the numbers.
    """

    line: int
    texts: tuple[str, ...]
    kind: int
    response: Place
    reference: Place
    ordinate: int
    count: int
    first: float
    step: float | None
    step_text: str
    quantity: int
    unit: str
    divisor_unit: str
    order: Literal["", "<", ">"]
    start: int
    size: int

    @property
    def numbers(self) -> int:
        """Reals in a value: one or two, and one more with an abscissa of its own."""
        return 1 + ORDINATES[self.ordinate][0] + (self.step is None)


def scan_58(cursor: Cursor, head: str) -> Dataset:
    """The data set whose number the line ``head`` holds; raises `DataError`, with the line, if it is cut."""
    begin, order = cursor.number, _byte_order(head, cursor.where())
    lines = [cursor.line("the end of a header").decode("utf-8", "replace").rstrip("\r\n") for _ in range(11)]
    start, where = cursor.stream.tell(), f"{cursor.file}:{begin}"
    data = _dataset(lines, begin, order, start, where)
    if not order:
        return replace(data, size=to_mark(cursor) - start)
    stated = _whole(head, 31, 43, where, "the number of bytes")
    for size in dict.fromkeys((stated, *_sizes(data))):  # pyuff 2.5 leaves the imaginary parts out
        cursor.stream.seek(start)
        if cursor.fits(size) and _ends(cursor, size):
            return replace(data, size=size)
    cursor.stream.seek(start)
    held = cursor.left()
    what = "truncated" if held < _sizes(data)[-1] else "the numbers do not end where the header says"
    raise DataError(f"{what}: {held} bytes follow, {stated} are announced", where=where, hint=AGAIN)


def _sizes(data: Dataset) -> tuple[int, ...]:
    """Bytes of the numbers; an abscissa may have the digits of single precision, as it has in ASCII."""
    width = ORDINATES[data.ordinate][1]
    full = data.count * data.numbers * width
    return (full,) if data.step is not None else (full, full - data.count * (width - 4))


def _ends(cursor: Cursor, size: int) -> bool:
    """Whether the data set ends after ``size`` bytes, with or without an end of line behind the numbers."""
    cursor.stream.seek(size, 1)
    mark = cursor.stream.readline(100)
    if not mark.strip():
        mark = cursor.stream.readline(100)
    return mark.rstrip() == MARK


def _byte_order(head: str, where: str) -> Literal["", "<", ">"]:
    if head[6:7].lower() != "b":
        return ""
    order, style = (
        _whole(head, 7, 13, where, "the byte order"),
        _whole(head, 13, 19, where, "the number format"),
    )
    if style != 2 or order not in (1, 2):
        what = f"numbers of format {style} in byte order {order}"
        raise DataError(what, where=where, hint="IEEE numbers (2), little (1) or big (2) endian, are read")
    return "<" if order == 1 else ">"


def _dataset(lines: list[str], begin: int, order: Literal["", "<", ">"], start: int, where: str) -> Dataset:
    function, form, abscissa, ordinate, denominator, _ = lines[5:]
    kind = _whole(function, 0, 5, where, "the function type")
    _check_abscissa(kind, abscissa, where)
    data = _whole(form, 0, 10, where, "the ordinate data type")
    if data not in ORDINATES:
        what = f"ordinate data type {data}"
        raise DataError(what, where=where, hint="2 and 4 (real), 5 and 6 (complex) are read")
    count = _whole(form, 10, 20, where, "the number of values")
    even = _whole(form, 20, 30, where, "the spacing of the abscissa") == 1
    step = _number(form, 43, 56, where, "the abscissa increment") if even else None
    if count < 1 or (even and not (step is not None and step > 0.0)):
        raise DataError(f"{count} values by steps of {step}", where=where, hint=AGAIN)
    return Dataset(
        line=begin,
        texts=tuple(t.strip() for t in lines[:5]),
        kind=kind,
        response=_place(function, 31, where),
        reference=_place(function, 56, where),
        ordinate=data,
        count=count,
        first=_number(form, 30, 43, where, "the abscissa minimum"),
        step=step,
        step_text=form[43:56].strip(),
        quantity=_whole(ordinate, 0, 10, where, "the ordinate's quantity"),
        unit=_label(ordinate),
        divisor_unit=_label(denominator),
        order=order,
        start=start,
        size=0,
    )


def _check_abscissa(kind: int, line: str, where: str) -> None:
    if kind not in ABSCISSAS:
        return
    due, unit, labels = ABSCISSAS[kind]
    quantity, label = _whole(line, 0, 10, where, "the abscissa's quantity"), _label(line)
    # "MHZ" is no known label, but "HZ" and "[Hz]" are.
    known = label.strip("[](). ").lower() in labels
    if not known or quantity not in (0, 1, due):
        what = f"the abscissa is of type {quantity}, not {due}" if known else f"the abscissa is in {label!r}"
        raise DataError(what, where=where, hint=f"export it in {unit}")


def _place(line: str, at: int, where: str) -> Place:
    """Entity name in ten columns, node in ten, direction in four."""
    name = line[at : at + 10].strip()
    number = _whole(line, at + 10, at + 20, where, "a node")
    direction = _whole(line, at + 20, at + 24, where, "a direction")
    return Place("" if name == NONE else name, number, direction if abs(direction) <= 6 else 0)


def _label(line: str) -> str:
    unit = line[47:67].strip()
    return "" if unit == NONE else unit


def _whole(line: str, start: int, end: int, where: str, what: str) -> int:
    text = line[start:end].strip()
    try:
        return int(text) if text else 0
    except ValueError:
        raise DataError(f"{what} is {text!r}", where=where, hint="columns are fixed: " + AGAIN) from None


def _number(line: str, start: int, end: int, where: str, what: str) -> float:
    text = line[start:end].strip()
    try:
        number = float(fortran(text)) if text else 0.0
    except ValueError:
        raise DataError(f"{what} is {text!r}", where=where, hint="columns are fixed: " + AGAIN) from None
    if not np.isfinite(number):
        raise DataError(f"{what} is {text!r}", where=where, hint=AGAIN)
    return number


def read_values(file: Path, data: Dataset, size: int) -> Iterator[np.ndarray]:
    """The numbers [value, number of a value] of a data set, at most ``size`` values at a time.

    If each value has its own abscissa, this is the first number; a complex ordinate is the last two.
    Raises `DataError` if there are fewer or more values than the header says.
    """
    read = _binary if data.order else _text
    yield from read(file, data, size)


def _binary(file: Path, data: Dataset, size: int) -> Iterator[np.ndarray]:
    width = ORDINATES[data.ordinate][1]
    kinds = [f"{data.order}f{width}"] * data.numbers
    if data.size == _sizes(data)[-1] and data.step is None:
        kinds[0] = f"{data.order}f4"
    row = np.dtype([(f"n{k}", kind) for k, kind in enumerate(kinds)])
    where = f"{file}:{data.line}"
    if data.size != data.count * row.itemsize:
        what = f"{data.size} bytes for {data.count} values of {row.itemsize}"
        raise DataError(what, where=where, hint=AGAIN)
    with open(file, "rb") as stream:
        stream.seek(data.start)
        for k in range(0, data.count, size):
            rows: np.ndarray = np.frombuffer(stream.read(min(size, data.count - k) * row.itemsize), row)
            values = np.column_stack([rows[f"n{k}"] for k in range(len(kinds))]).astype(float)
            _check_order(values, rows, where)
            yield values


def _check_order(values: np.ndarray, rows: np.ndarray, where: str) -> None:
    """Refuse bytes that are measurements in the other order only."""
    if values.size < FEWEST or _is_sane(values):
        return
    swapped = rows.byteswap().view(rows.dtype)
    if _is_sane(np.column_stack([swapped[name] for name in rows.dtype.names or ()]).astype(float)):
        raise DataError(
            "the numbers make sense in the other byte order only", where=where,
            hint="mend the byte order in the header (1 little, 2 big endian), or " + AGAIN,
        )  # fmt: skip


def _is_sane(values: np.ndarray) -> bool:
    """Whether nine numbers in ten are zero or of a magnitude within `SANE`."""
    size = np.abs(values)
    good = (size == 0.0) | ((size > SANE[0]) & (size < SANE[1]))
    return bool(np.mean(good) > 0.9)


def _text(file: Path, data: Dataset, size: int) -> Iterator[np.ndarray]:
    widths = _widths(data)
    held: list[float] = []
    left, line = data.count, data.line + 11
    with open(file, "rb") as stream:
        stream.seek(data.start)
        while stream.tell() < data.start + data.size:
            text, line = stream.readline().decode("ascii", "replace").rstrip("\r\n"), line + 1
            held += _fields(text, widths, f"{file}:{line}")
            while len(held) >= size * data.numbers:
                yield np.array(held[: size * data.numbers]).reshape(-1, data.numbers)
                held, left = held[size * data.numbers :], left - size
    if len(held) != left * data.numbers:
        what = f"truncated: {data.count - left + len(held) // data.numbers} of {data.count} values"
        raise DataError(what, where=f"{file}:{data.line}", hint=AGAIN)
    if held:
        yield np.array(held).reshape(-1, data.numbers)


def _widths(data: Dataset) -> tuple[int, ...]:
    """Columns of the numbers on a full line."""
    is_complex, _, characters, on_line = ORDINATES[data.ordinate]
    if data.step is not None or characters == 13:
        return (characters,) * on_line
    return (13, 20, 20) if is_complex else (13, 20, 13, 20)


def _fields(text: str, widths: tuple[int, ...], where: str) -> list[float]:
    """Numbers by blanks if these separate the expected count, otherwise by fixed columns, which may touch."""
    parts = text.split()
    if len(parts) != len(widths):
        ends = np.cumsum((0, *widths))
        cut = [text[a:b].strip() for a, b in itertools.pairwise(ends)]
        parts = [p for p in cut if p]
    try:
        return [float(fortran(p)) for p in parts]
    except ValueError:
        raise DataError(f"{text[:40]!r} holds no numbers", where=where, hint=AGAIN) from None
