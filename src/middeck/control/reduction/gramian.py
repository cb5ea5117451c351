"""Gramians as Cholesky factors, since products lose half the digits.

Hammarling (1982, IMA J. Numer. Anal. 2, "Numerical solution of the stable, non-negative definite Lyapunov
equation"), in complex Schur form and with as many rows of the right-hand side as the system has ports
(as Sorensen and Zhou 2003, J. Applied Mathematics, write it): n substitutions of n^2.
"""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record
class GramianFactors:
    """Lower factors: reach @ reach.T is the controllability, see @ see.T the observability Gramian.

    ``reach`` solves A P + P A' + B B' = 0, ``see`` solves A'Q + Q A + C'C = 0.
    """

    reach: Float[np.ndarray, "state state"]
    see: Float[np.ndarray, "state state"]


def factor_gramians(system: StateSpace) -> GramianFactors:
    """Both factors of a stable system.

    >>> lag = StateSpace([[-2.0]], [[6.0]], [[4.0]], [[0.0]])
    >>> factors = factor_gramians(lag)
    >>> abs(factors.reach[0, 0]).item(), abs(factors.see[0, 0]).item()
    (3.0, 2.0)
    """
    n = len(system.A)
    if not n:
        return GramianFactors(np.zeros((0, 0)), np.zeros((0, 0)))
    A, unit = balance(system.A)
    S, Q = cast("tuple[np.ndarray, np.ndarray]", sla.schur(A, output="complex"))
    see = _solve_triangular(S, system.C * unit @ Q) @ Q.conj().T
    # The dual equation, upper triangular again once rows and columns are counted backwards.
    B = (Q.conj().T @ (system.B / unit[:, None]))[::-1]
    reach = _solve_triangular(S.conj().T[::-1, ::-1], B.conj().T)[:, ::-1] @ Q.conj().T
    return GramianFactors(unit[:, None] * _real_factor(reach), _real_factor(see) / unit[:, None])


def _solve_triangular(S: np.ndarray, right: np.ndarray) -> Complex[np.ndarray, "state state"]:
    """Upper triangular U with S^H U^H U + U^H U S + R^H R = 0 for R = ``right``, row by row."""
    n = len(S)
    U = np.zeros((n, n), dtype=complex)
    rows = _triangle(right) if len(right) > n else right.copy()
    for k in range(n):
        _reflect(rows)
        s, r, w = S[k, k], rows[0, 0], rows[0, 1:]
        rate = np.sqrt(-2.0 * s.real)
        U[k, k] = abs(r) / rate
        share = r / U[k, k] if U[k, k] != 0.0 else rate
        if k + 1 < n:
            known = -np.conj(share) * w - U[k, k] * S[k, k + 1 :]
            below = S[k + 1 :, k + 1 :] + np.conj(s) * np.eye(n - k - 1)
            U[k, k + 1 :] = sla.solve_triangular(below.T, known, lower=True, check_finite=False)
        rows = rows[:, 1:]
        rows[0] = w - share * U[k, k + 1 :]
    return U


def _reflect(rows: np.ndarray) -> None:
    """Turn the first column into its first entry, in place (Householder)."""
    x = rows[:, 0].copy()
    length = np.linalg.norm(x[1:])
    if length == 0.0:
        return
    phase = x[0] / abs(x[0]) if x[0] != 0.0 else 1.0
    x[0] += phase * np.linalg.norm(rows[:, 0])
    x /= np.linalg.norm(x)
    rows -= 2.0 * np.outer(x, x.conj() @ rows)
    rows[1:, 0] = 0.0


def _real_factor(F: np.ndarray) -> Float[np.ndarray, "state state"]:
    """Real L with L L' = F^H F, which is known to be real."""
    return _triangle(np.vstack([np.real(F), np.imag(F)])).T


def restrict(factor: Float[np.ndarray, "state column"], which: slice) -> Float[np.ndarray, "part part"]:
    """The factor of a Gramian's diagonal block."""
    return _triangle(factor[which].T).T


def _triangle(rows: np.ndarray) -> np.ndarray:
    return cast("np.ndarray", np.linalg.qr(rows, mode="r"))
