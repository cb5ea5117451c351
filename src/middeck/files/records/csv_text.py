"""CSV records: one experiment, a first line that names the channels, a first column of time stamps."""

from __future__ import annotations

import csv
import datetime
import itertools
import re
import tomllib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.files.disk.atomic import replacing
from middeck.files.json.channels import KEYS, build_channel
from middeck.files.records.columns import Side
from middeck.files.records.decimals import refuse_thousands, separator_of, with_points
from middeck.files.records.ending import cut_short
from middeck.files.records.raw import SAME_RATE, ChannelHeader, Raw, channel_fault
from middeck.files.records.stamps import (
    JITTER,
    SLOW,
    is_even,
    last_digit,
    mean_step,
    open_share,
    rate_of,
    since_1970,
    warning_on_seconds,
)
from middeck.signals.fault import RecordFault
from middeck.signals.ports import Channel, Port
from middeck.signals.record import RecordStream
from middeck.values import record

# A rate [Hz] below which a heading in seconds is rather that of milliseconds.
SLOWEST = 0.5
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}  # units of a column of times
# Headings of such a column, and a unit that is part of the name, as in time_s.
TIMES = re.compile(
    r"(?:t|zeit|epoch|timestamp|(?:unix|elapsed)?[ _]?time(?:[ _]stamp)?)(?:[ _](s|sec|ms|us|µs))?",
    re.IGNORECASE,
)
# In square brackets anything is a unit; in round ones what is made of these. All else, as (in), is a name.
_SYMBOL = r"(?:[kmuµ]?(?:N|m|g|s|V|A|Pa|rad)|lbf|ft|deg|°|%|Hz|kg)"
_UNIT = rf"\[([^\]]*)\]|\(({_SYMBOL}(?:[ */·]?{_SYMBOL}|\^?-?[234²])*)\)"
HEADING = re.compile(rf"(?:(u|y):)?\s*([^\[\]]+?)\s*(?:{_UNIT})?")
# Lines read at once.
LINES = 8192
AGAIN = "copy or record it again"
ADVICE = "the first line must read like: time [s],u:torque [N m],y:angle [rad]"
# What tables write where there is no sample.
NO_SAMPLE = frozenset({"n/a", "na", "null", "none", "missing", "-", "--", "div/0!", "value!", "ref!", "num!"})
NAMES_FIRST = (
    "one line names the columns and comes first, units in brackets behind the names; begin other words with #"
)
DATES = "times as seconds in a column headed time [s], in place of dates and clock times"
SEPARATOR_LINE = re.compile(r"sep=.?", re.IGNORECASE)  # a line for spreadsheet programs
Row = tuple[int, list[str]]


@record(kw_only=True)
class Opening:
    """The lines before the numbers.

    ``names`` of the columns (empty if there is no such line), whether the first of them is the time and its
    unit, ``periods``, ``samples`` and ``channels`` as stated in comments, and the separator.
    """

    line: int
    heads: tuple[ChannelHeader, ...]
    timed: bool
    periods: int | None
    separator: str
    samples: int | None = None
    second: float = 1.0  # unit of the times [s]
    in_words: bool = True  # whether the heading says that unit

    def check_samples(self, count: int, file: Path) -> None:
        """Raise `DataError` where the file has fewer or more lines than it says."""
        if self.samples not in (None, count):
            what = f"{'truncated' if count < self.samples else 'too long'}: {count} of {self.samples} samples"
            raise DataError(what, where=str(file), hint=AGAIN)


def read_csv(file: Path, variable: str) -> Raw:
    """The record; missing lines between time stamps become samples that are not a number, with a fault."""
    with _opened(file) as text:
        opening = read_opening(text, file)
    tables = [table for _, table in _tables(file, opening, LINES)]
    table = np.concatenate(tables) if tables else np.empty((0, len(opening.heads) + opening.timed))
    opening.check_samples(len(table), file)
    rate, share = None, SAME_RATE
    faults = (*_format_notes(file, opening), *cut_short(file, opening.heads, opening.separator))
    if opening.timed:
        digit = _last_digit(file, opening)
        rate, table, gaps = _on_one_grid(table, file, opening.heads, digit)
        faults = (*faults, *gaps, *_warnings_on_rate(opening, rate, digit, float(table[0, 0])))
        share = max(share, open_share(rate, len(table), digit))
        table = table[:, 1:]
    periods = opening.periods or 1
    if len(table) % periods:
        what = f"{len(table)} samples are not {periods} whole periods"
        raise DataError(what, where=str(file), hint="the file may be truncated; mend its line of periods")
    x = tuple(column.reshape(1, periods, -1) for column in table.T)
    return Raw(
        sample_hz=rate,
        heads=opening.heads,
        x=x,
        periodic=opening.periods is not None,
        faults=faults,
        rate_share=share,
    )


