"""Shapes of stiff modes to rounding: what other modes are in them is taken out.

An inverse problem with the shift sigma leaves eps lam / sigma of neighbours in the shape of a mode. The
residual of the mode shows by how much, but for eps size / lam: to first order (Ogita and Aishima 2018,
"Iterative refinement for symmetric eigenvalue decomposition", Japan J. Indust. Appl. Math. 35). Modes of
nearly one frequency are parted exactly, within the space of their shapes (Rayleigh and Ritz).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

# Most rounds of first-order correction, and the change of a shape that leaves its square to the next.
SHARPENINGS, SHARP = 8, 1e-6
# Part of another mode in a shape above which the two count as mixed.
MIXED = 1e-2
# Modes whose omega^2 are nearer count as mixed, too: to first order rounding would be most of their change.
NEAR = 1e-4

Groups = Sequence[Int[np.ndarray, " some"]]
"""Modes that mix, by their places among the stiff ones."""


def part_stiff_modes(
    K: sp.csr_array,
    M: sp.csr_array,
    lam: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "n mode"],
    stiff: Bool[np.ndarray, " mode"],
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, "n mode"]]:
    """Omega^2 and mass-normalised shapes, of ``stiff`` modes to rounding; ``lam`` ascends as given."""
    lam, X = lam.copy(), shapes.copy()
    # Modes of nearly one frequency stay together.
    label = np.concatenate([[0], np.cumsum(np.diff(lam) > NEAR * np.abs(lam[1:]))])
    left = np.flatnonzero(np.isin(label, label[stiff]))
    for _ in range(SHARPENINGS):
        if not len(left):
            break
        strained, moved = X.T @ (K @ X[:, left]), X.T @ (M @ X[:, left])
        lam[left] = _quotients(strained, moved, left)
        groups = _near(_parts(strained, moved, lam, left), lam[left], left)
        for some in groups:
            own = left[some]
            turn = _parted(strained[np.ix_(own, some)], moved[np.ix_(own, some)])
            X[:, own] = X[:, own] @ turn
            for matrix in (strained, moved):
                matrix[:, some] = matrix[:, some] @ turn
                matrix[own] = turn.T @ matrix[own]
        lam[left] = _quotients(strained, moved, left)
        part = _parts(strained, moved, lam, left, groups)
        own_mass = moved[left, np.arange(len(left))]
        X[:, left] = (X[:, left] + X @ part) / np.sqrt(own_mass + np.sum(part**2, axis=0))
        lam[left] += np.sum((strained - moved * lam[left]) * part, axis=0)
        again = np.abs(part).max(axis=0) > SHARP
        for some in groups:
            again[some] = again[some].any()
        left = left[again]
    return lam, X


def _quotients(strained: np.ndarray, moved: np.ndarray, left: np.ndarray) -> Float[np.ndarray, " left"]:
    """Omega^2 of each mode that is ``left`` by Rayleigh's quotient."""
    at = np.arange(len(left))
    return strained[left, at] / moved[left, at]


def _parts(
    strained: np.ndarray, moved: np.ndarray, lam: np.ndarray, left: np.ndarray, groups: Groups = ()
) -> Float[np.ndarray, "mode left"]:
    """Part of each mode to be added to those that are ``left``; none of itself, or within ``groups``."""
    within, gap = strained - moved * lam[left], lam[left] - lam[:, None]
    within[left, np.arange(len(left))] = 0.0
    for some in groups:
        within[np.ix_(left[some], some)] = 0.0
    # The tangent of the angle by which a pair of modes is turned; within / gap where that is small.
    return 2.0 * within / (gap + np.copysign(np.hypot(gap, 2.0 * within) + np.finfo(float).tiny, gap))


def _near(part: np.ndarray, lam: np.ndarray, left: np.ndarray) -> Groups:
    """Groups of modes that mix or whose frequencies are nearly one."""
    mixed = (np.abs(part[left]) > MIXED) | (np.abs(lam[:, None] - lam) < NEAR * lam)
    _, label = connected_components(mixed, directed=False)
    by_group = np.argsort(label, kind="stable")
    groups = np.split(by_group, np.flatnonzero(np.diff(label[by_group])) + 1)
    return [some for some in groups if len(some) > 1]


def _parted(strained: np.ndarray, moved: np.ndarray) -> Float[np.ndarray, "some some"]:
    """Modes within the space of some shapes, by the differences of their omega^2, which are small."""
    middle = np.trace(strained) / np.trace(moved)
    off = strained - middle * moved
    return sla.eigh(0.5 * (off + off.T), 0.5 * (moved + moved.T))[1]
