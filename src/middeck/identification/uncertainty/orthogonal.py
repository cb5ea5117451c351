"""Information by its orthogonal factor: J = Q F, so that A = J^T J = F^T F is never formed.

The condition of A is the square of that of J: in double precision A says nothing of a direction whose
deviation is 1e8 times what each of its unknowns would have alone, while F is good to 1e13 (Golub and Van Loan
2013, section 5.3.8). Columns are scaled to length one first: they differ by units only.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Float

# Length of a column without any effect: the deviation of its unknown is beyond all bounds, its square still a
# number.
NO_INFORMATION = 1e-30
# Singular value of the scaled derivatives, over the largest, that is zero to rounding.
LOOSE = 1e-13


def factor_of(blocks: Iterable[Float[np.ndarray, "row unknown"]]) -> Float[np.ndarray, "row unknown"]:
    """F with F^T F the sum of B^T B over all blocks B, some rows at a time."""
    found = np.zeros((0, 0))
    for rows in blocks:
        found = triangle(np.vstack([found, rows]) if len(found) else rows)
    return found


def triangle(rows: Float[np.ndarray, "row unknown"]) -> Float[np.ndarray, "few unknown"]:
    """R of rows = Q R: no more rows than columns."""
    R: Any = np.linalg.qr(rows, mode="r")
    return R


def inverse_root(
    F: Float[np.ndarray, "row unknown"], held: Float[np.ndarray, "tie unknown"] | None = None
) -> tuple[Float[np.ndarray, "unknown direction"], int]:
    """W with W W^T = (F^T F)^-1 over the unknowns that leave the ``held`` combinations unchanged, and the
    number of its last columns that are loose.

    Along those the data fix nothing that rounding could show: `LOOSE` stands for their singular values, so
    that they are as long as they must at least be.
    """
    unknowns = F.shape[1]
    scale = 1.0 / np.maximum(np.linalg.norm(F, axis=0), NO_INFORMATION)
    square = np.vstack([F, np.zeros((max(unknowns - len(F), 0), unknowns))]) * scale
    free = np.eye(unknowns) if held is None or not len(held) else scipy.linalg.null_space(held * scale)
    _, size, direction = np.linalg.svd(square @ free, full_matrices=False)
    least = LOOSE * size[0]
    W = scale[:, None] * (free @ direction.T) / np.maximum(size, least)
    return W, int(np.sum(size <= least))


def canonical_root(W: Float[np.ndarray, "unknown direction"]) -> Float[np.ndarray, "unknown direction"]:
    """The one lower triangle with the same W W^T: draws from it do not depend on rounding."""
    R = triangle(W.T)
    return (R * np.where(np.diag(R) < 0.0, -1.0, 1.0)[:, None]).T


def root_of(
    matrix: Float[np.ndarray, "unknown unknown"],
    least: Float[np.ndarray, "unknown direction"] | float = 0.0,
) -> np.ndarray:
    """A root of a matrix of moderate condition, in no direction less than ``least``.

    ``least`` is a bound of its eigenvalues, or a root of the least matrix.
    """
    if isinstance(least, np.ndarray):
        inverse = np.linalg.inv(least)
        return least @ root_of(inverse @ matrix @ inverse.T, 1.0)
    size, direction = np.linalg.eigh(matrix)
    return direction * np.sqrt(np.maximum(size, least))
