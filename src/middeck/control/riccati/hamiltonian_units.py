"""Riccati equations in state units that are exact powers of two, and Newton steps to their solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.systems.state_space.balancing import balance


def unit_scales(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, " state"]:
    """Powers of two t: x = t * x_balanced evens out the Hamiltonian and keeps it Hamiltonian.

    Benner 2001 (SIAM J. Sci. Comput. 22, "Symplectic balancing of Hamiltonian matrices").
    """
    n = len(A)
    H = np.abs(np.block([[A, G], [Q, A.T]]))
    np.fill_diagonal(H, 0.0)
    log = np.log2(balance(H)[1])
    return np.exp2(np.round((log[:n] - log[n:]) / 2.0))


def unit_diagonal(X: Float[np.ndarray, "state state"]) -> Float[np.ndarray, " state"]:
    """Powers of two that give X about a unit diagonal, so that small entries keep their relative accuracy."""
    diagonal = np.diag(X)
    return np.exp2(-np.round(np.log2(np.where(diagonal > 0.0, diagonal, 1.0)) / 2.0))


def refine(
    X: Float[np.ndarray, "state state"],
    residual: Callable[[np.ndarray], tuple[np.ndarray, float]],
    step: Callable[[np.ndarray, np.ndarray], np.ndarray | None],
    least: float = 0.0,
) -> Float[np.ndarray, "state state"]:
    """Newton steps as long as each halves the size of the ``residual`` and that is above ``least``."""
    best, (defect, size) = X, residual(X)
    halved = size > 0.0
    while halved:
        change = step(best, defect)
        if change is None:
            return best
        candidate = best + change
        defect, now = residual(candidate)
        halved = least < now < size / 2.0
        best, size = (candidate, now) if now < size else (best, size)
    return best


def fold_weights(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray | None
) -> tuple[np.ndarray, ...]:
    """S (zeros for None), R's Cholesky factor L, A - B R^-1 S', B L^-T and Q - S R^-1 S'.

    Raises `ConfigError` for R that is not positive definite.
    """
    cross = np.zeros(np.shape(B)) if S is None else np.asarray(S, dtype=float)
    try:
        factor = sla.cholesky(R, lower=True)
    except sla.LinAlgError as error:
        raise ConfigError(
            "the control weight (or sensor noise) R is not positive definite",
            hint="a positive weight on every input; of a filter, some noise on every measurement",
        ) from error
    Bn = sla.solve_triangular(factor, B.T, lower=True).T
    Sn = sla.solve_triangular(factor, cross.T, lower=True).T
    return cross, factor, A - Bn @ Sn.T, Bn, Q - Sn @ Sn.T
