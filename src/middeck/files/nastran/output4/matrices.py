"""OUTPUT4 files of matrices: dense or sparse, text or binary, either byte order, integers of 32 or 64 bits.

Each matrix is a header (columns, rows, form, type, name), columns of *strings* (runs of entries below one
another), and a column beyond the last. A negative number of rows says that a sparse matrix has its rows apart
from its lengths ("bigmat"). What a file says of itself twice must agree: lengths of records, counts, order
and range of rows and columns, symmetry. Format: MSC Nastran DMAP Programmer's Guide, OUTPUT4; decision 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np
import scipy.sparse as sp

from middeck.errors import ConfigError, DataError
from middeck.files.disk.atomic import replacing
from middeck.files.nastran.output4.binary import BinarySource, BinaryTarget, is_binary
from middeck.files.nastran.output4.heads import BIG, COMPLEX, DOUBLE, SYMMETRIC, Head
from middeck.files.nastran.output4.text import TextSource, TextTarget

Layout = Literal["dense", "bigmat", "nonbigmat"]
Source = BinarySource | TextSource
Target = BinaryTarget | TextTarget
SQUARE = 1
# Of the geometric mean of the two diagonals, and of the largest entry: what a determinate boundary has of
# stiffness is rounding of what it was condensed from.
UNEQUAL = {False: (1e-5, 1e-5), True: (1e-8, 1e-7)}


class Op4Matrix(NamedTuple):
    """A matrix of an OUTPUT4 file: name, Nastran's form (6: symmetric), and its entries, real or complex."""

    name: str
    form: int
    value: sp.csc_array


def read_op4(path: str | Path) -> tuple[Op4Matrix, ...]:
    """All matrices of an OUTPUT4 file, in order.

    Raises `DataError` with the matrix and the line or byte for a file that is cut off, damaged or none.
    """
    where = str(path)
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=where, hint="check the path") from None
    source: Source = BinarySource(content, where) if is_binary(content) else TextSource(content, where)
    found: list[Op4Matrix] = []
    while (head := source.head()) is not None:
        found.append(_matrix(source, head))
    if not found:
        raise DataError("there is no matrix in it", where=where, hint="is it an OUTPUT4 file?")
    return tuple(found)


def op4_by_name(path: str | Path) -> dict[str, Op4Matrix]:
    """The matrices by name, in capitals; raises `DataError` for a name that stands twice."""
    out: dict[str, Op4Matrix] = {}
    for matrix in read_op4(path):
        name = matrix.name.upper()
        if name in out:
            raise DataError(f"two matrices {name!r}", where=str(path), hint="write one of them")
        out[name] = matrix
    return out


def _matrix(source: Source, head: Head) -> Op4Matrix:
    rows, column, value = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    last, dense = 0, None
    while True:
        at, row, words = source.column()
        if not last < at <= head.columns + 1:
            source.fail(f"column {at} after column {last} of {head.columns}")
        last = at
        if at > head.columns:
            source.end()
            break
        if dense not in (None, row > 0):
            source.fail("a dense column and a sparse one in one matrix")
        dense = row > 0
        if dense and head.big and head.rows < BIG:  # beyond that the sign of the rows is free
            source.fail(f"a dense column (row {row}) of a sparse matrix")
        below = 1
        for start, numbers in _strings(source, head, row, words):
            if start < below or start + len(numbers) - 1 > head.rows:
                source.fail(f"{len(numbers)} rows from {start} on, after row {below - 1} of {head.rows}")
            below = start + len(numbers)
            rows.append(np.arange(start - 1, below - 1))
            column.append(np.full(len(numbers), at - 1))
            value.append(numbers)
        source.end_column()
    entries = (np.concatenate(value), (np.concatenate(rows), np.concatenate(column)))
    matrix = sp.csc_array(sp.coo_array(entries, shape=(head.rows, head.columns)))
    _check_form(source, head, matrix)
    return Op4Matrix(head.name, head.form, matrix)


def _strings(source: Source, head: Head, row: int, words: int) -> list[tuple[int, np.ndarray]]:
    """First row and entries of each run of a column."""
    if row > 0:
        return [(row, _numbers(source, head, source.dense_count(words, head)))]
    found: list[tuple[int, np.ndarray]] = []
    while words > 0:
        if head.big:
            length, start = source.integers(2)
            words -= length + 1
        else:
            length, start = divmod(source.integers(1)[0], BIG)
            words -= length
        count, rest = divmod(length - 1, source.words_per_real(head))
        if words < 0 or rest or count <= 0:
            source.fail(f"a run of {length - 1} words in a column with {words + length} words left")
        found.append((start, _numbers(source, head, count)))
    return found


