"""Repeated frequencies: groups of modes whose basis is arbitrary, and the basis that is chosen.

Of modes of one frequency those are taken whose kinetic energy is most unequal in its directions: of a round
beam one mode bends in each plane. It does not depend on the basis that a solver returns.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.structure.elements.frames import FrameTree

# Modes whose omega^2 differ by less, relative to the larger, have one frequency: any basis of theirs will do.
REPEATED = 1e-6
# Weighted kinetic energies, of unit order, that differ by less do not distinguish two modes.
DISTINCT = 1e-3
WEIGHTS = (0.0, 1.0, 2.0, 3.0, 3.25, 3.5)  # x comes first, translation before rotation


def by_frequency(lam: Float[np.ndarray, " mode"]) -> list[Int[np.ndarray, " member"]]:
    """Ascending indices of the modes of each frequency, from omega^2 in any order."""
    ascending = np.argsort(lam, kind="stable")
    size = np.abs(lam[ascending])
    apart = np.diff(lam[ascending]) > REPEATED * np.maximum(size[1:], size[:-1])
    return [np.sort(c) for c in np.split(ascending, np.flatnonzero(apart) + 1) if len(c)]


def repeated(lam: Float[np.ndarray, " mode"]) -> list[Int[np.ndarray, " member"]]:
    """Groups of `by_frequency` with several modes."""
    return [group for group in by_frequency(lam) if len(group) > 1]


def repeated_apart(
    tree: FrameTree,
    M: sp.csr_array,
    lam: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "coordinate mode"],
) -> list[Int[np.ndarray, " member"]]:
    """Groups of modes of one frequency whose basis stays arbitrary after `turn_apart`."""
    groups: list[np.ndarray] = []
    for cluster in repeated(lam):
        weight = np.diagonal(_weighted_energy(tree, M, shapes[:, cluster]))
        ascending = np.argsort(weight, kind="stable")
        cuts = np.flatnonzero(np.diff(weight[ascending]) > DISTINCT) + 1
        groups += [g for g in np.split(cluster[ascending], cuts) if len(g) > 1]
    return groups


def turn_apart(
    tree: FrameTree, M: sp.csr_array, shapes: Float[np.ndarray, "coordinate mode"]
) -> Float[np.ndarray, "coordinate mode"]:
    """The basis of ``shapes``, modes of one frequency, that is diagonal in a weighted kinetic energy."""
    return shapes @ np.linalg.eigh(_weighted_energy(tree, M, shapes))[1]


def _weighted_energy(tree: FrameTree, M: sp.csr_array, shapes: np.ndarray) -> Float[np.ndarray, "mode mode"]:
    """Kinetic energy with another weight for each direction of nodes, and for each joint."""
    weight = np.concatenate([np.tile(WEIGHTS, tree.roots), 4.0 + np.arange(tree.size - 6 * tree.roots)])
    half = shapes.T @ (weight[:, None] * (M @ shapes))
    return 0.5 * (half + half.T)
