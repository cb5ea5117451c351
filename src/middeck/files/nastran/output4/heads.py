"""Common part of text and binary OUTPUT4 files: their headers."""

from collections.abc import Callable
from typing import NoReturn

from middeck.values import record

SYMMETRIC = 6
COMPLEX = (3, 4)
DOUBLE = (2, 4)
# Nastran's: square, rectangular, diagonal, lower, upper, symmetric, row, identity, and those of factors.
FORMS = (*range(1, 16),)
# Rows from here on do not fit beside a length into 32 bits.
BIG = 65536


@record(kw_only=True)
class MatrixHeader:
    """Header of a matrix: ``kind`` is 1 to 4, real or complex in single or double precision."""

    columns: int
    rows: int
    big: bool
    form: int
    kind: int
    name: str


def head_of(numbers: tuple[int, ...], name: str, fail: Callable[[str], NoReturn]) -> MatrixHeader:
    """The header; calls ``fail`` for numbers that are impossible in one."""
    columns, rows, form, kind = numbers
    if not (columns > 0 and rows != 0 and form in FORMS and 1 <= kind <= 4):
        fail(f"a header of {columns} columns, {rows} rows, form {form} and type {kind}, which is no matrix's")
    if not (name.isascii() and name.isprintable()):
        fail(f"a header with the name {name!r}")
    return MatrixHeader(
        columns=columns, rows=abs(rows), big=rows < 0 or rows >= BIG, form=form, kind=kind, name=name
    )
