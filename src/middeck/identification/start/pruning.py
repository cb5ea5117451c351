"""Which of too many modes to keep: the one that is missed least is dropped, until so many states are left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int


def prune(
    A: Float[np.ndarray, "number column"],
    y: Float[np.ndarray, "number target"],
    blocks: Sequence[Sequence[int] | Int[np.ndarray, " own"]],
    states: Sequence[int],
    wanted: int,
) -> list[int] | None:
    """Backward elimination, exact for least squares of ``y`` on the columns of ``A``.

    blocks, states: The columns of each mode and the states it counts for. Columns of no mode are always kept.
    wanted: States to keep; None is returned where the modes do not add up to that.
    """
    size = np.linalg.norm(A, axis=0)
    scaled = A / np.where(size > 0.0, size, 1.0)
    gram, right = scaled.T @ scaled, scaled.T @ y
    of_modes = {int(c) for block in blocks for c in block}
    free = [c for c in range(A.shape[1]) if c not in of_modes]
    kept = list(range(len(blocks)))
    while (left := sum(states[m] for m in kept) - wanted) > 0:
        missed = _missed(gram, right, [blocks[m] for m in kept], free)
        # By the state: a real pole is half a pair.
        each = [
            miss / states[m] if states[m] <= left else np.inf for m, miss in zip(kept, missed, strict=True)
        ]
        if not each or not np.isfinite(min(each)):
            return None
        kept.pop(int(np.argmin(each)))
    return kept if left == 0 else None


def _missed(
    gram: np.ndarray,
    right: np.ndarray,
    blocks: Sequence[Sequence[int] | Int[np.ndarray, " own"]],
    free: Sequence[int],
) -> Float[np.ndarray, " block"]:
    """By how much the squares rise without each block, the others solved for again."""
    columns = [int(c) for block in blocks for c in block] + list(free)
    inverse = np.linalg.pinv(gram[np.ix_(columns, columns)], hermitian=True)
    x = inverse @ right[columns]
    sizes = np.array([len(block) for block in blocks])
    first = np.cumsum(sizes) - sizes
    missed = np.zeros(len(blocks))
    # All blocks of one size at once.
    for size in set(sizes.tolist()):
        own = first[sizes == size, None] + np.arange(size)
        among = np.linalg.pinv(inverse[own[:, :, None], own[:, None]], hermitian=True)
        missed[sizes == size] = np.sum(x[own] * (among @ x[own]), axis=(1, 2))
    return missed
