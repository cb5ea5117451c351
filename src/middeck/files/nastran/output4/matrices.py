"""OUTPUT4 files of matrices: dense or sparse, text or binary, either byte order, integers of 32 or 64 bits.

Each matrix is a header (columns, rows, form, type, name), columns of *strings* (runs of entries below one
another), and a column beyond the last. A negative number of rows means that row and length of a sparse
string are separate numbers ("bigmat"). Redundant data must agree: lengths of records, counts, order and range
of rows and columns, symmetry. Format: MSC Nastran DMAP Programmer's Guide, OUTPUT4; decision 14.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import scipy.sparse as sp

from middeck.errors import ConfigError, DataError
from middeck.files.disk.atomic import write_bytes
from middeck.files.nastran.output4.binary import BinarySource, is_binary
from middeck.files.nastran.output4.heads import BIG, COMPLEX, DOUBLE, SYMMETRIC, MatrixHeader
from middeck.files.nastran.output4.text import TextSource

Source = BinarySource | TextSource
SQUARE = 1
# Largest asymmetry over the geometric mean of the two diagonals, and over the largest entry: a determinate
# boundary has only rounding as stiffness.
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


def _matrix(source: Source, head: MatrixHeader) -> Op4Matrix:
    rows, column, value = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    last, dense = 0, None
    seen: set[int] = set()
    while True:
        at, row, words = source.column()
        anyhow = isinstance(source, TextSource) and source.of_pynastran and row == 0
        if not (0 if anyhow else last) < at <= head.columns + 1 or at in seen:
            source.fail(f"column {at} after column {last} of {head.columns}")
        last = at
        seen.add(at)
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


def _strings(source: Source, head: MatrixHeader, row: int, words: int) -> list[tuple[int, np.ndarray]]:
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
            if not found and length == words and isinstance(source, TextSource) and source.of_pynastran:
                return _strings_of_whole_length(source, head, start, words)
            words -= length
        count, rest = divmod(length - 1, source.words_per_real(head))
        if words < 0 or rest or count <= 0:
            source.fail(f"a run of {length - 1} words in a column with {words + length} words left")
        found.append((start, _numbers(source, head, count)))
    return found


def _strings_of_whole_length(
    source: TextSource, head: MatrixHeader, start: int, words: int
) -> list[tuple[int, np.ndarray]]:
    """Runs of a column as pyNastran writes them: each states the length of all, two words a number."""
    found = [(start, _numbers(source, head, source.numbers_ahead()))]
    while source.integers_ahead():
        length, start = divmod(source.integers(1)[0], BIG)
        if length != words:
            source.fail(f"a run of {length} words in a column of runs of {words}")
        found.append((start, _numbers(source, head, source.numbers_ahead())))
    count = sum(len(run) for _, run in found) * (2 if head.kind in COMPLEX else 1)
    alone = len(found) == 1 and words == count * source.words_per_real(head) + 1
    if words != 2 * count + 1 and not alone:
        source.fail(f"{count} numbers in a column of {words} words")
    return found


def _numbers(source: Source, head: MatrixHeader, count: int) -> np.ndarray:
    if count <= 0 or (head.kind in COMPLEX and count % 2):
        source.fail(f"{count} numbers for {'complex' if head.kind in COMPLEX else 'real'} entries")
    numbers = source.reals(head, count)
    if not np.all(np.isfinite(numbers)):
        source.fail("a number that is not finite")
    return numbers[0::2] + 1j * numbers[1::2] if head.kind in COMPLEX else numbers


def _check_form(source: Source, head: MatrixHeader, matrix: sp.csc_array) -> None:
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
        source.fail(f"stated as symmetric (form 6), but ({i + 1}, {j + 1}) is {a:g} and its mirror {b:g}")


def write_op4(path: Path, matrices: Sequence[Op4Matrix]) -> None:
    """Write real matrices to a binary OUTPUT4 file, dense, whole or not at all.

    Raises `ConfigError` for a number that is not finite.
    """
    records: list[bytes] = []
    for name, form, value in matrices:
        if not np.all(np.isfinite(value.data)):
            raise ConfigError(
                f"matrix {name!r} has a number that is not finite",
                where=str(path),
                hint="look at how the matrix was computed",
            )
        rows, columns = cast("tuple[int, int]", value.shape)
        records.append(_record([columns, rows, form, 2], name.ljust(8).encode("ascii")))
        for j, column in enumerate(value.toarray().T, 1):
            if len(index := np.flatnonzero(column)):
                run = column[index[0] : index[-1] + 1]
                records.append(_record([j, index[0] + 1, 2 * len(run)], run.astype("<f8").tobytes()))
        records.append(_record([columns + 1, 1, 2], np.ones(1, "<f8").tobytes()))
    write_bytes(path, b"".join(records))


def _record(integers: Sequence[int], rest: bytes) -> bytes:
    body = np.asarray(integers, "<i4").tobytes() + rest
    marker = struct.pack("<i", len(body))
    return marker + body + marker
