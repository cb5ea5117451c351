"""Supports of grids: the ground, and the environment in motions that nothing in the deck holds."""

from collections.abc import Container

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, DeckParts, Tables, turns
from middeck.files.nastran.constraints.constraints import joined_components
from middeck.files.nastran.constraints.restraints import clamp
from middeck.files.nastran.constraints.rigid_links import ALL
from middeck.files.nastran.masses_and_springs.loose_turns import loose_turns, turn_clamp
from middeck.files.nastran.masses_and_springs.stiffness_of_grids import loose_shifts
from middeck.structure.model.connectivity import some_names


def ground_clamps(basis: Basis, parts: DeckParts, standing: Standing) -> Tables:
    """Clamps of the nodes that the ground holds."""
    grids = basis.places.grids
    return [clamp(g, parts.held[g], basis.places) for g in grids if g in parts.held and g in standing.kept]


def loose_clamps(basis: Basis, parts: DeckParts, standing: Standing) -> tuple[Tables, list[str]]:
    """Clamps of shifts and rotations that nothing holds, as PARAM AUTOSPC does, and notes that name them."""
    grids = basis.places.grids
    joins = _joins(standing)
    taken = {grid: parts.held.get(grid, "") + joins.get(grid, "") for grid in standing.kept}
    # What constraints join is not loose; of grids on which nothing else stands all other motions are.
    shifts = {
        grid: "".join(sorted(set("123") - set(taken[grid])))
        for grid in grids
        if grid in standing.linked - standing.borne
    }
    shifts = {grid: components for grid, components in shifts.items() if components}
    turning = {grid for grid, body in standing.bodies.items() if turns(body)}
    turning |= {grid for grid, components in joins.items() if not set(components).isdisjoint("456")}
    found = loose_turns(
        standing.kept, parts.bars, parts.ties, turning, taken, standing.carriers, basis.places
    )
    loose = {grid: found[grid] for grid in grids if grid in found}
    clamps = [clamp(grid, components, basis.places) for grid, components in shifts.items()]
    clamps += [turn_clamp(grid, directions) for grid, directions in loose.items()]
    notes = [
        f"nothing holds {what} of grid {some_names([f'{g}' for g in which])}: the environment holds them, "
        "as PARAM AUTOSPC does"
        for what, which in (("rotations", loose), ("shifts", shifts))
        if which
    ]
    return clamps, notes + _free_shifts(parts, standing, taken, shifts, basis)


def _free_shifts(
    parts: DeckParts, standing: Standing, taken: dict[int, str], shifts: Container[int], basis: Basis
) -> list[str]:
    """A note on shifts without stiffness: weight and pull may hold them here, so that no clamp does."""
    places = basis.places
    grids = [grid for grid in places.grids if grid in standing.kept and grid not in shifts]
    found = loose_shifts(grids, parts.bars, parts.ties, taken, standing.carriers, places)
    named = some_names([f"{grid}" for grid in found])
    what = (
        "no stiffness in some direction, and is free in it; the deck's own program holds it by PARAM AUTOSPC"
    )
    return [f"grid {named} has {what}: an SPC does the same here"] if found else []


def _joins(standing: Standing) -> dict[int, str]:
    """Components of each grid that constraints, rigid links and components join."""
    components = {grid for grids in standing.joined for grid in grids}
    whole = dict.fromkeys({*components, *standing.riders, *standing.riders.values()}, ALL)
    return joined_components(standing.tied) | whole
