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
PROBED = 4
"""Halvings after which a panel is looked at for rounding: peaks and waves of a response seldom take more."""
MOVED = 2.0**-50
"""Relative shift of the lines, four units of the last place: what it changes is rounding. The power of a
resonance of relative width 1e-9 follows it by 1e-6."""
ROUNDING = 4.0
"""Null rule over the rms change by that shift, up to which rounding explains it (white noise: 0.35 to 1)."""
SHARE = 0.01
"""Part of the rounding of the whole integral up to which a panel is not halved: where rounding has steps
wider than the shift, a panel alone does not show it."""


def integrate(
    power: Callable[[np.ndarray], np.ndarray], edges: Float[np.ndarray, " edge"], tolerance: float
) -> Float[np.ndarray, " output"]:
    """The integral of ``power`` [line, output], not negative, between the first and the last of ``edges``.

    Panels are halved while a null rule exceeds ``tolerance`` of the whole integral: of the whole, so that
    halving ends where a panel's own value is uncertain by rounding. Where the whole is rounding, as of a path
    that is zero because two parts cancel, it ends where rounding explains the null rule, unless half a panel
    has more than the whole one had: towards an undamped pole that grows without bound.
    """
    low, high = edges[:-1], edges[1:]
    done, known, halvings, before = 0.0, 0.0, 0, np.inf
    while True:
        half = 0.5 * (high - low)
        lines = 0.5 * (low + high)[:, None] + half[:, None] * _NODES
        values = _powers(power, lines) * half[:, None, None]
        each = np.einsum("k,pko->po", _WEIGHTS, values)
        error = np.abs(np.einsum("nk,pko->npo", _NULL, values)).max(axis=0)
        above = error > tolerance * (done + each.sum(axis=0))
        rough = np.any(above, axis=1)
        if halvings >= PROBED and rough.any():
            moved = _powers(power, lines[rough] * (1.0 + MOVED)) * half[rough, None, None]
            noise = np.sqrt(np.mean((moved - values[rough]) ** 2, axis=1))
            known = np.maximum(known, noise.sum(axis=0))
            explained = np.maximum(ROUNDING * noise, SHARE * known)
            unsettled = (error[rough] > explained) | (each > before)[rough]
            rough[rough] = np.any(above[rough] & unsettled, axis=1)
        done = done + each[~rough].sum(axis=0)
        if not rough.any():
            return done
        middle = 0.5 * (low + high)[rough]
        low, high = np.concatenate([low[rough], middle]), np.concatenate([middle, high[rough]])
        before = np.concatenate([each[rough], each[rough]])
        halvings += 1


def _powers(
    power: Callable[[np.ndarray], np.ndarray], lines: Float[np.ndarray, "panel line"]
) -> Float[np.ndarray, "panel line output"]:
    some = np.array_split(lines, -(-len(lines) // PANELS_AT_ONCE))
    return np.concatenate([power(part.ravel()).reshape(*part.shape, -1) for part in some])
