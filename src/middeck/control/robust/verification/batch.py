"""Loops in stacks: groups of one shape, rows of their covariances, and the warning of undecided ones."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

NAMED = 8


def same_shapes(shapes: Sequence[tuple[int, ...]]) -> list[list[int]]:
    """Groups of indices of equal shapes, which can be stacked."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, shape in enumerate(shapes):
        groups.setdefault(shape, []).append(i)
    return list(groups.values())


def warn_of_lost(lost: Sequence[int], count: int) -> None:
    """Warn of the plants, by their positions among ``count``, whose stability is undecided."""
    if lost:
        warnings.warn(
            f"stability is undecided, and counts as lost, of {len(lost)} of {count} plants, at positions "
            f"{', '.join(map(str, lost[:NAMED]))} from 0: decide_stability of one says why",
            stacklevel=3,
        )


def row_rms(
    rows: Float[np.ndarray, "loop row state"], X: Float[np.ndarray, "loop state state"]
) -> Float[np.ndarray, "loop row"]:
    """Root mean square of each row of states; ``inf`` where the covariance is."""
    finite = np.isfinite(X).all(axis=(1, 2))
    found = np.full(rows.shape[:2], np.inf)
    square = np.einsum("prs,pst,prt->pr", rows[finite], X[finite], rows[finite])
    found[finite] = np.sqrt(np.maximum(square, 0.0))
    return found
