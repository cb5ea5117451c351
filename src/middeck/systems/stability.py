"""Stability, by eigenvalues and nothing else.

Past an instability a frequency integral stays finite and looks good; so no norm ever answers this question.
Of a multiple eigenvalue with too few eigenvectors (the double one of a free body) rounding makes several, to
both sides of the axis, by the root of rounding. Their mean is known to rounding, and stands for them all
(Kato 1976, section II.2; Bavely and Stewart 1979, SIAM J. Numer. Anal. 16).
"""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex
from scipy.sparse.csgraph import connected_components

from middeck.systems.statespace import SampledStateSpace, StateSpace, poles

GROWTH_LIMIT = 1e-8
"""Largest real part [rad/s] that still counts as stable: above rounding at an undamped pole, far below any
growth that an experiment could show (a factor e in three years)."""
ROUNDINGS = 100.0
"""Eigenvalues that a change of A by so many roundings makes coincide are one that rounding has split."""
CROWDED = 1e-4
"""Only eigenvalues that are nearer to each other and to the axis (or circle), beside A, are looked at."""


def growth_rates(system: StateSpace | SampledStateSpace) -> Complex[np.ndarray, " state"]:
    """Poles in rad/s; those of a sampled system are mapped by log(p)/T (a pole at zero to -inf).

    Those beside the axis that rounding has split are their mean.

    >>> growth_rates(StateSpace([[-2.0]], [[1.0]], [[1.0]], [[0.0]])).real
    array([-2.])
    """
    sampled = isinstance(system, SampledStateSpace)
    p = _joined(system.A, poles(system), circle=sampled)
    if not sampled:
        return p
    size = np.abs(p)
    rate = np.full(len(p), -np.inf)
    np.log(size, out=rate, where=size > 0.0)
    rates = np.empty(len(p), dtype=complex)
    rates.real, rates.imag = rate / system.period_s, np.angle(p) / system.period_s
    return rates


def _joined(A: np.ndarray, values: np.ndarray, *, circle: bool) -> Complex[np.ndarray, " state"]:
    """The eigenvalues, with those that rounding has parted replaced by their mean."""
    if not len(A):
        return values
    balanced = np.asarray(sla.matrix_balance(A, permute=False)[0])
    size = float(np.linalg.norm(balanced))
    away = np.abs(np.abs(values) - 1.0) if circle else np.abs(np.real(values))
    beside = np.flatnonzero(away < CROWDED * size)
    apart = np.where(np.eye(len(beside), dtype=bool), np.inf, 0.0)
    near = np.abs(values[beside, None] - values[beside]) + apart
    if not np.any(near < CROWDED * size):
        return values
    found, left, right = cast("tuple[np.ndarray, ...]", sla.eig(balanced, left=True, right=True))
    found = found.astype(complex)
    aligned = np.abs(np.sum(np.conj(left) * right, axis=0))
    known = ROUNDINGS * np.finfo(float).eps * size / np.maximum(aligned, np.finfo(float).eps)
    known = np.minimum(known, CROWDED * size)
    together = np.abs(found[:, None] - found) <= 2.0 * np.minimum(known[:, None], known)
    count, label = cast("tuple[int, np.ndarray]", connected_components(together, directed=False))
    for group in (np.flatnonzero(label == k) for k in range(count)):
        mean = np.mean(found[group])
        # A group and its mirror image have conjugate means.
        own = len(group) > 1 and np.all(np.isin(np.conj(found[group]), found[group]))
        found[group] = mean.real if own else mean
    return found


def is_stable(system: StateSpace | SampledStateSpace) -> bool:
    """True where no pole grows faster than `GROWTH_LIMIT`; a system without states is stable.

    >>> is_stable(StateSpace([[0.1]], [[1.0]], [[1.0]], [[0.0]]))
    False
    """
    return none_grows(growth_rates(system))


def none_grows(rates: Complex[np.ndarray, " state"]) -> bool:
    """The same, asked of poles [rad/s] that are known already.

    >>> none_grows(np.array([-1.0 + 2.0j, -1.0 - 2.0j]))
    True
    """
    return not len(rates) or bool(np.real(rates).max() <= GROWTH_LIMIT)
