"""Separators of CSV columns, and numbers with decimal commas."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from middeck.errors import DataError

# Digits in groups of three: in a line with decimal commas, points stand between thousands.
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+")
COMMA = re.compile(r"[+-]?\d*,\d*(?:[eEdD][+-]?\d+)?")


def separator_of(line: str) -> str:
    """The separator of columns: a tab or a semicolon where there is one, else a comma."""
    return next((s for s in ("\t", ";") if s in line), ",")


def refuse_thousands(cells: Iterable[tuple[int, str]], file: Path) -> None:
    """Raise `DataError` where all commas in ``cells``, of numbered lines, may part thousands, as in "1,234".

    A file whose columns commas part quotes such cells of either kind.
    """
    commas = [(n, c) for n, c in cells if "," in c]
    if commas and all(THOUSANDS.fullmatch(c.strip().replace(",", ".")) and "." not in c for _, c in commas):
        line, cell = commas[0]
        hint = "nothing between thousands; of decimal commas, part the columns with semicolons"
        raise DataError(f"{cell!r} may be 1000 times as much", where=f"{file}:{line}", hint=hint)


def with_points(cells: Sequence[str], where: str) -> list[str]:
    """``cells`` with decimal points in place of commas, of columns that no comma parts.

    Raises `DataError` for a comma that is no decimal one, as in 1,234.5 or 1,234,567, and for a point beside
    decimal commas that may be none, as in 1.234.

    >>> with_points(["0,5", "1.5", "-2,0e-3"], "run.csv:2")
    ['0.5', '1.5', '-2.0e-3']
    """
    commas = any("," in cell for cell in cells)
    for cell in map(str.strip, cells):
        if not COMMA.fullmatch(cell) if "," in cell else commas and THOUSANDS.fullmatch(cell):
            hint = "numbers with one decimal comma or point, and nothing between thousands"
            raise DataError(f"{cell!r} is no number", where=where, hint=hint)
    return [cell.replace(",", ".") for cell in cells]