def write_csv(path: Path, stream: RecordStream) -> None:
    """Write the one experiment of ``stream``, every digit of its samples, block by block.

    The rate is read back to nine digits; whether inputs were held is not written.
    """
    if stream.experiments != 1:
        raise DataError(
            f"{stream.experiments} experiments do not fit in one CSV file", where=str(path),
            hint="write .npz or .h5, or one experiment at a time",
        )  # fmt: skip
    sides = (("u", stream.inputs), ("y", stream.outputs))
    headings = [_heading(side, port, path) for side, ports in sides for port in ports]
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as text:
        text.write(f"# samples = {stream.samples}\n")
        if stream.period:
            text.write(f"# periods = {stream.samples // stream.period}\n")
        for side, ports in sides:
            for port in ports:
                text.write(_channel_comment(f"{side}:{port.name}", port.channel))
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["time [s]", *headings])
        start = 0
        for u, y in stream.blocks(LINES):
            time = (start + np.arange(len(u))) / stream.sample_hz
            # Digits to spare: two stamps "0" and "0.003" would not show their rounding.
            writer.writerows(
                [f"{t:.12f}", *row] for t, row in zip(time, np.hstack([u, y]).tolist(), strict=True)
            )
            start += len(u)


def _heading(side: str, port: Port, path: Path) -> str:
    """The heading of a column; `DataError` for a name or a unit that would not be read back from it."""
    heading = f"{side}:{port.name} [{port.unit}]"
    found = HEADING.fullmatch(heading)
    # A semicolon would be taken for the separator of the file.
    read = None if found is None or ";" in heading else (found[2], found[3].strip())
    if read != (port.name, port.unit) or not heading.isprintable():
        what = f"{port.name!r} in {port.unit!r} is no heading of a CSV column"
        raise DataError(
            what, where=str(path), hint="a name without brackets and semicolons, or write .npz or .h5"
        )
    return heading


def _channel_comment(name: str, channel: Channel | None) -> str:
    known = {k: v for k in KEYS if (v := getattr(channel or Channel(), k)) not in ("", None)}
    pairs = ", ".join(f"{k} = {_toml(v)}" for k, v in known.items())
    return f"# channel {_toml(name)} = {{ {pairs} }}\n" if known else ""


def _toml(value: str | float) -> str:
    if not isinstance(value, str):
        return repr(float(value))
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


@contextmanager
def _opened(file: Path) -> Generator[TextIO]:
    try:
        with open(file, encoding="utf-8-sig", newline="") as text:
            yield text
    except (UnicodeDecodeError, csv.Error) as error:
        what = f"not CSV text: {error}"
        raise DataError(what, where=str(file), hint="save it as UTF-8 CSV, with decimal points") from None


def read_opening(text: TextIO, file: Path) -> Opening:
    """Comments and the line of names; leaves ``text`` behind it."""
    given: dict[str, Any] = {}
    for number, line in enumerate(iter(text.readline, ""), 1):
        stripped = line.strip()
        if stripped.startswith("#"):
            given |= _comment(stripped, f"{file}:{number}")
        elif stripped and not SEPARATOR_LINE.fullmatch(stripped):
            return _opening(stripped, number, given, file)
    raise DataError("the file has no lines", where=str(file), hint=AGAIN)


def _comment(line: str, where: str) -> dict[str, Any]:
    """Keys of a comment: ``# periods = 3``, ``# samples = 8``, ``# channel "u:x" = { node = "12" }``."""
    found = re.match(r"#\s*(?:(periods|samples)\s*=|(channel)\s+\")", line)
    if found is None:
        return {}
    body = line[found.start(1) :] if found.group(1) else line[found.end(2) :]
    try:
        return tomllib.loads(body)
    except tomllib.TOMLDecodeError as error:
        raise DataError(
            f"{line!r}: {error}", where=where, hint='as in # channel "u:torque" = { node = "12" }'
        ) from None


