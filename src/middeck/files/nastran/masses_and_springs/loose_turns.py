"""Rotations of a deck's grids that nothing holds, such as those of hinges in a truss of rods.

Programs hold them by themselves (PARAM AUTOSPC): no stiffness, no load path. Here they become clamps of the
environment, along the directions in which the grid's own block of the stiffness matrix is zero.
"""

from collections.abc import Collection, Container, Iterable, Mapping

import numpy as np

from middeck.files.nastran.deck.coordinates import Places
from middeck.files.nastran.masses_and_springs.spring_elements import Tie, arm_from
from middeck.files.nastran.members.members import Bar, own_axes
from middeck.structure.model.connectivity import separate_parts

NOTHING = 1e-9  # of a grid's largest rotational stiffness


def loose_turns(
    kept: Iterable[int],
    bars: Collection[Bar],
    ties: Iterable[Tie],
    turning: Container[int],
    held: Mapping[int, str],
    carriers: Mapping[int, int],
    places: Places,
) -> dict[int, np.ndarray]:
    """Orthonormal directions, in basic coordinates, of the turns that nothing holds, as columns, by grid.

    They are square to those that ``held``, the components of constraints, holds. Grids in ``turning`` have
    inertia. Where hinges without inertia only twist each other, by rods with a torsion constant, all turn
    freely together: no stiffness of a single grid shows it, and no shift depends on it.
    """
    firm = {
        carriers.get(grid, grid)
        for bar in bars
        if _is_firm(bar) and not any(map(bar.released, (0, 1)))
        for grid in bar.grids
    }
    stiffness = {grid: np.zeros((3, 3)) for grid in kept if grid not in firm}
    alive = {grid for grid in stiffness if grid in turning}
    twists: list[tuple[str, str]] = []
    for bar in bars:
        shape = bar.section.first
        ends = [carriers.get(grid, grid) for grid in bar.grids]
        for end, (grid, place) in enumerate(zip(ends, bar.ends, strict=True)):
            if grid in firm:
                continue
            arm = arm_from(places.grids[grid], place)
            stiffness[grid] += _about(_end_stiffness(bar, end), arm)
            twisted = shape.j > 0.0 and ends[1 - end] in firm
            bears = (shape.i1 > 0.0 or shape.i2 > 0.0 or twisted) and not _is_hinged(bar, end)
            if bears or arm.any():
                alive.add(grid)
        if shape.j > 0.0 and not firm.intersection(ends) and not any(map(bar.released, (0, 1))):
            twists.append((f"{ends[0]}", f"{ends[1]}"))
    for tie in ties:
        turn = np.kron(np.eye(2), tie.axes)
        for grid, point in zip([carriers.get(g, g) for g in tie.grids], tie.points, strict=True):
            if grid not in firm:
                own = _about(turn @ tie.stiffness @ turn.T, arm_from(places.grids[grid], point))
                stiffness[grid] += own
                alive |= {grid} if own.any() else set()
    for part in separate_parts([f"{grid}" for grid in stiffness], twists):
        if alive.isdisjoint(map(int, part)):
            stiffness.update({int(grid): np.zeros((3, 3)) for grid in part})
    found = {
        grid: _loose(K, held.get(grid, ""), places.displacement_axes(grid)) for grid, K in stiffness.items()
    }
    return {grid: turns for grid, turns in found.items() if turns.size}


def _is_hinged(bar: Bar, end: int) -> bool:
    """Whether pins let an end turn in every direction."""
    return set("456") <= set(bar.released(end))


def _is_firm(bar: Bar) -> bool:
    """Whether both ends of a bar resist all turns."""
    resists = all(cut.i1 > 0.0 and cut.i2 > 0.0 and cut.j > 0.0 for _, cut in bar.section.stations.cuts)
    return resists and bar.section.material.G > 0.0


def _loose(K: np.ndarray, held: str, axes: np.ndarray) -> np.ndarray:
    """Turns without stiffness among those that are not held; the axes themselves where all are."""
    free = axes[:, [c not in held for c in "456"]]
    size, turns = np.linalg.eigh(free.T @ K @ free)
    loose = free @ turns[:, size <= NOTHING * np.abs(K).max()]
    return free if loose.shape == free.shape else loose


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
    """Stiffness (6, 6) of one end of a bar whose other end is held, in basic coordinates; shear left out.

    Without what the pins of both ends release.
    """
    cut, material, L = bar.section.first, bar.section.material, bar.length
    K = np.zeros((12, 12))
    for way, stiffness in ((0, material.E * cut.area), (3, material.G * cut.j)):
        K[np.ix_([way, way + 6], [way, way + 6])] = stiffness / L * np.array([[1.0, -1.0], [-1.0, 1.0]])
    for v, turn, i, sign in ((1, 5, cut.i1, 1.0), (2, 4, cut.i2, -1.0)):
        bends = np.array(
            [[1.0 / L, sign, -1.0 / L, 0.0], [1.0 / L, 0.0, -1.0 / L, sign]]
        )  # turns off the chord
        ends = [v, turn, v + 6, turn + 6]
        K[np.ix_(ends, ends)] = material.E * i / L * bends.T @ [[4.0, 2.0], [2.0, 4.0]] @ bends
    principal = own_axes(bar.ends[1] - bar.ends[0], bar.up)
    K = _turned(K, bar.element_axes.T @ principal)
    for k in (int(c) - 1 + 6 * k for k in (0, 1) for c in bar.released(k)):
        K -= np.outer(K[k], K[k]) / (K[k, k] or 1.0)
    own = slice(6 * end, 6 * end + 6)
    return _turned(K[own, own], bar.element_axes)


def _turned(K: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """A stiffness between shifts and turns in other axes, whose directions in the new ones are ``axes``."""
    turn = np.kron(np.eye(len(K) // 3), axes)
    return turn @ K @ turn.T


def _about(K: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Rotational stiffness (3, 3) at a grid of what has stiffness ``K`` (6, 6) at ``arm`` from it."""
    x, y, z = arm
    T = np.vstack([[[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], np.eye(3)])
    return T.T @ K @ T
