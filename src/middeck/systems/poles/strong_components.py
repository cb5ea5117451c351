"""Strongly connected components of a matrix: states that act on each other, in block triangular order.

A cascade (a chain of actuator and plant) is block triangular after a permutation of its states. Its poles are
those of the blocks; computed block by block, rounding moves them by the size and multiplicity of a block
instead of the whole matrix (Duff, Erisman and Reid 1986, "Direct Methods for Sparse Matrices", chapter 6).
"""

from __future__ import annotations

import graphlib
import itertools
from typing import cast

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from jaxtyping import Bool, Complex, Float

FEW = 64
"""States up to which one component is found by steps from its first state: in a tenth of a graph's time."""


def strong_components(A: Float[np.ndarray, "state state"]) -> list[np.ndarray]:
    """The states of each component, in the order that makes ``A`` block upper triangular.

    >>> [part.tolist() for part in strong_components(np.array([[1.0, 0.0], [5.0, 2.0]]))]
    [[1], [0]]
    """
    if 0 < len(A) <= FEW and _are_all_reached(A != 0.0) and _are_all_reached(A.T != 0.0):
        return [np.arange(len(A))]
    row, column = np.nonzero(A)
    first = np.searchsorted(row, np.arange(len(A) + 1)).astype(np.int32)
    # A dense graph would be looked through by masked arrays, which takes three times as long.
    graph = sp.csr_array((np.ones(len(row)), column.astype(np.int32), first), shape=A.shape)
    count, label = cast("tuple[int, np.ndarray]", csgraph.connected_components(graph, connection="strong"))
    if count == 1:
        return [np.arange(len(A))]
    states, ends = np.argsort(label, kind="stable"), np.cumsum(np.bincount(label)).tolist()
    parts = [states[start:end] for start, end in itertools.pairwise([0, *ends])]
    row, column = label[row], label[column]
    across = row != column
    readers: dict[int, set[int]] = {part: set() for part in range(count)}
    for one, other in zip(row[across].tolist(), column[across].tolist(), strict=True):
        readers[other].add(one)
    return [parts[part] for part in graphlib.TopologicalSorter(readers).static_order()]


def _are_all_reached(acts: Bool[np.ndarray, "state state"]) -> bool:
    """Whether the first state acts on all, itself included, or by the transpose all act on it."""
    reached, count = acts[0], 0
    while (now := int(np.count_nonzero(reached))) > count:
        reached, count = reached | (reached @ acts), now
    return count == len(acts)


def component_poles(A: Float[np.ndarray, "state state"]) -> Complex[np.ndarray, " state"]:
    """Eigenvalues, computed component by component."""
    parts = [np.linalg.eigvals(A[np.ix_(part, part)]) for part in strong_components(A)]
    return np.concatenate(parts).astype(complex) if parts else np.zeros(0, dtype=complex)


def component_schur(
    A: Float[np.ndarray, "state state"],
) -> tuple[Complex[np.ndarray, "state state"], Complex[np.ndarray, "state state"]]:
    """T upper triangular and Q unitary with A = Q T Q^H, diagonal of T by components."""
    n, at = len(A), 0
    Q, T = np.zeros((n, n), dtype=complex), np.zeros((n, n), dtype=complex)
    for part in strong_components(A):
        here = slice(at, at + len(part))
        T[here, here], Q[part, here] = cast(
            "tuple[np.ndarray, np.ndarray]", sla.schur(A[np.ix_(part, part)], output="complex")
        )
        T[:at, here] = Q[:, :at].conj().T @ A @ Q[:, here]
        at += len(part)
    return T, Q
