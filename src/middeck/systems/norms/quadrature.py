"""Adaptive quadrature of many outputs together: Gauss's rule of 16 points, its error by null rules."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

PANELS_AT_ONCE = 64
"""Panels evaluated together: a thousand lines, some megabytes for a hundred states."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
# Two: one alone is small by chance on some panel of a response that waves within it.
_NULL = (np.polynomial.legendre.legvander(_NODES, 15)[:, -2:] * np.sqrt([29.0, 31.0])).T * _WEIGHTS
"""Null rules: coefficients of the two highest Legendre polynomials that 16 points know, of unit mean square
(Berntsen and Espelid 1991, ACM Trans. Math. Softw. 17). The integral errs by less."""


def integrate(
    power: Callable[[np.ndarray], np.ndarray], edges: Float[np.ndarray, " edge"], tolerance: float
) -> Float[np.ndarray, " output"]:
    """The integral of ``power`` [line, output], not negative, between the first and the last of ``edges``.

    Panels are halved while a null rule exceeds ``tolerance`` of the whole integral: of the whole, so that
    halving ends where a panel's own value is uncertain by rounding.
    """
    low, high = edges[:-1], edges[1:]
    done = 0.0
    while True:
        half = 0.5 * (high - low)
        lines = 0.5 * (low + high)[:, None] + half[:, None] * _NODES
        some = np.array_split(lines, -(-len(lines) // PANELS_AT_ONCE))
        values = np.concatenate([power(part.ravel()).reshape(*part.shape, -1) for part in some])
        values = values * half[:, None, None]
        each = np.einsum("k,pko->po", _WEIGHTS, values)
        error = np.abs(np.einsum("nk,pko->npo", _NULL, values)).max(axis=0)
        rough = np.any(error > tolerance * (done + each.sum(axis=0)), axis=1)
        done = done + each[~rough].sum(axis=0)
        if not rough.any():
            return done
        middle = 0.5 * (low + high)[rough]
        low, high = np.concatenate([low[rough], middle]), np.concatenate([middle, high[rough]])
