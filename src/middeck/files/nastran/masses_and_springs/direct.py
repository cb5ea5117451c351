"""A matrix by direct input that stands alone: a stiffness (K2GG) as bushings, a mass (M2GG) as bodies.

A stiffness between grids is a sum of bushings where each pair of them has one: the block between two grids
says which, and what is left of each grid's own block goes to the ground. A mass is bodies where its blocks
between grids are zero.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from middeck.files.nastran.components.direct_input import Lone
from middeck.files.nastran.deck.coordinates import Places
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.masses_and_springs.bodies import Mass, mass_of_matrix
from middeck.files.nastran.masses_and_springs.ties import Tie
from middeck.files.toml.faults import Fault

# Of the roots of two diagonals: printed digits of matrices that others assembled.
UNEQUAL = 1e-6
# The same of what may be left of a grid's own block where nothing holds it to the ground.
LEFT = 1e-7


def direct_ties(lone: Lone, places: Places, faults: list[Fault]) -> list[Tie]:
    """Bushings of a stiffness that stands alone; appends to ``faults`` one that is no sum of such."""
    grids, own = lone.grids, [lone.block(k, k) for k in range(len(lone.grids))]
    own = [block.copy() for block in own]
    found: list[Tie] = []
    for i, a in enumerate(grids):
        for j, b in enumerate(grids[i + 1 :], i + 1):
            coupling = lone.block(i, j)
            if not np.any(coupling):
                continue
            carried = _carried(places.grids[b] - places.grids[a])
            K = -np.linalg.solve(carried.T, coupling)
            if not _is_stiffness(K, lone.size(j)):
                faults.append(_no_sum(lone, f"what grids {a} and {b} do to each other is no stiffness"))
                return []
            own[i] -= carried.T @ K @ carried
            own[j] -= K
            found.append(_tie(lone, (a, b), (places.grids[b],) * 2, K))
    for k, grid in enumerate(grids):
        size = lone.size(k)
        if np.all(np.abs(own[k]) <= LEFT * np.outer(size, size)):
            continue
        if not _is_stiffness(own[k], size):
            faults.append(_no_sum(lone, f"what holds grid {grid} is no stiffness"))
            return []
        found.append(_tie(lone, (grid,), (places.grids[grid],), own[k]))
    return found


def direct_masses(lone: Lone, places: Places, weight: float, faults: list[Fault]) -> Iterator[Mass]:
    """Bodies of a mass that stands alone, over the factor ``weight`` of other masses (WTMASS)."""
    for i, a in enumerate(lone.grids):
        for j, b in enumerate(lone.grids[:i]):
            if np.any(lone.block(i, j)):
                what = f"a mass between grids {b} and {a} without a stiffness is not converted"
                faults.append(lone.entry.fault(what, hint="K2GG beside it"))
                return
        try:
            yield mass_of_matrix(lone.block(i, i) / weight, a, places.grids[a], np.eye(3))
        except ValueError as error:
            faults.append(lone.entry.fault(f"grid {a}: {error}"))


def _carried(arm: np.ndarray) -> np.ndarray:
    """Motion of a point at ``arm`` from one that moves as a rigid body."""
    x, y, z = arm
    out = np.eye(6)
    out[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return out


def _is_stiffness(K: np.ndarray, size: np.ndarray) -> bool:
    scaled = np.divide(K, np.outer(size, size), out=np.zeros((6, 6)), where=np.outer(size, size) > 0.0)
    whole = np.abs(K[scaled == 0.0]).max(initial=0.0) <= UNEQUAL * np.abs(K).max()
    return bool(
        whole
        and np.abs(scaled - scaled.T).max() <= UNEQUAL
        and np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0] >= -UNEQUAL
    )


def _tie(lone: Lone, grids: tuple[int, ...], points: tuple[np.ndarray, ...], K: np.ndarray) -> Tie:
    entry = lone.entry
    named = Entry(entry.name, (f"{entry.id}_{'_'.join(map(str, grids))}", *entry.values[1:]), entry.card)
    values, vectors = np.linalg.eigh(0.5 * (K + K.T))
    return Tie(named, grids, points, np.eye(3), (vectors * np.maximum(values, 0.0)) @ vectors.T)


def _no_sum(lone: Lone, what: str) -> Fault:
    hint = "M2GG beside it, or the matrix of a part that is no reduction"
    return lone.entry.fault(f"a stiffness without a mass is converted as bushings, and {what}", hint=hint)
