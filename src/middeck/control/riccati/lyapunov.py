"""Lyapunov equations, continuous and discrete."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from scipy.linalg import lapack

SQUARINGS = 60
"""Number of doublings for a pole at 1 - 1e-16."""


def solve_lyapunov(
    A: Float[np.ndarray, "state state"], Q: Float[np.ndarray, "state state"]
) -> Float[np.ndarray, "state state"]:
    """X with A'X + XA + Q = 0 for symmetric Q, no two poles of A mirrored at the axis.

    Bartels and Stewart (1972, Comm. ACM 15).

    >>> solve_lyapunov(np.array([[-1.0]]), np.array([[6.0]]))
    array([[3.]])
    """
    T, U = cast("tuple[np.ndarray, np.ndarray]", sla.schur(A, check_finite=False))
    X = U @ solve_triangular(T, U.T @ Q @ U, transposed=True) @ U.T
    return (X + X.T) / 2.0


def solve_triangular(T: np.ndarray, Q: np.ndarray, *, transposed: bool) -> Float[np.ndarray, "state state"]:
    """T X + X T' + Q = 0, or transposed T' X + X T + Q = 0, for T quasi upper triangular."""
    sides = {"trana": "T"} if transposed else {"tranb": "T"}
    X, scale, _ = cast("Any", lapack).dtrsyl(T, T, -Q, **sides)
    return X / scale


def solve_discrete_lyapunov(
    A: Float[np.ndarray, "state state"], Q: Float[np.ndarray, "state state"]
) -> Float[np.ndarray, "state state"] | None:
    """X with A'XA - X + Q = 0 for A inside the unit circle; None where the series does not end.

    Squared Smith iteration (Smith 1968, SIAM J. Appl. Math. 16): X = sum A'^k Q A^k, doubled at each step. In
    Schur form, where powers of A decay: in mixed states they are differences of large numbers.

    >>> solve_discrete_lyapunov(np.array([[0.5]]), np.array([[3.0]]))
    array([[4.]])
    """
    power, U = cast("tuple[np.ndarray, np.ndarray]", sla.schur(A, check_finite=False))
    total = U.T @ Q @ U
    # After overflow the sum is not finite, which is checked below.
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(SQUARINGS):
            more = power.T @ total @ power
            total = total + more
            if not np.all(np.isfinite(total)):
                return None
            if np.abs(more).max(initial=0.0) <= 1e-17 * np.abs(total).max(initial=0.0):
                X = U @ total @ U.T
                return (X + X.T) / 2.0
            power = power @ power
    return None