def _opening(line: str, number: int, given: dict[str, Any], file: Path) -> Opening:
    where = f"{file}:{number}"
    separator = separator_of(line)
    cells = [c.strip() for c in _unended(next(csv.reader([line], delimiter=separator)))]
    periods, samples = (_whole(given, key, where) for key in ("periods", "samples"))
    named = not all(map(_is_number, cells))
    heads = [
        _head(cell, k, given, where) if named else ChannelHeader("", None, "") for k, cell in enumerate(cells)
    ]
    times = TIMES.fullmatch(heads[0].name)
    timed = times is not None
    unit = heads[0].unit
    if times is not None and unit is None and times.group(1) is not None:
        unit = times.group(1).lower()
    if unit not in (*SECONDS, None) if timed else any(h.side for h in heads) and not heads[0].side:
        raise DataError(f"the first column is {cells[0]!r}, not time [s]", where=where, hint=ADVICE)
    return Opening(
        line=number if named else number - 1,
        heads=tuple(heads[timed:]),
        timed=timed,
        periods=periods,
        separator=separator,
        samples=samples,
        second=SECONDS.get(unit or "s", 1.0) if timed else 1.0,
        in_words=unit is not None,
    )


def _format_notes(file: Path, opening: Opening) -> tuple[RecordFault, ...]:
    """Notes on unusual readings of numbers: decimal commas, times that are not in seconds."""
    notes: list[str] = []
    if any("," in cell for cells in _first_rows(file, opening) for cell in cells):
        notes.append("decimal commas are read as points")
    if opening.second != 1.0:
        notes.append(f"times are read in units of {opening.second:g} s, as the heading says")
    hint = "nothing, if the file means it so"
    return (channel_fault("format", "note", opening.heads[0], "; ".join(notes), hint),) if notes else ()


def _warnings_on_rate(opening: Opening, rate: float, digit: float, first: float) -> tuple[RecordFault, ...]:
    """Times at a rate that no structure is sampled at: a heading that says seconds may be wrong, too.

    A file that states its samples is ours, and its times are seconds.
    """
    counted = opening.second == 1.0 and rate == 1.0 and digit == 1.0
    meant = opening.in_words and not counted
    what = "" if meant and (opening.samples or rate >= SLOWEST) else warning_on_seconds(rate, counted, first)
    if not what and (meant or rate >= SLOW or not since_1970(first)):
        return ()
    if not what:
        day = datetime.datetime.fromtimestamp(first, datetime.UTC).date()
        what = f"times are read as seconds since 1970, from {day} on, at {rate:.6g} Hz"
        hint = "nothing, if that is the day; if they are ticks, state the rate (--sample-hz)"
        return (channel_fault("format", "note", opening.heads[0], what, hint),)
    hint = "state the rate (--sample-hz) if it is right; if not, head the column time [ms], or leave it out"
    return (channel_fault("rate", "serious", opening.heads[0], what, hint),)


def _first_rows(file: Path, opening: Opening) -> list[list[str]]:
    with _opened(file) as text:
        lines = itertools.islice(text, opening.line, opening.line + LINES)
        return [row for row in csv.reader(lines, delimiter=opening.separator) if row and row[0][:1] != "#"]


def _whole(given: dict[str, Any], key: str, where: str) -> int | None:
    number = given.pop(key, None)
    if number is not None and not (isinstance(number, int) and number > 0):
        raise DataError(f"{key} is {number!r}", where=where, hint="a whole number above zero")
    return number


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[+-]?[\d.,]+([eEdD][+-]?\d+)?|[+-]?(nan|inf)", cell, re.IGNORECASE) is not None


def _head(cell: str, k: int, given: dict[str, Any], where: str) -> ChannelHeader:
    found = HEADING.fullmatch(cell)
    letter, name, *units = found.groups() if found else ("u", "")
    unit = next((u for u in units if u is not None), None)
    if letter and unit is None:
        raise DataError(f"column {k + 1} is headed {cell!r}", where=where, hint=ADVICE)
    side: Side = "input" if letter == "u" else "output" if letter == "y" else ""
    channel = build_channel(given.get(f"{letter}:{name}", {}), f"{where}, channel {name}")
    return ChannelHeader(name, None if unit is None else unit.strip(), side, channel)


