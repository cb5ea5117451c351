"""A plain matrix as a record: one column a channel, one row a sample, named by the user."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from middeck.errors import DataError
from middeck.files.records.raw import Head, Raw


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
    heads = tuple(Head("", None, "") for _ in range(columns))
    return Raw(sample_hz=None, heads=heads, x=tuple(x[None, None].astype(float) for x in matrix.T))
