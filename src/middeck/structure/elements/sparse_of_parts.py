"""Sparse matrices of parts that fit by construction."""

from __future__ import annotations

import copy
import functools

import numpy as np
import scipy.sparse as sp


def csr_of(
    values: np.ndarray, indices: np.ndarray, indptr: np.ndarray, shape: tuple[int, int]
) -> sp.csr_array:
    """The matrix with these parts, which it keeps unchecked: a tenth of the cost of `scipy.sparse.csr_array`.

    The constructor looks at every part; a matrix of a hundred coordinates is sooner factored.

    >>> csr_of(np.ones(2), np.array([1, 0]), np.array([0, 1, 2]), (2, 2)).toarray().tolist()
    [[0.0, 1.0], [1.0, 0.0]]
    """
    out = copy.copy(_empty(shape))
    out.data, out.indices, out.indptr = values, indices, indptr
    return out


def identity(size: int) -> sp.csr_array:
    """The identity, without the checks of `scipy.sparse.eye_array`.

    >>> identity(2).toarray().tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    return turned_blocks(np.ones((1, 1)), 0, size)


def turned_blocks(R: np.ndarray, blocks: int, further: int) -> sp.csr_array:
    """Block diagonal: ``R`` so many times, then ones.

    >>> turned_blocks(np.array([[0.0, 1.0], [1.0, 0.0]]), 1, 1).toarray().tolist()
    [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    n = len(R)
    turned, size = n * blocks, n * blocks + further
    columns = np.arange(turned).reshape(blocks, 1, n) + np.zeros((n, 1), int)
    rest = np.arange(further + 1)
    return csr_of(
        np.concatenate([np.tile(R.ravel(), blocks), np.ones(further)]),
        np.concatenate([columns.ravel(), turned + rest[:-1]]).astype(np.int32),
        np.concatenate([n * np.arange(turned), n * turned + rest]).astype(np.int32),
        (size, size),
    )


@functools.lru_cache(maxsize=32)
def _empty(shape: tuple[int, int]) -> sp.csr_array:
    return sp.csr_array(shape)


def transposed_product(A: sp.csr_array, x: np.ndarray) -> np.ndarray:
    """A' x of one vector, without forming A'.

    >>> transposed_product(sp.csr_array([[1.0, 2.0], [0.0, 3.0]]), np.array([1.0, 10.0]))
    array([ 1., 32.])
    """
    product = A.data * np.repeat(x, np.diff(A.indptr))
    columns = A.shape[1]
    if np.iscomplexobj(product):
        real, imaginary = (np.bincount(A.indices, part, columns) for part in (product.real, product.imag))
        return real + 1j * imaginary
    return np.bincount(A.indices, product, columns)
