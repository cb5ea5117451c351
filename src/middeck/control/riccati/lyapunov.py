"""Lyapunov equations: the linear half of every Newton step, and of every covariance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

SQUARINGS = 60
"""As many as a pole at 1 - 1e-16 takes."""


def solve_discrete_lyapunov(
    A: Float[np.ndarray, "state state"], Q: Float[np.ndarray, "state state"]
) -> Float[np.ndarray, "state state"] | None:
    """X with A'XA - X + Q = 0 for A inside the unit circle; None where the series does not end.

    Squared Smith iteration (Smith 1968, SIAM J. Appl. Math. 16): X = sum A'^k Q A^k, doubled at each step.

    >>> solve_discrete_lyapunov(np.array([[0.5]]), np.array([[3.0]]))
    array([[4.]])
    """
    total, power = Q, A
    # Past overflow the sum is not finite, which is asked below.
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(SQUARINGS):
            more = power.T @ total @ power
            total = total + more
            if not np.all(np.isfinite(total)):
                return None
            if np.abs(more).max(initial=0.0) <= 1e-17 * np.abs(total).max(initial=0.0):
                return (total + total.T) / 2.0
            power = power @ power
    return None
