"""The continuous algebraic Riccati equation, over many decades of intensity.

Balanced Hamiltonian (Benner 2001, "Symplectic balancing of Hamiltonian matrices", SIAM J. Sci. Comput. 22),
ordered real Schur form (Laub 1979, IEEE TAC 24), Newton steps (Kleinman 1968, IEEE TAC 13); SciPy's
generalised Schur method where the first finds no solution.

Two habits keep the residual at rounding although X B cancels where sensors are good: X B R^-1/2 is formed
before it is squared, and Newton adds a correction driven by the residual instead of solving afresh, in
coordinates where X has a unit diagonal.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.control.riccati.balancing import unit_diagonal, unit_scales
from middeck.control.stabilisability import require_reachable
from middeck.errors import ConfigError, NumericalError
from middeck.values import record

WORTHLESS = 1e-6
"""Relative residual above which there is no solution to return; rounding leaves 1e-15 to 1e-12."""


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
        Frobenius norm of the left-hand side over the sum of its terms' norms, in the caller's coordinates.
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
    cross = np.zeros(np.shape(B)) if S is None else np.asarray(S, dtype=float)
    try:
        factor = sla.cholesky(R, lower=True)
    except sla.LinAlgError as error:
        raise ConfigError("the control weight (or sensor noise) R is not positive definite") from error
    Bn = sla.solve_triangular(factor, B.T, lower=True).T
    Sn = sla.solve_triangular(factor, cross.T, lower=True).T
    Abar, Qbar = A - Bn @ Sn.T, Q - Sn @ Sn.T
    require_reachable(Abar, B, names)
    require_reachable(Abar.T, Qbar, names, only_axis=True, complaint="the cost (or process noise) misses it")
    X = _solve_balanced(Abar, Bn, Qbar)
    residual = _residual(X, Abar, Bn, Qbar)[1]
    gain = sla.cho_solve((factor, True), (X @ B + cross).T)
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


def _solve_balanced(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"]:
    """Solve A'X + XA - (XB)(XB)' + Q = 0."""
    t = unit_scales(A, B @ B.T, Q)
    scaled = A * t / t[:, None], B / t[:, None], Q * np.outer(t, t)
    found = _solve_schur(*scaled)
    found = _solve_pencil(*scaled) if found is None else found
    if found is None:
        raise NumericalError(
            "the Riccati equation has no stabilising solution: its Hamiltonian has poles on the axis",
            hint="check that the cost (or the noise intensity) is positive semidefinite",
        )
    unit = unit_diagonal(found)
    t = t * unit
    X = _refined(found * np.outer(unit, unit), A * t / t[:, None], B / t[:, None], Q * np.outer(t, t))
    return X / np.outer(t, t)


def _solve_schur(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    n = len(A)
    try:
        H = np.block([[A, -B @ B.T], [-Q, -A.T]])
        _, U, stable = cast("tuple[np.ndarray, np.ndarray, int]", sla.schur(H, sort="lhp"))
        if stable != n:
            return None
        X = np.linalg.solve(U[:n, :n].T, U[n:, :n].T)
    except np.linalg.LinAlgError:
        return None
    return (X + X.T) / 2.0


def _solve_pencil(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    try:
        return np.asarray(sla.solve_continuous_are(A, B, Q, np.eye(B.shape[1])))
    except (np.linalg.LinAlgError, ValueError):
        return None


def _refined(X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"]:
    """Newton steps (Kleinman 1968) in correction form, as long as each halves the residual."""
    best, (defect, size) = X, _residual(X, A, B, Q)
    halved = size > 0.0
    while halved:
        with warnings.catch_warnings():
            # A pole near the axis makes the step doubtful; it counts only if it halves the residual.
            warnings.filterwarnings("ignore", "Input .a. has an eigenvalue pair", RuntimeWarning)
            step = np.asarray(sla.solve_continuous_lyapunov((A - B @ (best @ B).T).T, -defect))
        candidate = best + (step + step.T) / 2.0
        defect, now = _residual(candidate, A, B, Q)
        halved = 0.0 < now < size / 2.0
        best, size = (candidate, now) if now < size else (best, size)
    return best


def _residual(
    X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray
) -> tuple[Float[np.ndarray, "state state"], float]:
    linear, factor = A.T @ X, X @ B
    quadratic = factor @ factor.T
    defect = linear + linear.T - quadratic + Q
    terms = 2.0 * np.linalg.norm(linear) + np.linalg.norm(quadratic) + np.linalg.norm(Q)
    return defect, float(np.linalg.norm(defect) / terms) if terms > 0.0 else 0.0
