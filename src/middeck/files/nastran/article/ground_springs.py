"""Springs to grids that stand for the ground: SPC or PS hold these, and nothing but springs is on them.

Many decks write a spring to the ground so, instead of with a blank GB. It belongs to the set-up of a test,
not to the article, and its axes are those of the ground, whichever grid its card names first.
"""

import dataclasses
from collections.abc import Container
from itertools import compress
from typing import NamedTuple

import numpy as np

from middeck.files.nastran.article.floating_parts import find_pieces
from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, DeckParts
from middeck.files.nastran.constraints.rigid_links import ALL
from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.masses_and_springs.direct_matrices import carried_motion
from middeck.files.nastran.masses_and_springs.spring_elements import Tie, arm_from
from middeck.structure.model.connectivity import some_names

NOTHING = 1e-9  # zero stiffness, over a spring's largest, shifts and turns apart
STAY = "they stay in the article, where a bushing's axes turn with its first grid"
TO_GROUND = "they are springs to the ground, in the environment, and their axes do not turn"


class Grounded(NamedTuple):
    """Parts and standing without the ``grids`` that stand for the ground; notes on springs at held grids."""

    parts: DeckParts
    standing: Standing
    grids: frozenset[int]
    notes: list[str]


class _Ends(NamedTuple):
    """Ends of springs (spring, which end, grid that carries it), and sets of these grids.

    ``bare`` ones are held, carry springs alone and are in no rigid connection; at those ``partly`` held the
    springs resist components that the ground does not hold.
    """

    ends: list[tuple[Tie, int, int]]
    bare: set[int]
    partly: set[int]
    loaded: set[int]

    def note(self, grids: set[int], how: str, what: str, but: Container[str] = ()) -> list[str]:
        """A note on the springs at some grids, ``but`` those."""
        found = [(tie.name, grid) for tie, _, grid in self.ends if grid in grids and tie.name not in but]
        springs = list(dict.fromkeys(name for name, _ in found))
        numbers = some_names([f"{grid}" for grid in sorted({grid for _, grid in found})])
        return [f"{some_names(springs)}: SPC or PS hold {how}grid {numbers}{what}"] if found else []


def idle_springs(basis: Basis, parts: DeckParts, standing: Standing) -> Grounded:
    """The deck without springs of which SPC or PS hold all ends, and the grids that have no others."""
    found = _find_ends(basis, parts, standing)
    held = found.bare - found.partly
    idle = [tie for tie in parts.ties if {*map(standing.carrier, tie.grids)} <= held]
    names = list(dict.fromkeys(tie.name for tie in idle))
    moving = [tie for tie in parts.ties if tie.name not in names]
    unmet = held - {standing.carrier(grid) for tie in moving for grid in tie.grids}
    notes = [f"{some_names(names)}: left out, SPC or PS hold all of its ends"] if names else []
    rest = dataclasses.replace(parts, ties=moving)
    return Grounded(*_without(rest, standing, unmet), frozenset(unmet), notes)


def ground_springs(basis: Basis, parts: DeckParts, standing: Standing) -> Grounded:
    """Springs to held grids as springs to the ground, where nothing else is on the grid or rigid with it.

    All motions of such a grid that its springs resist must be held. Springs that alone join the pieces of the
    deck are unchanged.
    """
    found = _find_ends(basis, parts, standing)
    firm = {grid for _, _, grid in found.ends if parts.held.get(grid) == ALL}
    ground = found.bare - found.partly
    alone = _joining(basis, parts, standing, ground)
    ground = ground - alone
    grounded = {tie.name for tie, _, grid in found.ends if grid in ground}
    notes = [
        *found.note(ground, "", f", where nothing else stands; {TO_GROUND}"),
        *found.note(found.partly, "only part of what they resist at ", f"; {STAY}", grounded),
        *found.note(firm & found.loaded, "", f", where more than springs stands; {STAY}", grounded),
        *found.note(alone, "", f", which alone joins the deck; {STAY}", grounded),
    ]
    return Grounded(*_without(parts, standing, ground), frozenset(ground), notes)


def _find_ends(basis: Basis, parts: DeckParts, standing: Standing) -> _Ends:
    on = standing.carrier
    ends = [(tie, k, on(grid)) for tie in parts.ties for k, grid in enumerate(tie.grids)]
    loaded = standing.linked | {*standing.riders.values(), *standing.bodies}
    loaded |= {on(grid) for bar in parts.bars for grid in bar.grids}
    bare = {grid for _, _, grid in ends if grid in parts.held} - loaded
    partly = {grid for tie, k, grid in ends if grid in bare and _resists(tie, k, grid, parts, basis.places)}
    return _Ends([end for end in ends if len(end[0].grids) > 1], bare, partly, loaded)


def _without(parts: DeckParts, standing: Standing, ground: set[int]) -> tuple[DeckParts, Standing]:
    """The deck without the grids of the ``ground``; springs between two of them are none."""
    moves = [[standing.carrier(grid) not in ground for grid in tie.grids] for tie in parts.ties]
    ties = [
        dataclasses.replace(
            tie, grids=tuple(compress(tie.grids, some)), points=tuple(compress(tie.points, some))
        )
        for tie, some in zip(parts.ties, moves, strict=True)
        if any(some)
    ]
    less = dataclasses.replace(standing, kept=standing.kept - ground, borne=standing.borne - ground)
    return dataclasses.replace(parts, ties=ties), less


def _joining(basis: Basis, parts: DeckParts, standing: Standing, ground: set[int]) -> set[int]:
    """The grids of ``ground`` that join pieces of the deck: all of them where their springs do in a chain."""
    on = standing.carrier
    pieces = find_pieces(basis, *_without(parts, standing, ground))
    piece = {name: i for i, names in enumerate(pieces) for name in names}
    met: dict[int, set[int]] = {}
    for ends in (set(map(on, tie.grids)) for tie in parts.ties):
        for grid in ends & ground:
            met.setdefault(grid, set()).update(piece[f"{other}"] for other in ends - ground)
    joining = {grid for grid, some in met.items() if len(some) > 1}
    whole = len(find_pieces(basis, *_without(parts, standing, ground - joining))) == 1
    return joining if whole else ground


def _resists(tie: Tie, end: int, grid: int, parts: DeckParts, places: GridPlaces) -> bool:
    """Whether a spring resists a component, not held, of the grid that carries its ``end``."""
    arm = arm_from(places.grids[grid], tie.points[end])
    axes = np.kron(np.eye(2), places.displacement_axes(grid))
    turn = np.kron(np.eye(2), tie.axes)
    carried = carried_motion(arm) @ axes
    size = np.diagonal(carried.T @ turn @ tie.stiffness @ turn.T @ carried).reshape(2, 3)
    resisted = (size > NOTHING * size.max(axis=1, keepdims=True)).ravel()
    return any(some and digit not in parts.held[grid] for some, digit in zip(resisted, ALL, strict=True))
