"""Stability and rms of many loops at once, for stacks of matrices."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.systems.stability import all_decay

TRUSTED = 1e-8
"""Relative residual up to which a covariance from eigenvectors is used; otherwise by a Schur form."""
DOUBLINGS = 60


def continuous_covariances(
    A: Float[np.ndarray, "loop state state"], B: Float[np.ndarray, "loop state w"]
) -> tuple[Complex[np.ndarray, "loop state"], Float[np.ndarray, "loop state state"]]:
    """Poles, and the X of A X + X A' + B B' = 0.

    X is ``inf`` where a pole does not decay, as `all_decay` decides: the side of the axis on which a root at
    zero lies is rounding.
    """
    values, vectors = np.linalg.eig(A)
    values = values.astype(complex)
    Q = B @ np.swapaxes(B, 1, 2)
    X = np.full(A.shape, np.inf)
    stable = np.array([all_decay(v) for v in values], dtype=bool)
    if not A.shape[1] or not stable.any():
        return values, X
    X[stable] = _from_eigenvectors(values[stable], vectors[stable].astype(complex), Q[stable])
    size = np.linalg.norm(X, axis=(1, 2)) * np.linalg.norm(A, axis=(1, 2)) + np.linalg.norm(Q, axis=(1, 2))
    for i in np.flatnonzero(stable):
        defect = A[i] @ X[i]
        if not np.linalg.norm(defect + defect.T + Q[i]) <= TRUSTED * size[i]:
            X[i] = np.asarray(sla.solve_continuous_lyapunov(A[i], -Q[i]))
    return values, X


def _from_eigenvectors(values: np.ndarray, vectors: np.ndarray, Q: np.ndarray) -> np.ndarray:
    left = _solve_each(vectors, Q.astype(complex))
    inner = np.swapaxes(_solve_each(vectors, np.conj(np.swapaxes(left, 1, 2))), 1, 2).conj()
    inner = inner / -(values[:, :, None] + values.conj()[:, None, :])
    return (vectors @ inner @ np.conj(np.swapaxes(vectors, 1, 2))).real


def _solve_each(M: np.ndarray, right: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.solve(M, right)
    except np.linalg.LinAlgError:
        # A defective loop has no basis of eigenvectors: the residual then refuses the result.
        return np.asarray([np.linalg.pinv(one) @ r for one, r in zip(M, right, strict=True)])


def sampled_covariances(
    A: Float[np.ndarray, "loop state state"], Q: Float[np.ndarray, "loop state state"]
) -> tuple[Complex[np.ndarray, "loop state"], Float[np.ndarray, "loop state state"]]:
    """Poles, and the X of X = A X A' + Q by doubling (Smith 1968; ``inf`` where unstable)."""
    values = np.linalg.eigvals(A).astype(complex)
    X = np.full(A.shape, np.inf)
    stable = np.abs(values).max(axis=1, initial=0.0) < 1.0
    power, total = A[stable], Q[stable]
    for _ in range(DOUBLINGS if stable.any() else 0):
        more = power @ total @ np.swapaxes(power, 1, 2)
        total = total + more
        power = power @ power
        if np.linalg.norm(more) <= 1e-15 * np.linalg.norm(total):
            break
    X[stable] = total
    return values, X


def row_rms(
    rows: Float[np.ndarray, "loop row state"], X: Float[np.ndarray, "loop state state"]
) -> Float[np.ndarray, "loop row"]:
    """Root mean square of each row of states; ``inf`` where the covariance is."""
    finite = np.isfinite(X).all(axis=(1, 2))
    found = np.full(rows.shape[:2], np.inf)
    square = np.einsum("prs,pst,prt->pr", rows[finite], X[finite], rows[finite])
    found[finite] = np.sqrt(np.maximum(square, 0.0))
    return found
