"""Nodes that move with a neighbour: those joined by members far stiffer than all around them.

Members are joined in the order of their stiffness, the stiffest first. A piece whose softest joint is
`CONTRAST` times as stiff as the next connection moves as one body, except for strains too small for
coordinates in W: its nodes are carried by its first one, which then represents the piece. Pieces within
pieces are found on the way. For a joint so stiff that rounding in W gives a force comparable with the weight
(`ROUNDS_AT`) a contrast of `LITTLE` is enough. The choice affects rounding only, not the result.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Inexact, Int
from scipy.sparse.csgraph import minimum_spanning_tree

from middeck.structure.elements.beam import BeamProperties

# Stiffness contrast of a pair; for n nodes n^2/4 times as much, since a long piece is softer than its
# members. Without a carrier, rounding of 1e-16 times this stays in what holds the piece.
CONTRAST = 1e6
# Stiffness over that of what holds the article: rounding of 1e-16 of a sag is then 1e-7 of the weight.
ROUNDS_AT = 1e9
LITTLE = 10.0
# What holds a whole article is no part of it: a suspension of tenths of a hertz, 1 rad^2/s^2 of its mass.
HELD_AT = 1.0


def choose_carriers(
    roots: int,
    beams: BeamProperties,
    ends: Int[np.ndarray, "element 2"],
    ties: Int[np.ndarray, "tie 2"],
    tie_stiffness: Float[np.ndarray, " tie"],
    mass: float,
    held: Collection[int] = (),
) -> Int[np.ndarray, " root"]:
    """The root that carries each root, -1 where none does; ``ends`` of elements and those of ``ties``,
    springs and bushings, are roots.

    Roots that the world has ``held`` are carried by none, and carry their pieces before others.
    """
    carrier = np.full(roots, -1)
    stiffness = np.concatenate([member_stiffness(beams), tie_stiffness])
    pairs = np.concatenate([ends, ties])
    least = max(HELD_AT * mass, float(np.finfo(float).tiny))
    if not np.any(stiffness > CONTRAST * least):
        return carrier
    piece = _Pieces(roots, carrier, ROUNDS_AT * least, held)
    for a, b, k in _spanning_tree(roots, pairs, stiffness):
        piece.join(int(a), int(b), float(k))
    piece.close(least)
    return carrier


def member_stiffness(beams: BeamProperties) -> Float[np.ndarray, " element"]:
    """Stiffness [N/m] of one end, across or along, with the other end clamped."""
    L = np.real(beams.length)
    bent = np.maximum(
        np.real(beams.EI_y) / (1.0 + np.real(beams.shear_z)),
        np.real(beams.EI_z) / (1.0 + np.real(beams.shear_y)),
    )
    return np.maximum(np.real(beams.EA) / L, 12.0 * bent / L**3)


def bushing_stiffness(stiffness: Inexact[np.ndarray, "6 6"], length: float) -> float:
    """The largest stiffness [N/m] of a bushing, turns counted at an arm of ``length``."""
    k = np.abs(np.diag(np.real(stiffness)))
    return float(max(k[:3].max(), k[3:].max() / length**2))


def _spanning_tree(roots: int, pairs: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Rows (root, root, stiffness) of the tree of the stiffest connections, the stiffest first."""
    own = (pairs[:, 0] != pairs[:, 1]) & (stiffness > 0.0)
    low, high, k = pairs[own].min(axis=1), pairs[own].max(axis=1), stiffness[own]
    rank = np.lexsort((-k, high, low))
    low, high, k = low[rank], high[rank], k[rank]
    first = np.ones(len(k), dtype=bool)
    first[1:] = (np.diff(low) != 0) | (np.diff(high) != 0)  # the stiffest of parallel members
    low, high, k = low[first], high[first], k[first]
    weight = np.empty(len(k))
    weight[np.argsort(-k, kind="stable")] = np.arange(1.0, len(k) + 1.0)
    tree = sp.coo_array(
        minimum_spanning_tree(sp.coo_array((weight, (low, high)), shape=(roots, roots)).tocsr())
    )
    order = np.argsort(tree.data)
    value = np.sort(k)[::-1][tree.data[order].astype(int) - 1]
    return np.column_stack([tree.row[order], tree.col[order], value])


class _Pieces:
    """Nodes joined so far: of each piece its first node, its size, and its softest joint."""

    def __init__(self, roots: int, carrier: np.ndarray, rounds_at: float, held: Collection[int]) -> None:
        self.carrier = carrier
        self.held = held
        self.rounds_at = rounds_at
        self.part_of = list(range(roots))
        self.nodes = [[i] for i in range(roots)]
        self.softest = [np.inf] * roots

    def join(self, a: int, b: int, stiffness: float) -> None:
        """Two pieces become one, each closed first if it is so much stiffer than what joins them."""
        a, b = sorted(self._close(self._find(i), stiffness) for i in (a, b))
        if len(self.nodes[a]) < len(self.nodes[b]):
            a, b = b, a
        self.part_of[b] = a
        self.nodes[a] += self.nodes[b]
        self.nodes[b] = []
        self.softest[a] = stiffness

    def close(self, stiffness: float) -> None:
        """Close all remaining pieces, which ``stiffness`` alone holds."""
        for i in range(len(self.part_of)):
            if self.part_of[i] == i:
                self._close(i, stiffness)

    def _find(self, i: int) -> int:
        while self.part_of[i] != i:
            self.part_of[i] = self.part_of[self.part_of[i]]
            i = self.part_of[i]
        return i

    def _close(self, piece: int, held_by: float) -> int:
        nodes, softest = self.nodes[piece], self.softest[piece]
        contrast = CONTRAST if softest < self.rounds_at else LITTLE
        if len(nodes) > 1 and softest >= 0.25 * contrast * len(nodes) ** 2 * held_by:
            first = min(nodes, key=lambda i: (i not in self.held, i))
            self.carrier[[i for i in nodes if i != first and i not in self.held]] = first
            self.nodes[piece] = [first]
            self.softest[piece] = np.inf
        return piece
