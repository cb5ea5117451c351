"""Modal surveys as CSV, one line a mode: frequency, damping and shapes, or frequencies alone."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from middeck.errors import DataError
from middeck.files.records.decimals import refuse_thousands, separator_of, with_points
from middeck.structure.correlation.measured_modes import DIRECTIONS, PORTS, STRAIGHT, MeasuredModes

ADVICE = "the first line must read like: frequency [Hz],damping,n1.x,n1.y,n2.x"
FREQUENCY = {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / np.pi}
DAMPING = {"": 1.0, "1": 1.0, "-": 1.0, "%": 0.01}
LENGTH = {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
ANGLE = {"": 1.0, "rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180.0}
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")
PLAIN_COLUMNS = {
    "frequency": ("frequency", FREQUENCY), "damping": ("damping", DAMPING),
    "frequency std": ("frequency_std_hz", FREQUENCY), "damping std": ("damping_std", DAMPING),
}  # fmt: skip
ALIKE = {"freq": "frequency", "freq.": "frequency", "damping ratio": "damping"}
# Columns that only count or name the modes.
PASSED_OVER = ("no", "no.", "number", "mode", "mode no", "mode no.", "mode number", "mode name", "name")


def load_csv(path: Path) -> MeasuredModes:
    """The survey in a CSV file; without columns of shapes, one of frequencies alone.

    Columns are ``frequency [Hz]``, ``damping`` (a ratio, or ``[%]``), ``frequency std [Hz]``, ``damping std``
    and real shapes headed node.direction, as ``n1.x [mm]``; units may stand in round brackets. A column that
    numbers or names the modes is passed over. A damping that is not there is not a number.

    Raises `DataError`, with file and line, for headings that are not these, for units that are not known, and
    for cells that are not numbers.
    """
    rows, notes = _rows(path)
    head, body = rows[0], rows[1:]
    _refuse_copies(body, path)
    keys = [_key(cell, f"{path}:{head[0]}") for cell in head[1]]
    twice = sorted({name for name, _ in keys if [n for n, _ in keys].count(name) > 1})
    if twice or "frequency" not in dict(keys):
        what = f"two columns {twice[0]!r}" if twice else "no column of frequencies"
        raise DataError(what, where=f"{path}:{head[0]}", hint=ADVICE)
    table = np.array([_numbers(cells, f"{path}:{n}") for n, cells in body])
    table = table.reshape(-1, len(keys)) * np.array([scale for _, scale in keys])
    columns = dict(zip([name for name, _ in keys], table.T, strict=True))
    plain = {field: columns.pop(name) for name, (field, _) in PLAIN_COLUMNS.items() if name in columns}
    hz = plain.pop("frequency")
    places = [name.rsplit(".", 1) for name in columns]
    try:
        return MeasuredModes(
            frequency_hz=hz,
            damping=plain.pop("damping", np.full(len(hz), np.nan)),
            node=tuple(node for node, _ in places),
            direction=tuple(way for _, way in places),
            shape=np.array(list(columns.values())).reshape(len(places), len(hz)),
            warnings=notes,
            **plain,
        )
    except DataError as error:
        raise DataError(error.what, where=str(path), hint=error.hint or ADVICE) from None


def _refuse_copies(body: Sequence[tuple[int, list[str]]], path: Path) -> None:
    """Raise `DataError` where a mode with a shape is there twice, to the digit."""
    lines: dict[tuple[str, ...], int] = {}
    for number, cells in body:
        first = lines.setdefault(tuple(cells), number)
        if first != number and len(cells) > len(PLAIN_COLUMNS):
            raise DataError(f"the mode of line {first} again", where=f"{path}:{number}", hint="leave one out")


def _rows(path: Path) -> tuple[list[tuple[int, list[str]]], tuple[str, ...]]:
    """Line number and cells of each line with data, without columns that number or name the modes.

    Also notes on decimal commas.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        kept = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
        mark = separator_of(kept[0][1]) if kept else ","
        found = [(n, [c.strip() for c in next(csv.reader([line], delimiter=mark))]) for n, line in kept]
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"not CSV text: {error}", where=str(path), hint="save it as UTF-8 CSV") from None
    if len(found) < 2:
        raise DataError("no modes" if found else "the file has no lines", where=str(path), hint=ADVICE)
    read = [i for i, cell in enumerate(found[0][1]) if cell.lower().replace("_", " ") not in PASSED_OVER]
    width = len(found[0][1])
    found = [(n, _cells_read(cells, read, width, f"{path}:{n}")) for n, cells in found]
    numbers = [(n, cell) for n, cells in found[1:] for cell in cells]
    if mark == "," or not any("," in cell for _, cell in numbers):
        return found, ()
    if any("." in cell for _, cell in numbers):
        refuse_thousands(numbers, path)
    body = [(n, _pointed(cells, f"{path}:{n}")) for n, cells in found[1:]]
    return [found[0], *body], ("decimal commas are read as points",)


def _cells_read(cells: list[str], read: list[int], width: int, where: str) -> list[str]:
    if len(cells) != width:
        commas = ", and decimal points; where decimals have commas, semicolons between the columns"
        hint = "one number a column" + (commas if len(cells) > width else "")
        raise DataError(f"{len(cells)} cells for {width} columns", where=where, hint=hint)
    return [cells[i] for i in read]


def _pointed(cells: list[str], where: str) -> list[str]:
    """Cells with decimal points; beside decimal commas a point between thousands is no decimal one."""
    doubtful = [c for c in cells if THOUSANDS.fullmatch(c)] if any("," in c for c in cells) else []
    if doubtful:
        hint = "decimal commas, and nothing between thousands"
        raise DataError(f"{doubtful[0]!r} beside decimal commas is unclear", where=where, hint=hint)
    return with_points(cells, where)


def _key(cell: str, where: str) -> tuple[str, float]:
    """Name of a column in small letters, or node.direction; the factor that makes SI of it."""
    found = re.fullmatch(r"([^\[\]]+?)\s*(?:\[([^\]]*)\])?", re.sub(r"\(([^()]*)\)$", r"[\1]", cell))
    if found is None:
        raise DataError(f"a column is headed {cell!r}", where=where, hint=ADVICE)
    name, unit = found[1], (found[2] or "").strip()
    plain = name.lower().replace("_", " ")
    plain = ALIKE.get(plain, plain)
    if plain in PLAIN_COLUMNS:
        scales = PLAIN_COLUMNS[plain][1]
        plain_unit = unit or ("Hz" if scales is FREQUENCY else "")
    else:
        node, _, way = name.rpartition(".")
        if not node or way not in DIRECTIONS:
            hint = f"{ADVICE}; directions are {', '.join(DIRECTIONS)}"
            raise DataError(f"a column is headed {cell!r}", where=where, hint=hint)
        plain, scales, plain_unit = name, _scales(way), unit
    if plain_unit not in scales:
        known = ", ".join(u for u in scales if u)
        raise DataError(f"{name} is in {unit!r}", where=where, hint=f"one of {known}")
    return plain, scales[plain_unit]


def _scales(way: str) -> dict[str, float]:
    """Units of a direction; a port may read or move metres or radians."""
    return LENGTH | ANGLE if way in PORTS else LENGTH if way in STRAIGHT else ANGLE


def _numbers(cells: list[str], where: str) -> list[float]:
    try:
        return [float(c) for c in cells]
    except ValueError as error:
        raise DataError(
            str(error), where=where, hint="a number in each cell; leave columns with gaps out"
        ) from None
