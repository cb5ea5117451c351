"""The continuous algebraic Riccati equation, over many decades of intensity.

Balanced Hamiltonian, ordered real Schur form (Laub 1979, IEEE TAC 24), one Newton step (Kleinman 1968,
IEEE TAC 13), SciPy's generalised Schur method where that is better. The balancing is symplectic (Benner
2001, "Symplectic balancing of Hamiltonian matrices", SIAM J. Sci. Comput. 22).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.control.stabilisability import require_reachable
from middeck.errors import ConfigError, NumericalError
from middeck.values import record

GOOD = 1e-11
"""Relative residual above which the second method is tried; a few hundred states leave 1e-14 to 1e-12."""
WORTHLESS = 1e-6
"""Relative residual above which there is no solution to return."""


@record
class RiccatiSolution:
    """The stabilising solution of A'X + XA - (XB + S) R^-1 (XB + S)' + Q = 0.

    Parameters
    ----------
    X:
        Symmetric solution.
    gain:
        K = R^-1 (XB + S)'; the regulator is u = -K x.
    poles:
        Eigenvalues of A - BK [rad/s].
    residual:
        Frobenius norm of the left-hand side over the sum of its terms' norms, in balanced coordinates,
        where small and large intensities weigh alike.
    """

    X: Float[np.ndarray, "state state"]
    gain: Float[np.ndarray, "input state"]
    poles: Complex[np.ndarray, " state"]
    residual: float


def solve_riccati(
    A: Float[np.ndarray, "state state"],
    B: Float[np.ndarray, "state input"],
    Q: Float[np.ndarray, "state state"],
    R: Float[np.ndarray, "input input"],
    S: Float[np.ndarray, "state input"] | None = None,
    *,
    names: Sequence[str] = (),
) -> RiccatiSolution:
    """Solve A'X + XA - (XB + S) R^-1 (XB + S)' + Q = 0 for the stabilising X.

    ``names`` (one per state) is used in errors. Raises `NotStabilisableError` naming the modes that B does
    not reach (real part >= 0) or Q does not see (real part = 0), `ConfigError` for R that is not positive
    definite, `NumericalError` if no method gives a stabilising solution.

    >>> solve_riccati(np.eye(1), np.eye(1), 3.0 * np.eye(1), np.eye(1)).X     # 2x - x^2 + 3 = 0
    array([[3.]])
    """
    A, B, Q, R = (np.asarray(M, dtype=float) for M in (A, B, Q, R))
    S = np.zeros_like(B) if S is None else np.asarray(S, dtype=float)
    try:
        factor = sla.cholesky(R, lower=True)
    except sla.LinAlgError as error:
        raise ConfigError("the control weight (or sensor noise) R is not positive definite") from error
    Bn = sla.solve_triangular(factor, B.T, lower=True).T
    Sn = sla.solve_triangular(factor, S.T, lower=True).T
    Abar, Qbar = A - Bn @ Sn.T, Q - Sn @ Sn.T
    require_reachable(Abar, B, names)
    require_reachable(Abar.T, Qbar, names, only_axis=True, complaint="the cost (or process noise) misses it")
    X, residual = _solve_balanced(Abar, Bn @ Bn.T, Qbar)
    gain = sla.cho_solve((factor, True), (X @ B + S).T)
    poles = np.linalg.eigvals(A - B @ gain).astype(complex)
    if not np.isfinite(residual) or residual > WORTHLESS or poles.real.max(initial=-1.0) >= 0.0:
        raise NumericalError(
            f"no stabilising Riccati solution: relative residual {residual:.1e}, largest real part "
            f"{poles.real.max(initial=-np.inf):.1e} rad/s",
            hint="bring the weights or intensities closer together",
            residual=residual,
            poles=poles,
        )
    return RiccatiSolution(X, gain, poles, residual)


def _solve_balanced(
    A: np.ndarray, G: np.ndarray, Q: np.ndarray
) -> tuple[Float[np.ndarray, "state state"], float]:
    """Solution and residual of A'X + XA - XGX + Q = 0, G = B R^-1 B'."""
    t = _balancing(A, G, Q)
    scaled = A * t / t[:, None], G / np.outer(t, t), Q * np.outer(t, t)
    candidates = _refined(_solve_schur(*scaled), *scaled)
    if not candidates or min(c[1] for c in candidates) > GOOD:
        candidates += _refined(_solve_pencil(*scaled), *scaled)
    if not candidates:
        return np.zeros_like(A), np.inf
    X, residual = min(candidates, key=lambda c: c[1])
    return X / np.outer(t, t), residual


def _balancing(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, " state"]:
    """Powers of two t: x = t * x_balanced evens out the Hamiltonian and keeps it Hamiltonian."""
    n = len(A)
    H = np.abs(np.block([[A, G], [Q, A.T]]))
    np.fill_diagonal(H, 0.0)
    _, (scale, _) = sla.matrix_balance(H, separate=True, permute=False)
    log = np.log2(scale)
    return np.exp2(np.round((log[:n] - log[n:]) / 2.0))


def _solve_schur(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    n = len(A)
    try:
        _, U, stable = sla.schur(np.block([[A, -G], [-Q, -A.T]]), sort="lhp")
        if stable != n:
            return None
        X = sla.solve(U[:n, :n].T, U[n:, :n].T)
    except (sla.LinAlgError, sla.LinAlgWarning):
        return None
    return (X + X.T) / 2.0


def _solve_pencil(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    values, vectors = np.linalg.eigh(G)
    B = vectors * np.sqrt(np.maximum(values, 0.0))
    try:
        return np.asarray(sla.solve_continuous_are(A, B, Q, np.eye(len(A))))
    except (sla.LinAlgError, ValueError):
        return None


def _refined(
    X: Float[np.ndarray, "state state"] | None, A: np.ndarray, G: np.ndarray, Q: np.ndarray
) -> list[tuple[Float[np.ndarray, "state state"], float]]:
    """The solution before and after one Newton step (Kleinman 1968), each with its residual."""
    if X is None or not np.isfinite(X).all():
        return []
    step = sla.solve_continuous_lyapunov((A - G @ X).T, -(Q + X @ G @ X))
    return [(Y, _residual(Y, A, G, Q)) for Y in (X, (step + step.T) / 2.0)]


def _residual(X: np.ndarray, A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> float:
    linear, quadratic = A.T @ X, X @ G @ X
    left = np.linalg.norm(linear + linear.T - quadratic + Q)
    terms = 2.0 * np.linalg.norm(linear) + np.linalg.norm(quadratic) + np.linalg.norm(Q)
    return float(left / terms) if terms > 0.0 else 0.0
