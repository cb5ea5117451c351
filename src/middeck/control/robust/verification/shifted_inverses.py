"""(A - p I)^-1 of many loops, from their shared parts: a last block, such as a compensator's, a narrow
coupling to it, and the zeros in the own block of each.

With A - p I = [[S, B K], [L C, R]], R, K and L shared, the inverse is diag(S^-1, R^-1) and a correction of
the rank of K and L (Woodbury 1950, Statistical Research Group, Princeton, Memorandum 42). S falls apart into
blocks where it is modal.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float
from scipy.sparse.csgraph import connected_components

WELL = 1e6
"""Condition of a block up to which the inverse of the whole is made from its own."""
NONE = 1e-12
"""Part of the largest singular value of a coupling that counts as zero."""


class SharedFactors(NamedTuple):
    """Shared parts of the inverses of all loops; the names are those of the module's text.

    ``blocks`` has for each size the states of every block of S, ``last`` is R^-1, ``right`` K, ``left`` L.
    """

    blocks: list[np.ndarray]
    last: np.ndarray
    right: np.ndarray
    left: np.ndarray


def find_parts(
    A: Float[np.ndarray, "loop state state"], scale: np.ndarray, pole: float
) -> SharedFactors | None:
    """The parts of the loops ``A`` in the units ``scale``; None where they share no sound last block."""
    n = A.shape[1]
    unlike = np.argwhere((A[0] != A).any(axis=0)).min(axis=1)
    first = max(int(unlike.max(initial=-1)) + 1, n // 2)
    whole = A[0] * (scale / scale[:, None])
    block = whole[first:, first:] - pole * np.eye(n - first)
    if not len(block) or not np.linalg.cond(block) < WELL:
        return None
    right, left = _rows_of(whole[:first, first:]), _rows_of(whole[first:, :first].T).T
    return SharedFactors(
        _blocks((A[:, :first, :first] != 0.0).any(axis=0)), np.linalg.inv(block), right, left
    )


def _rows_of(M: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the rows of ``M``."""
    _, size, rows = np.linalg.svd(M, full_matrices=False)
    return rows[size > NONE * size.max(initial=0.0)]


def _blocks(linked: np.ndarray) -> list[np.ndarray]:
    """States of each set that ``linked`` holds together, sets of one size in one array."""
    count, label = cast("tuple[int, np.ndarray]", connected_components(linked, directed=False))
    size = np.bincount(label, minlength=count)
    order = np.argsort(label, kind="stable")
    own = np.split(order, np.cumsum(size)[:-1])
    return [np.array([own[i] for i in np.flatnonzero(size == s)]) for s in np.unique(size)]


def invert_turned(moved: np.ndarray, parts: SharedFactors, out: np.ndarray) -> None:
    """``out`` = the transposed inverses of ``moved`` (A - p I), without a pivot across the parts."""
    count, first = len(moved), moved.shape[1] - len(parts.last)
    own, rest = slice(None, first), slice(first, None)
    B, C = moved[:, own, rest] @ parts.right.T, parts.left.T @ moved[:, rest, own]
    alone = np.zeros((count, first, first))
    for states in parts.blocks:
        at = (slice(None), states[:, :, None], states[:, None, :])
        alone[at] = _invert_blocks(moved[at])
    b, c = B.shape[2], C.shape[1]
    seen, driven = C @ alone, alone @ B
    through = C @ driven
    shared = parts.right @ parts.last @ parts.left
    fed = np.linalg.solve(np.eye(b) - shared @ through, np.broadcast_to(shared, (count, b, c)))
    middle = np.empty((count, b + c, c + b))
    middle[:, :b, :c], middle[:, :b, c:] = fed, -np.eye(b) - fed @ through
    middle[:, b:, :c], middle[:, b:, c:] = -np.eye(c) - through @ fed, through + through @ fed @ through
    columns, rows = np.zeros((count, b + c, moved.shape[1])), np.zeros((count, c + b, moved.shape[1]))
    columns[:, :b, own], columns[:, b:, rest] = driven.swapaxes(1, 2), (parts.last @ parts.left).T
    rows[:, :c, own], rows[:, c:, rest] = seen, parts.right @ parts.last
    np.matmul((middle @ rows).swapaxes(1, 2), columns, out=out)
    out[:, own, own] += alone.swapaxes(1, 2)
    out[:, rest, rest] += parts.last.T


def _invert_blocks(S: np.ndarray) -> np.ndarray:
    """Inverses; of two by two without LAPACK, which takes ten times as long for many."""
    if S.shape[-1] != 2:
        return np.linalg.inv(S)
    a, b, c, d = S[..., 0, 0], S[..., 0, 1], S[..., 1, 0], S[..., 1, 1]
    turned = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return turned / (a * d - b * c)[..., None, None]
