"""Riccati solutions from the stable invariant subspace of a Hamiltonian.

LAPACK orders a Schur form by swapping neighbours, which at 1000 rows costs as much as the form. Here each
half is ordered separately, and one Sylvester equation with one QR swaps the stable part of the lower half
with the unstable part of the upper (Bai and Demmel 1993, Linear Algebra Appl. 186, "On swapping diagonal
blocks in real Schur form"; blocked).
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from scipy.linalg import lapack

SMALL = 200
"""Rows up to which LAPACK's own ordering costs little."""


def solve_by_subspace(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    """X of A'X + XA - XGX + Q = 0 from the stable subspace of its Hamiltonian (Laub 1979, IEEE TAC 24).

    None where that has not half the dimension. G and Q are symmetric, of any sign.
    """
    n = len(A)
    try:
        H = np.block([[A, -G], [-Q, -A.T]])
        T, U = cast("tuple[np.ndarray, np.ndarray]", sla.schur(H, check_finite=False))
        basis = _stable_basis(T)
        if basis is None or basis.shape[1] != n:
            return None
        V = U @ basis
        X = np.linalg.solve(V[:n].T, V[n:].T)
    except np.linalg.LinAlgError:
        return None
    return (X + X.T) / 2.0


def _stable_basis(T: np.ndarray) -> Float[np.ndarray, "row stable"] | None:
    """Orthonormal basis of the stable invariant subspace of a quasi upper triangular matrix."""
    if len(T) <= SMALL:
        whole = _ordered(T)
        return None if whole is None else whole[1][:, : whole[2]]
    half = len(T) // 2
    half += int(T[half, half - 1] != 0.0)
    upper, lower = _ordered(T[:half, :half]), _ordered(T[half:, half:])
    if upper is None or lower is None:
        return None
    (T1, Z1, k1), (T2, Z2, k2) = upper, lower
    basis = np.zeros((len(T), k1 + k2))
    basis[:half, :k1] = Z1[:, :k1]
    if k1 == half or not k2:
        basis[half:, k1:] = Z2[:, :k2]
        return basis
    through = Z1[:, k1:].T @ (T[:half, half:] @ Z2[:, :k2])
    mix, scale = _solve_sylvester(T1[k1:, k1:], T2[:k2, :k2], through)
    basis[:, k1:], _ = np.linalg.qr(np.vstack([-Z1[:, k1:] @ mix, scale * Z2[:, :k2]]))
    return basis


def _ordered(T: np.ndarray) -> tuple[np.ndarray, np.ndarray, int] | None:
    """T with its stable poles first, the orthogonal matrix that does it, and how many they are.

    LAPACK standardises 2x2 blocks: both diagonal entries are the real part of the pair.
    """
    stable = (np.diag(T) < 0.0).astype(np.int32)
    ordered = cast("Any", lapack).dtrsen(stable, T, np.eye(len(T)), job="N")
    form, Z, count, info = ordered[0], ordered[1], int(ordered[4]), int(ordered[-1])
    return (form, Z, count) if info == 0 else None


def _solve_sylvester(left: np.ndarray, right: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, float]:
    """X and s <= 1 with left X - X right = s known, for quasi upper triangular matrices."""
    X, scale, _ = cast("Any", lapack).dtrsyl(left, right, known, isgn=-1)
    return X, float(scale)
