"""Chains of integrators in a matrix, by rank decisions rather than by eigenvalues.

A pole at the origin of multiplicity k is spread by rounding over a circle of radius eps^(1/k) |A|, on both
sides of the axis: nothing may be decided by such eigenvalues. Its invariant subspace is well determined, and
is found here by orthogonal transformations with rank decisions on singular values (Golub and Wilkinson 1976,
SIAM Review 18, "Ill-conditioned eigensystems and the computation of the Jordan canonical form").
"""

from typing import cast

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph

REST, NONE, NONE_SAMPLED = 1e-11, 4e-15, 3e-14
"""Singular values below the first fraction of A (balanced) count as zero, rounding of a plant transformed by
a matrix of condition 1e4, but none if all exceed the second: the least of a plant with integrators is below
2e-16 (1 of 1000 draws to 2e-15); of A - 1 of a sampled one, whose 1 is rounded too, at 10 kHz below 3e-14.
Beside integrators, slow poles of mixed states count as such too."""


def integrating_chains(
    A: np.ndarray, share: float = REST, least: float = NONE
) -> tuple[np.ndarray, list[int]]:
    """Orthogonal matrix that puts the integrators first (null space of A, then of A^2, ...), and their
    numbers.

    In these coordinates the first columns of A are strictly upper triangular. States that no entry of A joins
    are judged apart: beside a fast actuator the link of a free body would pass for rounding.
    """
    chains: list[np.ndarray] = []
    moving: list[np.ndarray] = []
    for own in parts_apart(A):
        turn, sizes = _joined_chains(A[np.ix_(own, own)], share, least)
        whole = np.zeros((len(A), len(own)))
        whole[own] = turn
        *levels, rest = np.split(whole, np.cumsum(sizes, dtype=int), axis=1)
        for k, level in enumerate(levels):
            chains[k:] = [np.hstack([chains[k], level]), *chains[k + 1 :]] if k < len(chains) else [level]
        moving.append(rest)
    return np.hstack([*chains, *moving]) if len(A) else np.eye(0), [level.shape[1] for level in chains]


def parts_apart(A: np.ndarray) -> list[np.ndarray]:
    """Groups of states that no entry of ``A`` connects.

    >>> [part.tolist() for part in parts_apart(np.array([[0.0, 0.0, 1.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]))]
    [[0, 2], [1]]
    """
    found = csgraph.connected_components(sp.csr_array(A), connection="weak")
    count, label = cast("tuple[int, np.ndarray]", found)
    return [np.flatnonzero(label == k) for k in range(count)]


def _joined_chains(A: np.ndarray, share: float, least: float) -> tuple[np.ndarray, list[int]]:
    turn, sizes, left = np.eye(len(A)), [], A
    size = np.linalg.norm(A, 2)
    while len(left):
        _, value, right = np.linalg.svd(left)
        if value[-1] > (share if sizes else least) * size:
            break
        count = int(np.sum(value <= share * size))
        own = np.vstack([right[len(left) - count :], right[: len(left) - count]]).T
        done = sum(sizes)
        turn[:, done:] = turn[:, done:] @ own
        left = (own.T @ left @ own)[count:, count:]
        sizes.append(count)
    return turn, sizes


def strictly_upper(A: np.ndarray, sizes: list[int]) -> np.ndarray:
    """A with exact zeros on and below its diagonal blocks."""
    label = np.repeat(np.arange(len(sizes)), sizes)
    return np.where(label[:, None] < label[None], A, 0.0)
