"""Sparse symmetric factors: solutions, and how many eigenvalues are negative (Sylvester's law of inertia)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Float


class Factor(NamedTuple):
    """K = S^-1 P L U P' S^-1 with a diagonal S that brings K's own diagonal to one.

    ``negative`` is the number of negative eigenvalues of K; -1 where rounding leaves it undecided.
    """

    lu: spla.SuperLU
    scale: Float[np.ndarray, " n"]
    negative: int

    def solve(self, b: np.ndarray) -> np.ndarray:
        """K^-1 b for one or more columns."""
        scale = self.scale if b.ndim == 1 else self.scale[:, None]
        return scale * self.lu.solve(scale * b)


def factorise(K: sp.csr_array) -> Factor | None:
    """Factor a symmetric matrix without pivoting, None if a pivot vanishes.

    Pivots stay on the diagonal, which is stable for a positive definite matrix; for an indefinite one their
    signs count its negative eigenvalues, and a solution wants its residual looked at.
    """
    diagonal = np.abs(K.diagonal())
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = np.repeat(scale, np.diff(K.indptr)) * K.data * scale[K.indices]
    try:
        lu = spla.splu(
            # Rows are columns: symmetric. A copy, for SuperLU sorts what it is given.
            sp.csc_array((scaled, K.indices.copy(), K.indptr), shape=K.shape),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True, "Equil": False},
        )
    except RuntimeError:  # SuperLU: "Factor is exactly singular"
        return None
    pivots = lu.U.diagonal()
    decided = np.array_equal(lu.perm_r, lu.perm_c) and bool(np.all(np.isfinite(pivots)))
    return Factor(lu, scale, int(np.sum(pivots < 0.0)) if decided else -1)


def positive_factor(K: sp.csr_array) -> Factor | None:
    """The factor of a positive definite matrix, None for any other."""
    factor = factorise(K)
    return factor if factor is not None and factor.negative == 0 else None


def order(K: sp.csr_array) -> int:
    """Number of rows."""
    return len(K.indptr) - 1