def _tables(file: Path, opening: Opening, size: int) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers of ``size`` lines at a time, with the line on which each block begins."""
    width = len(opening.heads) + opening.timed
    with _opened(file) as text:
        for _ in range(opening.line):
            text.readline()
        rows = (
            (opening.line + n, _unended(cells) if len(cells) == width + 1 else cells)
            for n, cells in enumerate(csv.reader(text, delimiter=opening.separator), 1)
            if cells and any(cells) and not cells[0].startswith("#")
        )
        while block := list(itertools.islice(rows, size)):
            table = _numbers(block, width, file, opening.separator)
            table[:, : int(opening.timed)] *= opening.second
            yield block[0][0], table


def _unended(cells: list[str]) -> list[str]:
    """The cells without the empty one that a separator at the end of a line makes."""
    return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells


def _numbers(block: list[Row], width: int, file: Path, separator: str) -> Float[np.ndarray, "line column"]:
    try:
        table = np.array([cells for _, cells in block], dtype=float)
    except ValueError:
        if separator == ",":
            refuse_thousands(((n, c) for n, cells in block for c in cells), file)
        block = [(n, with_points(cells, f"{file}:{n}")) for n, cells in block]
        table = np.array([_line(row, width, file) for row in block])
    if table.shape[1] != width:
        _line(block[0], width, file)
    return table


def _line(row: Row, width: int, file: Path) -> list[float]:
    """One line; raises `DataError` with the reason why it is none."""
    number, cells = row
    where = f"{file}:{number}"
    cut = "the file may be truncated here; cut or mend the line"
    if len(cells) != width:
        what = f"mismatched lengths: {len(cells)} values for {width} columns"
        commas = "decimal commas? part the columns with semicolons, or write decimal points"
        # A decimal comma makes two values of one number, but one of a number without a fraction.
        several = commas if len(cells) == 2 * width else f"{commas}; or name every column"
        hint = NAMES_FIRST if width == 1 else several if width < len(cells) <= 2 * width else cut
        raise DataError(what, where=where, hint=hint)
    empty = next((k for k, c in enumerate(cells, 1) if not c.strip()), None)
    if empty is not None:
        hint = cut if empty == width else "nan where there is no sample"
        raise DataError(f"cell {empty} of {width} is empty", where=where, hint=hint)
    try:
        return [float(c) for c in cells]
    except ValueError as error:
        none = any(c.strip().strip("#").lower() in NO_SAMPLE for c in cells)
        points = "nan where there is no sample" if none else "numbers with a decimal point only"
        hint = points if any(map(_is_number, cells)) else NAMES_FIRST
        if re.match(r"\d{4}-\d\d-\d\d|\d{1,2}[.:/]\d\d[.:/]\d", cells[0].strip()):
            raise DataError(f"{cells[0]!r} is a date or a clock time", where=where, hint=DATES) from None
        raise DataError(str(error), where=where, hint=hint) from None


def _last_digit(file: Path, opening: Opening) -> float:
    """A unit of the last digit [s] with which the first stamps are printed."""
    return opening.second * last_digit(row[0].replace(",", ".") for row in _first_rows(file, opening))


def _on_one_grid(
    table: Float[np.ndarray, "line column"], file: Path, heads: tuple[ChannelHeader, ...], digit: float
) -> tuple[float, np.ndarray, tuple[RecordFault, ...]]:
    """Rate [Hz] and the lines on an even grid; refuses stamps that are on none."""
    time = table[:, 0]
    if len(time) < 2:
        raise DataError(f"{len(time)} samples give no sampling rate", where=str(file), hint="record longer")
    if not np.isfinite(time).all():
        where = f"{file}, sample {int(np.argmin(np.isfinite(time)))}"
        raise DataError("time is not finite", where=where, hint="mend or cut the line")
    index = np.arange(len(time))
    step = mean_step(*_sums(time, 0, time[0]), len(time))
    if is_even(time, index, step, digit):
        return rate_of(step, len(time), digit), table, ()
    return _with_gaps(table, file, heads, digit)


def _sums(time: Float[np.ndarray, " line"], start: int, origin: float) -> tuple[float, float]:
    """Sums of k (t_k - origin) and of (t_k - origin), from line ``start`` on."""
    since = time - origin
    return float((start + np.arange(len(time))) @ since), float(since.sum())


def _with_gaps(
    table: Float[np.ndarray, "line column"], file: Path, heads: tuple[ChannelHeader, ...], digit: float
) -> tuple[float, np.ndarray, tuple[RecordFault, ...]]:
    """Lines spread over the grid of the usual step where stamps leap by whole steps."""
    time = table[:, 0]
    steps = np.diff(time)
    usual = float(np.sort(steps)[len(steps) // 2])
    # The mean of those that rounding makes unlike: the median is a rounded step itself.
    usual = float(steps[np.abs(steps - usual) <= 1.001 * digit].mean()) if usual > 2.0 * digit else usual
    error_s = np.abs(steps - usual)
    leap = np.rint(steps / usual) if usual > 0.0 else np.zeros(len(time) - 1)
    index = np.concatenate([[0], np.cumsum(leap)]).astype(int)
    # No gap may outgrow the record: a stamp that leaps so far is wrong itself.
    fits = leap.min() >= 1.0 and index[-1] < 2 * len(time)
    step = float(np.polyfit(index, time - time[0], 1)[0]) if fits else 0.0
    if not is_even(time, index, step, digit):
        worst = int(error_s.argmax()) + 1
        coarse = 0.0 <= usual <= 2.0 * digit and error_s.max() <= 2.0 * digit
        if usual < 0.0:
            raise DataError("time falls", where=f"{file}, channel time", hint="sort the lines by time")
        if steps.min() < -2.0 * digit:
            back = int(steps.argmin())
            raise DataError(
                f"time goes back by {-steps[back]:.3g} s behind sample {back}",
                where=f"{file}, channel time", hint="part the file there: it holds two recordings",
            )  # fmt: skip
        raise DataError(
            f"uneven time steps: sample {worst} is {error_s[worst - 1]:.3g} s off steps of {usual:.6g} s",
            where=f"{file}, channel time",
            hint=f"stamps are printed to {digit:g} s: print more digits, or leave the column out and state "
            "name_columns(sample_hz=RATE)" if coarse else "resample all channels to one rate",
        )  # fmt: skip
    whole = np.full((index[-1] + 1, table.shape[1]), np.nan)
    whole[index] = table
    leaps = np.flatnonzero(np.diff(index) > 1)
    runs = tuple((int(index[k]) + 1, int(index[k + 1])) for k in leaps)
    missing = len(whole) - len(table)
    what = f"{missing} time stamps are missing, the first at {time[0] + step * runs[0][0]:.6g} s"
    hint = "cut the record before the gap, or record it again"
    faults = tuple(channel_fault("gap", "unusable", h, what, hint, samples=runs[:100]) for h in heads)
    return rate_of(step, len(time), digit), whole, faults


def head_csv(file: Path) -> tuple[Raw, tuple[int, int, int]]:
    """Everything but the samples, and the shape (experiment, period, sample); reads the file once."""
    with _opened(file) as text:
        opening = read_opening(text, file)
    count, first, last, rate, share, sums = 0, 0.0, 0.0, None, SAME_RATE, np.zeros(2)
    for _, table in _tables(file, opening, LINES):
        first = table[0, 0] if count == 0 else first
        sums += _sums(table[:, 0], count, first)
        count, last = count + len(table), table[-1, 0]
    opening.check_samples(count, file)
    if opening.timed:
        step = mean_step(float(sums[0]), float(sums[1]), count) if count > 1 else 0.0
        if not (last > first and step > 0.0):
            raise DataError(f"{count} samples give no sampling rate", where=str(file), hint="record longer")
        digit = _last_digit(file, opening)
        rate = rate_of(step, count, digit)
        share = max(share, open_share(rate, count, digit))
    periods = opening.periods or 1
    shape = (1, periods, count // periods)
    x = tuple(np.broadcast_to(0.0, shape) for _ in opening.heads)
    return Raw(
        sample_hz=rate, heads=opening.heads, x=x, periodic=opening.periods is not None, rate_share=share
    ), shape


def pieces_csv(file: Path, sample_hz: float | None, size: int) -> Iterator[np.ndarray]:
    """All channels [sample, channel], at most ``size`` lines at a time; refuses uneven time stamps."""
    with _opened(file) as text:
        opening = read_opening(text, file)
    start, origin, slack = 0, None, 0.0
    if opening.timed and sample_hz is not None:
        digit = _last_digit(file, opening)
        # The first stamp is rounded itself.
        slack = max(JITTER / sample_hz, digit if digit <= 0.5 / sample_hz else 0.0)
    for line, table in _tables(file, opening, size):
        if opening.timed and sample_hz is not None:
            origin = table[0, 0] if origin is None else origin
            error_s = np.abs(table[:, 0] - origin - (start + np.arange(len(table))) / sample_hz)
            if not error_s.max() <= slack * (1.0 + 1e-6):
                raise DataError(
                    f"uneven time steps: sample {start + int(error_s.argmax())} is {error_s.max():.3g} s off",
                    where=f"{file}, channel time, near line {line}",
                    hint="load_record says whether there are gaps; resample all channels to one rate",
                )
        start += len(table)
        yield table[:, int(opening.timed) :]
