"""Products of a matrix with a vector, summed in one order on every machine: that of ``ticks.c``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray


def column_sums(matrix: Array) -> Callable[[Array | float, Array, Array], None]:
    """A call that sets its last argument to its first plus ``matrix`` times its second, column by column.

    BLAS, as `blas_sums`, is faster, and has another order for each processor.

    >>> out = np.empty(1)
    >>> column_sums(np.array([[1.0, 1.0, 1.0]]))(1e16, np.array([1.0, 1.0, -1e16]), out)
    >>> out
    array([0.])
    """
    columns = np.ascontiguousarray(matrix.T)
    terms = np.empty((len(columns) + 1, columns.shape[1]))
    products, alone = terms[1:], columns.shape[1] == 1

    def add(start: Array | float, vector: Array, out: Array) -> None:
        terms[0] = start
        np.multiply(columns, vector[:, None], products)
        if alone:  # a sum along memory would be by pairs
            out[:] = np.add.accumulate(terms)[-1]
        else:
            np.add.reduce(terms, axis=0, out=out)

    return add


def blas_sums(matrix: Array) -> Callable[[Array | float, Array, Array], None]:
    """`column_sums` in the order of BLAS."""
    dot, made = np.ascontiguousarray(matrix).dot, np.empty(len(matrix))

    def add(start: Array | float, vector: Array, out: Array) -> None:
        dot(vector, made)
        np.add(made, start, out)

    return add
