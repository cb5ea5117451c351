"""Lyapunov equations, continuous and discrete."""

from __future__ import annotations

import functools
from typing import Any, cast

import numpy as np
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
    T, U = real_schur(A)
    X = U @ solve_triangular(T, U.T @ Q @ U, transposed=True) @ U.T
    return (X + X.T) / 2.0


def real_schur(
    A: Float[np.ndarray, "state state"],
) -> tuple[Float[np.ndarray, "state state"], Float[np.ndarray, "state state"]]:
    """T and U of A = U T U', T quasi upper triangular: `scipy.linalg.schur` of finite numbers, less its
    searches, which take as long as the form of few states. Raises `LinAlgError` where there is none, and
    `TypeError` for a complex matrix.

    >>> real_schur(np.array([[2.0, 1.0], [0.0, 3.0]]))[0].tolist()
    [[2.0, 1.0], [0.0, 3.0]]
    """
    if np.iscomplexobj(A):
        raise TypeError("a complex matrix has no real Schur form")
    if not len(A):
        return A, A
    T, *_, U, _, info = cast("Any", lapack).dgees(_no_order, A, lwork=_schur_room(len(A)), sort_t=0)
    if info:
        raise np.linalg.LinAlgError("Schur form not found")
    return T, U


def _no_order(real: float, imag: float) -> bool:
    """What LAPACK would ask about poles that are to be sorted."""
    return False


@functools.lru_cache(maxsize=256)
def _schur_room(states: int) -> int:
    """Numbers of LAPACK's workspace."""
    return int(cast("Any", lapack).dgees(_no_order, np.eye(states), lwork=-1)[-2][0])


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
    power, U = real_schur(A)
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
