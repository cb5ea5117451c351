"""The stiffness with which a member's end, or a tie, resists the motions of its grid; directions without any.

Programs hold these by themselves (PARAM AUTOSPC), judging the shifts and the turns of each grid apart.
"""

from collections.abc import Collection, Iterable, Mapping

import numpy as np

from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.masses_and_springs.spring_elements import Tie
from middeck.files.nastran.members.members import Bar, own_axes

NOTHING = 1e-9  # zero stiffness, over a grid's largest, shifts and turns apart


def is_firm(bar: Bar) -> bool:
    """Whether both ends of a bar resist all motions, and its pins release none."""
    cuts = [cut for _, cut in bar.section.stations.cuts]
    resists = all(cut.i1 > 0.0 and cut.i2 > 0.0 and cut.j > 0.0 for cut in cuts)
    return resists and bar.section.material.G > 0.0 and not any(map(bar.released, (0, 1)))


def loose_ways(K: np.ndarray, components: str, held: str, axes: np.ndarray) -> np.ndarray:
    """Directions without stiffness among those that are not held; the axes themselves where all are.

    ``components`` names the three shifts or turns to which ``K`` (3, 3) belongs.
    """
    free = axes[:, [c not in held for c in components]]
    size, ways = np.linalg.eigh(free.T @ K @ free)
    loose = free @ ways[:, size <= NOTHING * np.abs(K).max()]
    return free if loose.shape == free.shape else loose


def loose_shifts(
    grids: Iterable[int],
    bars: Collection[Bar],
    ties: Iterable[Tie],
    held: Mapping[int, str],
    carriers: Mapping[int, int],
    places: GridPlaces,
) -> list[int]:
    """Those of ``grids`` that nothing holds against shifts in some direction normal to what is ``held``."""
    firm = {carriers.get(grid, grid) for bar in bars if is_firm(bar) for grid in bar.grids}
    stiffness = {grid: np.zeros((3, 3)) for grid in grids if grid not in firm}
    for bar in bars:
        ends = [carriers.get(grid, grid) for grid in bar.grids]
        if firm.issuperset(ends):
            continue
        for grid, K in zip(ends, end_stiffness(bar), strict=True):
            if grid in stiffness:
                stiffness[grid] += K[:3, :3]
    for tie in ties:
        for grid in (carriers.get(grid, grid) for grid in tie.grids):
            if grid in stiffness:
                stiffness[grid] += tie.axes @ tie.stiffness[:3, :3] @ tie.axes.T
    return [
        grid
        for grid, K in stiffness.items()
        if loose_ways(K, "123", held.get(grid, ""), places.displacement_axes(grid)).size
    ]


def end_stiffness(bar: Bar) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness (6, 6) of each end of a bar whose other end is held, in basic coordinates; shear left out.

    The motions that the pins of both ends release are left out.
    """
    cut, material, L = bar.section.first, bar.section.material, bar.length
    along = (bar.ends[1] - bar.ends[0]) / L
    if not (cut.i1 or cut.i2):
        line = np.outer(along, along) / L
        K = np.zeros((6, 6))
        K[:3, :3], K[3:, 3:] = material.E * cut.area * line, material.G * cut.j * line
        return K, K
    lengths = np.tile([1.0 / L] * 3 + [1.0] * 3, 2)
    K = np.outer(lengths, lengths) * (material.E / L * (cut.i1 * BENDS[0] + cut.i2 * BENDS[1]))
    K += material.E * cut.area / L * STRETCH + material.G * cut.j / L * TWIST
    axes = own_axes(along, bar.up)
    if bar.section.angle:
        K = _turned(K, bar.element_axes.T @ axes)
        axes = bar.element_axes
    for free in (int(c) - 1 + 6 * k for k in (0, 1) for c in bar.released(k)):
        K -= np.outer(K[free], K[free]) / (K[free, free] or 1.0)
    return _turned(K[:6, :6], axes), _turned(K[6:, 6:], axes)


def _turned(K: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """A stiffness between shifts and turns in other axes, whose directions in the new ones are ``axes``."""
    turn = np.kron(np.eye(len(K) // 3), axes)
    return turn @ K @ turn.T


def _between(first: int, second: int) -> np.ndarray:
    """A unit spring between two of the twelve motions of a bar's ends."""
    row = np.zeros(12)
    row[[first, second]] = -1.0, 1.0
    return np.outer(row, row)


def _bends(shift: int, turn: int, sign: float) -> np.ndarray:
    """Bending in one plane of a bar of unit length and stiffness, by the turns of its ends off the chord."""
    off = np.zeros((2, 12))
    off[:, [shift, shift + 6]] = 1.0, -1.0
    off[[0, 1], [turn, turn + 6]] = sign
    return off.T @ [[4.0, 2.0], [2.0, 4.0]] @ off


STRETCH, TWIST = _between(0, 6), _between(3, 9)
BENDS = _bends(1, 5, 1.0), _bends(2, 4, -1.0)
