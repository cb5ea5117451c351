"""State units (exact powers of two) in which a Riccati equation is solved."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float


def unit_scales(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, " state"]:
    """Powers of two t: x = t * x_balanced evens out the Hamiltonian and keeps it Hamiltonian.

    Benner 2001 (SIAM J. Sci. Comput. 22, "Symplectic balancing of Hamiltonian matrices").
    """
    n = len(A)
    H = np.abs(np.block([[A, G], [Q, A.T]]))
    np.fill_diagonal(H, 0.0)
    _, (scale, _) = sla.matrix_balance(H, separate=True, permute=False)
    log = np.log2(scale)
    return np.exp2(np.round((log[:n] - log[n:]) / 2.0))


def unit_diagonal(X: Float[np.ndarray, "state state"]) -> Float[np.ndarray, " state"]:
    """Powers of two that give X about a unit diagonal, so that small entries keep their relative accuracy."""
    diagonal = np.diag(X)
    return np.exp2(-np.round(np.log2(np.where(diagonal > 0.0, diagonal, 1.0)) / 2.0))
