"""Multiple poles split by rounding: computed values, and the mean of each inseparable group.

Rounding splits a pole of multiplicity k with one eigenvector into a star of radius eps^(1/k) |A|; the mean of
the star is accurate to rounding (Kato 1976, section II.2). The uncertainty of a pole follows from the angle
between its left and right eigenvectors (Wilkinson 1965, chapter 2), within its strongly connected component.
"""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float
from scipy.sparse.csgraph import connected_components

from middeck.systems.poles.strong_components import strong_components
from middeck.values import record

ROUNDINGS = 10.0
"""Backward error of an eigenvalue of LAPACK in units of rounding of its component."""


@record
class Crowds:
    """Computed poles, and for each the mean of the group inseparable from it."""

    values: Complex[np.ndarray, " pole"]
    means: Complex[np.ndarray, " pole"]


def find_crowds(A: Float[np.ndarray, "state state"]) -> Crowds:
    """The poles of ``A`` (balanced, for rounding to be small).

    >>> chain = np.diag(np.ones(2), -1)
    >>> Q = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    >>> bool(np.abs(find_crowds(Q @ chain @ Q.T).means).max() < 1e-14)
    True
    """
    found = [_crowds_within(A[np.ix_(part, part)]) for part in strong_components(A)]
    values, means = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Crowds(values, means)


def _crowds_within(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    values, left, right = cast("tuple[np.ndarray, ...]", sla.eig(A, left=True, right=True))
    values = values.astype(complex)
    known = _radius(A, left, right)
    together = np.abs(values[:, None] - values) <= known[:, None] + known
    count, label = cast("tuple[int, np.ndarray]", connected_components(together, directed=False))
    share = np.bincount(label, minlength=count)
    means = (
        np.bincount(label, np.real(values), count) + 1j * np.bincount(label, np.imag(values), count)
    ) / share
    return values, means[label]


def _radius(A: np.ndarray, left: np.ndarray, right: np.ndarray) -> Float[np.ndarray, " pole"]:
    """Uncertainty radius of each eigenvalue, at most that of a fourfold one."""
    aligned = np.abs(np.sum(np.conj(left) * right, axis=0))
    rounding = ROUNDINGS * np.finfo(float).eps
    return rounding * float(np.linalg.norm(A)) / np.maximum(aligned, rounding**0.75)
