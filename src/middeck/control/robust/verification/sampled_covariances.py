"""Covariances of many sampled loops at once, by doubling."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

DOUBLINGS = 60


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
