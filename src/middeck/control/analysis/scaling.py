"""The structured singular value of diagonal complex blocks, bounded from above by diagonal scaling."""

from __future__ import annotations

import numpy as np
import scipy.optimize as opt
from jaxtyping import Complex, Float

SWEEPS = 12
"""A start that is not quite balanced costs a few steps of the descent, no more."""


def scaled_norms(M: Complex[np.ndarray, "line channel channel"]) -> Float[np.ndarray, " line"]:
    """min over positive diagonal D of the largest singular value of D M D^-1, line by line.

    Convex in log D (Safonov and Doyle 1984; Packard and Doyle 1993, Automatica 29, "The complex structured
    singular value"). Osborne's balancing (1960) starts; lines that could hold the largest value are then
    minimised, which is enough: on the others the bound of the start is below it.

    >>> scaled_norms(np.array([[[0.0, 100.0], [0.01, 0.0]]]))
    array([1.])
    """
    if M.shape[1] == 1:
        return np.abs(M[:, 0, 0])
    start = _balance(np.abs(M))
    bound = np.linalg.norm(np.exp(start)[:, :, None] * M * np.exp(-start)[:, None, :], 2, axis=(1, 2))
    best = 0.0
    for k in np.argsort(-bound):
        if bound[k] <= best:
            break
        bound[k] = min(bound[k], _minimise(M[k], start[k]))
        best = max(best, float(bound[k]))
    return bound


def _balance(size: Float[np.ndarray, "line channel channel"]) -> Float[np.ndarray, "line channel"]:
    """log D for which rows and columns are of like size, all lines at once."""
    square = size**2
    log_d = np.zeros(size.shape[:2])
    off = ~np.eye(size.shape[1], dtype=bool)
    for _ in range(SWEEPS):
        for i in range(size.shape[1]):
            factor = np.exp(2.0 * (log_d[:, [i]] - log_d))
            row = np.sum(np.where(off[i], square[:, i, :] * factor, 0.0), axis=1)
            column = np.sum(np.where(off[i], square[:, :, i] / factor, 0.0), axis=1)
            # An empty row or column: the block matters no further, and need not be scaled without end.
            both = (row > 0.0) & (column > 0.0)
            ratio = np.divide(column, row, out=np.ones_like(row), where=both)
            log_d[:, i] += 0.25 * np.log(ratio)
    return log_d - log_d.mean(axis=1, keepdims=True)


def _minimise(M: np.ndarray, log_d: np.ndarray) -> float:
    """By the gradient of the largest singular value; where two meet it ends near the minimum, from above."""

    def level(x: np.ndarray) -> tuple[float, np.ndarray]:
        left, value, right = np.linalg.svd(np.exp(x)[:, None] * M * np.exp(-x))
        return float(np.log(value[0])), np.abs(left[:, 0]) ** 2 - np.abs(right[0]) ** 2

    smooth = opt.minimize(level, log_d, jac=True, method="L-BFGS-B", options={"ftol": 1e-14, "gtol": 1e-10})

    def height(x: np.ndarray) -> float:
        return level(x)[0]

    polished = opt.minimize(height, smooth.x, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13})
    return float(np.exp(min(smooth.fun, polished.fun)))
