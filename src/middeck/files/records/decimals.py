"""Separators of CSV columns, and numbers with decimal commas."""

from __future__ import annotations

import re
from collections.abc import Sequence

from middeck.errors import DataError

COMMA = re.compile(r"[+-]?\d*,\d*(?:[eEdD][+-]?\d+)?")


def separator_of(line: str) -> str:
    """The separator of columns: a tab or a semicolon where there is one, else a comma."""
    return next((s for s in ("\t", ";") if s in line), ",")


def with_points(cells: Sequence[str], where: str) -> list[str]:
    """``cells`` with decimal points in place of commas, of columns that no comma parts.

    Raises `DataError` for a comma that is no decimal one, as in 1,234.5 or 1,234,567.

    >>> with_points(["0,5", "1.5", "-2,0e-3"], "run.csv:2")
    ['0.5', '1.5', '-2.0e-3']
    """
    for cell in cells:
        if "," in cell and not COMMA.fullmatch(cell.strip()):
            hint = "numbers with one decimal comma or point, and nothing between thousands"
            raise DataError(f"{cell!r} is no number", where=where, hint=hint)
    return [cell.replace(",", ".") for cell in cells]
