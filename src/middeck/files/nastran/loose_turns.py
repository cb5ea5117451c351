"""Rotations of a deck's grids that nothing holds, such as those of hinges in a truss of rods.

Programs hold them by themselves (PARAM AUTOSPC): no stiffness, no load path. Here they become clamps of the
environment, along the directions in which the grid's own block of the stiffness matrix is zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from middeck.files.nastran.coordinates import Places
from middeck.files.nastran.members import Bar, own_axes
from middeck.files.nastran.sections_of_bars import principal_axes
from middeck.files.nastran.ties import Tie

NOTHING = 1e-9  # of a grid's largest rotational stiffness


def loose_turns(
    kept: Iterable[int],
    bars: Iterable[Bar],
    ties: Iterable[Tie],
    held: Mapping[int, str],
    carriers: Mapping[int, int],
    places: Places,
) -> dict[int, np.ndarray]:
    """Orthonormal directions, in basic coordinates, of the turns that nothing holds, as columns, by grid.

    They are square to those that ``held``, the components of constraints, holds.
    """
    stiffness = {grid: np.zeros((3, 3)) for grid in kept}
    firm: set[int] = set()
    bars = list(bars)
    for bar in bars:
        shape = bar.section.shape
        if shape.i1 > 0.0 and shape.i2 > 0.0 and shape.j > 0.0 and bar.section.material.G > 0.0:
            firm.update(carriers.get(grid, grid) for grid in bar.grids)
    for bar in bars:
        for end, (grid, place) in enumerate(zip(bar.grids, bar.ends, strict=True)):
            carrier = carriers.get(grid, grid)
            if carrier not in firm:
                stiffness[carrier] += _about(_end_stiffness(bar, end), place - places.grids[carrier])
    for tie in ties:
        turn = np.kron(np.eye(2), tie.axes)
        for grid, point in zip(tie.grids, tie.points, strict=True):
            carrier = carriers.get(grid, grid)
            own = turn @ np.diag(tie.stiffness) @ turn.T
            stiffness[carrier] += _about(own, point - places.grids[carrier])
    found: dict[int, np.ndarray] = {}
    for grid, K in stiffness.items():
        axes = places.displacement_axes(grid)
        free = axes[:, [c not in held.get(grid, "") for c in "456"]]
        if grid in firm or not free.size:
            continue
        size, turns = np.linalg.eigh(free.T @ K @ free)
        loose = free @ turns[:, size <= NOTHING * np.abs(K).max()]
        if loose.shape[1] == free.shape[1]:
            loose = free
        if loose.size:
            found[grid] = loose
    return found


def turn_clamp(grid: int, turns: np.ndarray) -> dict[str, object]:
    """The clamp that holds these turns of a grid, in an environment's form."""
    count = turns.shape[1]
    axes = np.linalg.qr(np.column_stack([turns, np.eye(3)]))[0]
    axes[:, :count] = turns
    return {
        "node": f"g{grid}",
        "along": "",
        "about": "xyz"[:count],
        "x_axis": axes[:, 0],
        "y_axis": axes[:, 1],
    }


def _end_stiffness(bar: Bar, end: int) -> np.ndarray:
    """Stiffness (6, 6) of one end of a bar whose other end is held, in basic coordinates; shear left out."""
    shape, material, L = principal_axes(bar.section)[0], bar.section.material, bar.length
    K = np.zeros((6, 6))
    K[0, 0], K[3, 3] = material.E * shape.area / L, material.G * shape.j / L
    for v, turn, i, sign in ((1, 5, shape.i1, 1.0), (2, 4, shape.i2, -1.0)):
        pair = np.array([[12.0 / L**2, 6.0 * sign / L], [6.0 * sign / L, 4.0]])
        if end:
            pair[[0, 1], [1, 0]] *= -1.0
        K[np.ix_([v, turn], [v, turn])] = material.E * i / L * pair
    turn = np.kron(np.eye(2), own_axes(bar.ends[1] - bar.ends[0], bar.up))
    return turn @ K @ turn.T


def _about(K: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Rotational stiffness (3, 3) at a grid of what has stiffness ``K`` (6, 6) at ``arm`` from it."""
    x, y, z = arm
    T = np.vstack([[[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], np.eye(3)])
    return T.T @ K @ T