def _numbers(source: Source, head: Head, count: int) -> np.ndarray:
    if count <= 0 or (head.kind in COMPLEX and count % 2):
        source.fail(f"{count} numbers for {'complex' if head.kind in COMPLEX else 'real'} entries")
    numbers = source.reals(head, count)
    if not np.all(np.isfinite(numbers)):
        source.fail("a number that is not finite")
    return numbers[0::2] + 1j * numbers[1::2] if head.kind in COMPLEX else numbers


def _check_form(source: Source, head: Head, matrix: sp.csc_array) -> None:
    if head.form in (SQUARE, SYMMETRIC) and head.rows != head.columns:
        source.fail(f"a square matrix (form {head.form}) of {head.rows} rows and {head.columns} columns")
    if head.form != SYMMETRIC:
        return
    size, (near, least) = np.sqrt(np.abs(matrix.diagonal())), UNEQUAL[head.kind in DOUBLE]
    apart = sp.coo_array(matrix - matrix.T)
    row, column = apart.coords
    most = np.abs(matrix.data).max(initial=0.0)
    off = np.abs(apart.data) > near * size[row] * size[column] + least * most
    if np.any(off):
        i, j = int(row[off][0]), int(column[off][0])
        a, b = matrix[i, j], matrix[j, i]
        source.fail(f"said to be symmetric (form 6), but ({i + 1}, {j + 1}) is {a:g} and its mirror {b:g}")


def write_op4(
    path: str | Path,
    matrices: Sequence[Op4Matrix],
    *,
    layout: Layout = "dense",
    text: bool = False,
    byte_order: Literal["<", ">"] = "<",
    single: bool = False,
) -> None:
    """Write matrices to an OUTPUT4 file, whole or not at all; text has 17 digits, of single precision 9.

    Raises `ConfigError` for a name of more than eight characters, numbers that are not finite, and more rows
    than a layout can hold.
    """
    target: Target = TextTarget(single) if text else BinaryTarget(single, byte_order)
    for matrix in matrices:
        _write_matrix(target, matrix, layout, single, str(path))
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(target.content())


def _write_matrix(target: Target, matrix: Op4Matrix, layout: Layout, single: bool, where: str) -> None:
    value = sp.csc_array(matrix.value)
    value.sum_duplicates()
    value.eliminate_zeros()
    rows, columns = cast("tuple[int, int]", value.shape)
    if not (0 < len(matrix.name) <= 8 and matrix.name.isascii()):
        raise ConfigError(
            f"{matrix.name!r} is no name of a matrix", where=where, hint="one to eight characters"
        )
    most = np.finfo("f4" if single else "f8").max
    if not np.all(np.abs(_reals(value.data)) <= most):
        raise ConfigError(
            f"matrix {matrix.name!r} has a number that is not finite, or above {most:.3g}", where=where
        )
    if layout == "nonbigmat" and rows >= BIG:
        raise ConfigError(f"{rows} rows are too many for nonbigmat", where=where, hint="bigmat")
    complex_ = np.iscomplexobj(value.data)
    kind, per = (1 if single else 2) + 2 * complex_, (1 if single else 2) * (1 + complex_)
    big = layout == "bigmat"
    target.head(Head(columns, rows, big, matrix.form, kind, matrix.name))
    for j in range(columns):
        part = slice(value.indptr[j], value.indptr[j + 1])
        index, data = value.indices[part], value.data[part]
        if not len(index):
            continue
        if layout == "dense":
            full = np.zeros(index[-1] - index[0] + 1, data.dtype)
            full[index - index[0]] = data
            reals = len(full) * (1 + complex_)
            target.column(j + 1, index[0] + 1, reals if isinstance(target, TextTarget) else len(full) * per)
            target.reals(_reals(full))
            continue
        runs = np.split(np.arange(len(index)), np.flatnonzero(np.diff(index) > 1) + 1)
        target.column(j + 1, 0, sum(len(run) * per + 1 + big for run in runs))
        for run in runs:
            length, start = len(run) * per + 1, int(index[run[0]]) + 1
            target.integers([length, start] if big else [length * BIG + start])
            target.reals(_reals(data[run]))
    target.end(columns)


def _reals(values: np.ndarray) -> np.ndarray:
    if not np.iscomplexobj(values):
        return values
    return np.stack([np.real(values), np.imag(values)], axis=1).ravel()
