"""The structured singular value of diagonal complex blocks, bounded from above by diagonal scaling."""

from __future__ import annotations

import numpy as np
import scipy.optimize as opt
from jaxtyping import Complex, Float

CLOSE = 1e-9
MEET, MOST_POLISHED = 1e-3, 8
"""Relative distance at which two singular values meet; most channels for a simplex search."""
SWEEPS, BALANCED = 12, 0.05
"""Balancing sweeps for the start; an imperfect balance only costs a few steps of the descent."""
FARTHEST = 40.0
"""Change of log D beyond which a channel that none answers is as good as alone, and short of overflow."""
NEAR = 0.9
"""Fraction of the largest value below which an upper bound is accepted."""


def scaled_norms(M: Complex[np.ndarray, "line channel channel"]) -> Float[np.ndarray, " line"]:
    """min over positive diagonal D of the largest singular value of D M D^-1, line by line.

    Convex in log D (Safonov and Doyle 1984; Packard and Doyle 1993, Automatica 29, "The complex structured
    singular value"). Only lines that could hold the largest value are minimised: on the others an upper bound
    is given, below nine tenths of the largest by the Frobenius norm, and else by the start of the descent.

    >>> scaled_norms(np.array([[[0.0, 100.0], [0.01, 0.0]]]))
    array([1.])
    """
    if M.shape[1] == 1:
        return np.abs(M[:, 0, 0])
    square = np.abs(M) ** 2
    bound = _frobenius(square, balance_channels(square.sum(axis=0, keepdims=True)))
    top = [int(np.argmax(bound))] if len(M) else []
    level = NEAR * max(
        (minimise_scaling(M[k], balance_channels(square[[k]])[0])[0] for k in top), default=0.0
    )
    near = np.flatnonzero(bound > level)
    start = balance_channels(square[near])
    bound[near] = _frobenius(square[near], start)
    high = bound[near] > level
    near, start = near[high], start[high]
    bound[near] = _minimised(M[near], start)
    return bound


def _minimised(M: np.ndarray, start: np.ndarray) -> Float[np.ndarray, " line"]:
    """From ``start``: the lines that could hold the largest value, and bounds of the others."""
    bound = _norms(M, start)
    done = np.zeros(len(M), dtype=bool)
    best = 0.0
    while True:
        # The best scaling of one line is good on its neighbours: most need no descent.
        above = np.flatnonzero(~done & (bound > best * (1.0 + CLOSE)))
        if not len(above):
            return bound
        k = int(above[np.argmax(bound[above])])
        value, log_d = minimise_scaling(M[k], start[k])
        bound[k], done[k] = min(bound[k], value), True
        best = max(best, float(bound[k]))
        bound[above] = np.minimum(bound[above], _norms(M[above], log_d[None]))


def _norms(M: np.ndarray, log_d: np.ndarray) -> Float[np.ndarray, " line"]:
    scaled = np.exp(log_d)[:, :, None] * M * np.exp(-log_d)[:, None, :]
    return np.asarray(np.linalg.norm(scaled, 2, axis=(1, 2)))


def _frobenius(square: np.ndarray, log_d: np.ndarray) -> Float[np.ndarray, " line"]:
    """Frobenius norm of D M D^-1 (an upper bound of the norm), from |M|^2."""
    d = np.exp(2.0 * log_d)
    return np.sqrt(np.sum(d * np.sum(square / d[:, None, :], axis=2), axis=1))


def balance_channels(square: Float[np.ndarray, "line channel channel"]) -> Float[np.ndarray, "line channel"]:
    """log D that balances rows and columns, all lines at once, from |M|^2 (Osborne 1960)."""
    channels = square.shape[1]
    scaled, log_d = square * ~np.eye(channels, dtype=bool), np.zeros(square.shape[:2])
    for _ in range(SWEEPS):
        before = log_d.copy()
        for i in range(channels):
            row, column = scaled[:, i].sum(axis=1), scaled[:, :, i].sum(axis=1)
            # An empty row or column has no effect; leave its scale.
            both = (row > 0.0) & (column > 0.0)
            factor = np.sqrt(np.divide(column, row, out=np.ones_like(row), where=both))
            scaled[:, i] *= factor[:, None]
            scaled[:, :, i] /= factor[:, None]
            log_d[:, i] += 0.5 * np.log(factor)
        if np.abs(log_d - before).max(initial=0.0) < BALANCED:
            break
    return log_d - log_d.mean(axis=1, keepdims=True)


def minimise_scaling(M: np.ndarray, log_d: np.ndarray) -> tuple[float, np.ndarray]:
    """Minimise by the gradient of the largest singular value; without gradient once two of them meet."""

    def level(x: np.ndarray) -> tuple[float, np.ndarray]:
        left, value, right = np.linalg.svd(np.exp(x)[:, None] * M * np.exp(-x))
        return float(np.log(value[0])), np.abs(left[:, 0]) ** 2 - np.abs(right[0]) ** 2

    def height(x: np.ndarray) -> float:
        return level(x)[0]

    bounds = list(zip(log_d - FARTHEST, log_d + FARTHEST, strict=True))
    options = {"ftol": 1e-14, "gtol": 1e-10}
    found = opt.minimize(level, log_d, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    value = np.linalg.svd(np.exp(found.x)[:, None] * M * np.exp(-found.x), compute_uv=False)
    if value[1] > (1.0 - MEET) * value[0] and len(log_d) < MOST_POLISHED:
        options = {"xatol": 1e-9, "fatol": 1e-13}
        polished = opt.minimize(height, found.x, method="Nelder-Mead", bounds=bounds, options=options)
        found = polished if polished.fun < found.fun else found
    return float(np.exp(found.fun)), np.asarray(found.x)
