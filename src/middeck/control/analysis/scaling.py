"""The structured singular value of diagonal complex blocks, bounded from above by diagonal scaling."""

from __future__ import annotations

import numpy as np
import scipy.optimize as opt
from jaxtyping import Complex, Float

CLOSE = 1e-9
MEET, MOST_POLISHED = 1e-3, 8
"""Singular values this close make a corner; beyond so many channels a simplex takes too long to turn it."""
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
    bound = _norms(M, start)
    done = np.zeros(len(M), dtype=bool)
    best = 0.0
    while True:
        # A scaling that is best on one line is good on those beside it: most are settled without a descent.
        above = np.flatnonzero(~done & (bound > best * (1.0 + CLOSE)))
        if not len(above):
            return bound
        k = int(above[np.argmax(bound[above])])
        value, log_d = _minimise(M[k], start[k])
        bound[k], done[k] = min(bound[k], value), True
        best = max(best, float(bound[k]))
        bound[above] = np.minimum(bound[above], _norms(M[above], log_d[None]))


def _norms(M: np.ndarray, log_d: np.ndarray) -> Float[np.ndarray, " line"]:
    scaled = np.exp(log_d)[:, :, None] * M * np.exp(-log_d)[:, None, :]
    return np.asarray(np.linalg.norm(scaled, 2, axis=(1, 2)))


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


def _minimise(M: np.ndarray, log_d: np.ndarray) -> tuple[float, np.ndarray]:
    """By the gradient of the largest singular value; where two meet, without one from there on."""

    def level(x: np.ndarray) -> tuple[float, np.ndarray]:
        left, value, right = np.linalg.svd(np.exp(x)[:, None] * M * np.exp(-x))
        return float(np.log(value[0])), np.abs(left[:, 0]) ** 2 - np.abs(right[0]) ** 2

    def height(x: np.ndarray) -> float:
        return level(x)[0]

    found = opt.minimize(level, log_d, jac=True, method="L-BFGS-B", options={"ftol": 1e-14, "gtol": 1e-10})
    value = np.linalg.svd(np.exp(found.x)[:, None] * M * np.exp(-found.x), compute_uv=False)
    if value[1] > (1.0 - MEET) * value[0] and len(log_d) < MOST_POLISHED:
        options = {"xatol": 1e-9, "fatol": 1e-13}
        polished = opt.minimize(height, found.x, method="Nelder-Mead", options=options)
        found = polished if polished.fun < found.fun else found
    return float(np.exp(found.fun)), np.asarray(found.x)
