"""Newton's method for the continuous Riccati equation (Kleinman 1968, IEEE TAC 13), in correction form.

The residual drives the step instead of a fresh solution, so that rounding is relative to the correction.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.riccati.lyapunov import solve_lyapunov


def refine(X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> Float[np.ndarray, "state state"]:
    """Newton steps as long as each halves the residual and that is above rounding."""
    best, (defect, size) = X, residual(X, A, B, Q)
    halved = size > 0.0
    while halved:
        step = _step(best, defect, A, B)
        if step is None:
            return best
        candidate = best + step
        defect, now = residual(candidate, A, B, Q)
        halved = rounding(A) < now < size / 2.0
        best, size = (candidate, now) if now < size else (best, size)
    return best


def rounding(A: np.ndarray) -> float:
    """Relative residual attributable to rounding."""
    return 0.1 * len(A) * float(np.finfo(float).eps)


def residual(
    X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray
) -> tuple[Float[np.ndarray, "state state"], float]:
    """A'X + XA - (XB)(XB)' + Q, and its Frobenius norm relative to the sum of those of its terms.

    ``inf`` for an X whose terms are beyond numbers, as after a Newton step from far away.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        linear, factor = A.T @ X, X @ B
        quadratic = factor @ factor.T
        defect = linear + linear.T - quadratic + Q
        terms = 2.0 * np.linalg.norm(linear) + np.linalg.norm(quadratic) + np.linalg.norm(Q)
    if not np.isfinite(terms):
        return defect, np.inf
    return defect, float(np.linalg.norm(defect) / terms) if terms > 0.0 else 0.0


def _step(X: np.ndarray, defect: np.ndarray, A: np.ndarray, B: np.ndarray) -> np.ndarray | None:
    try:
        step = solve_lyapunov(A - B @ (X @ B).T, defect)
    except np.linalg.LinAlgError:
        return None
    return step if np.all(np.isfinite(step)) else None
