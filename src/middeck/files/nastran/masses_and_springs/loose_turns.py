"""Rotations of a deck's grids that nothing holds, such as those of hinges in a truss of rods.

Programs hold them by themselves (PARAM AUTOSPC): no stiffness, no load path. Here they become clamps of the
environment, along the directions in which the grid's own block of the stiffness matrix is zero.
"""

from collections.abc import Collection, Container, Iterable, Mapping

import numpy as np

from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.masses_and_springs.spring_elements import Tie, arm_from
from middeck.files.nastran.masses_and_springs.stiffness_of_grids import end_stiffness, is_firm, loose_ways
from middeck.files.nastran.members.members import Bar
from middeck.structure.model.connectivity import separate_parts


def loose_turns(
    kept: Iterable[int],
    bars: Collection[Bar],
    ties: Iterable[Tie],
    turning: Container[int],
    held: Mapping[int, str],
    carriers: Mapping[int, int],
    places: GridPlaces,
) -> dict[int, np.ndarray]:
    """Orthonormal directions, in basic coordinates, of the turns that nothing holds, as columns, by grid.

    They are square to those that ``held``, the components of constraints, holds. Grids in ``turning`` have
    inertia. Where hinges without inertia only twist each other, by rods with a torsion constant, all turn
    freely together: no stiffness of a single grid shows it, and no shift depends on it.
    """
    firm = {carriers.get(grid, grid) for bar in bars if is_firm(bar) for grid in bar.grids}
    stiffness = {grid: np.zeros((3, 3)) for grid in kept if grid not in firm}
    alive = {grid for grid in stiffness if grid in turning}
    twists: list[tuple[str, str]] = []
    for bar in bars:
        shape = bar.section.first
        ends = [carriers.get(grid, grid) for grid in bar.grids]
        if firm.issuperset(ends):
            continue
        for end, (grid, place, K) in enumerate(zip(ends, bar.ends, end_stiffness(bar), strict=True)):
            if grid in firm:
                continue
            arm = arm_from(places.grids[grid], place)
            stiffness[grid] += _about(K, arm)
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
        grid: loose_ways(K, "456", held.get(grid, ""), places.displacement_axes(grid))
        for grid, K in stiffness.items()
    }
    return {grid: turns for grid, turns in found.items() if turns.size}


def _is_hinged(bar: Bar, end: int) -> bool:
    """Whether pins let an end turn in every direction."""
    return set("456") <= set(bar.released(end))


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


def _about(K: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Rotational stiffness (3, 3) at a grid of what has stiffness ``K`` (6, 6) at ``arm`` from it."""
    if not arm.any():
        return K[3:, 3:]
    x, y, z = arm
    T = np.vstack([[[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], np.eye(3)])
    return T.T @ K @ T
