"""OUTPUT4 files in every form that other programs write: layouts, text or binary, byte orders, precisions."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, cast

import numpy as np
import scipy.sparse as sp

from middeck.errors import ConfigError
from middeck.files.nastran.output4.heads import BIG, MatrixHeader
from middeck.files.nastran.output4.matrices import Op4Matrix

Layout = Literal["dense", "bigmat", "nonbigmat"]


class BinaryTarget:
    """Records in one byte order, with integers of 32 bits."""

    def __init__(self, single: bool, order: str) -> None:
        self.real, self.order = np.dtype(f"{order}f{4 if single else 8}"), order
        self.records: list[bytes] = []
        self.parts: list[bytes] = []

    def head(self, head: MatrixHeader) -> None:
        """Begin a matrix."""
        self.integers([head.columns, -head.rows if head.big else head.rows, head.form, head.kind])
        self.parts.append(head.name.ljust(8).encode("ascii"))

    def column(self, column: int, row: int, words: int) -> None:
        """Begin a column."""
        self._close()
        self.integers([column, row, words])

    def integers(self, values: Sequence[int]) -> None:
        """Go on with integers."""
        self.parts.append(np.asarray(values, f"{self.order}i4").tobytes())

    def reals(self, values: np.ndarray) -> None:
        """Go on with numbers."""
        self.parts.append(values.astype(self.real).tobytes())

    def end(self, columns: int) -> None:
        """The column beyond the last."""
        self.column(columns + 1, 1, self.real.itemsize // 4)
        self.reals(np.ones(1))
        self._close()

    def content(self) -> bytes:
        """The file."""
        return b"".join(self.records)

    def _close(self) -> None:
        body = b"".join(self.parts)
        marker = struct.pack(self.order + "i", len(body))
        self.records.append(marker + body + marker)
        self.parts = []


class TextTarget:
    """Lines with 17 digits of a number, or 9 of one in single precision."""

    def __init__(self, single: bool) -> None:
        self.digits, self.per, self.width = (8, 5, 16) if single else (16, 3, 24)
        self.single = single
        self.lines: list[str] = []

    def head(self, head: MatrixHeader) -> None:
        """Begin a matrix."""
        rows = -head.rows if head.big else head.rows
        form = f"1P,{self.per}E{self.width}.{self.digits}"
        self.lines.append(f"{head.columns:8d}{rows:8d}{head.form:8d}{head.kind:8d}{head.name:8s}{form}")

    def column(self, column: int, row: int, words: int) -> None:
        """Begin a column."""
        self.integers([column, row, words])

    def integers(self, values: Sequence[int]) -> None:
        """A line of integers."""
        self.lines.append("".join(f"{value:8d}" for value in values))

    def reals(self, values: np.ndarray) -> None:
        """Lines of numbers."""
        values = values.astype("f4") if self.single else values
        fields = [f"{float(v):{self.width}.{self.digits}E}" for v in values]
        self.lines += ["".join(fields[i : i + self.per]) for i in range(0, len(fields), self.per)]

    def end(self, columns: int) -> None:
        """The column beyond the last."""
        self.column(columns + 1, 1, 1)
        self.reals(np.ones(1))

    def content(self) -> bytes:
        """The file."""
        return "\n".join([*self.lines, ""]).encode("ascii")


Target = BinaryTarget | TextTarget


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
    Path(path).write_bytes(target.content())


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
    target.head(
        MatrixHeader(columns=columns, rows=rows, big=big, form=matrix.form, kind=kind, name=matrix.name)
    )
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
