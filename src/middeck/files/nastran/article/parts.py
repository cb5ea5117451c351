"""The parts of a deck that an article can have, in units of the deck and basic axes."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from middeck.files.nastran.article.article_sections import Formulation
from middeck.files.nastran.components.direct_input import direct_component, lone_matrix
from middeck.files.nastran.constraints.constraints import Constraint, read_constraints, term_rows
from middeck.files.nastran.constraints.restraints import read_restraints
from middeck.files.nastran.deck.coordinates import GridPlaces, place_grids
from middeck.files.nastran.deck.deck import Deck, weight_factor
from middeck.files.nastran.deck.entries import Entries, Entry, raise_some
from middeck.files.nastran.deck.nastran_numbers import integer
from middeck.files.nastran.deck.units import Units
from middeck.files.nastran.masses_and_springs.bodies import (
    Mass,
    read_masses,
    read_scalar_masses,
    scalar_masses,
)
from middeck.files.nastran.masses_and_springs.direct_matrices import direct_masses, direct_ties
from middeck.files.nastran.masses_and_springs.scalars import (
    WAY,
    Element,
    held_points,
    read_elements,
    scalar_points,
    tie_terms,
)
from middeck.files.nastran.masses_and_springs.spring_elements import Tie, read_ties
from middeck.files.nastran.members.members import Bar, read_bars
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.component import Component
from middeck.values import record

LeftOut = tuple[str, int, str]
Tables = list[dict[str, Any]]


class Basis(NamedTuple):
    """The common basis of a conversion: the deck, its units and places, the mass of its members."""

    deck: Deck
    units: Units
    formulation: Formulation
    places: GridPlaces

    @property
    def entries(self) -> Entries:
        """The cards of the deck."""
        return self.deck.entries

    @property
    def mass_unit(self) -> float:
        """Kilograms of one unit of mass, after the deck's factor of weights."""
        return self.units.mass * weight_factor(self.deck)


@record(kw_only=True)
class DeckParts:
    """The parts read from a deck; ``held`` are the components of grids that the ground holds."""

    bars: list[Bar]
    masses: list[Mass]
    ties: list[Tie]
    scalars: list[Element]
    constraints: list[Constraint]
    held: dict[int, str]
    direct: Component | None


def set_out(deck: Deck, units: Units, formulation: Formulation) -> Basis:
    """The basis of a conversion; raises `ConfigError` if a grid names a system that is not there."""
    basis = Basis(deck, units, formulation, place_grids(deck.entries))
    unknown = (
        entry.fault(f"there is no coordinate system {entry['cd']}", "cd")
        for entry in deck.entries.of("GRDSET", "GRID")
        if (entry["cd"] or 0) not in basis.places.systems
    )
    raise_some(list(unknown))
    return basis


def read_parts(basis: Basis, faults: list[DocumentFault]) -> DeckParts:
    """Every part of the deck; raises `ConfigError` with ``faults`` and all that is wrong in any."""
    deck, places, entries = basis.deck, basis.places, basis.entries
    bars = read_bars(entries, places, faults)
    masses = read_masses(entries, places, faults)
    points = scalar_points(entries, places, faults)
    held = read_restraints(deck, places, points, faults)
    properties = scalar_masses(entries, faults)
    still = held_points(deck, points, faults)
    scalars = _scalars(basis, points, properties, (held, still), faults)
    direct = direct_component(deck, basis.units, faults)
    lone = lone_matrix(deck, faults)
    read = read_constraints(deck, places, points, still, faults)
    constraints = [_in_metres(c, basis.units) for c in read]
    ties = read_ties(entries, places, points, held, faults)
    masses += read_scalar_masses(entries, places, points, held, linked_grids(entries), properties, faults)
    if lone is not None and lone.what == "stiffness":
        ties += direct_ties(lone, places, faults)
    elif lone is not None:
        masses += direct_masses(lone, places, weight_factor(deck), faults)
    if direct is not None and direct.modal and scalars:
        what = "matrices by direct input have scalar points of their own: not converted yet beside them"
        faults.append(scalars[0].entry.fault(what))
    raise_some(faults)
    constraints += [_tied(element, basis) for element in scalars if element.has_node]
    return DeckParts(
        bars=bars,
        masses=masses,
        ties=ties,
        scalars=scalars,
        constraints=constraints,
        held=held,
        direct=direct,
    )


def linked_grids(entries: Entries) -> set[int]:
    """Grids that rigid links name."""
    return {grid for entry in entries.of("RBE2", "RBAR") for grid in grids_named(entry)}


def grids_named(entry: Entry) -> list[int]:
    """Grids that one rigid link names."""
    if entry.name == "RBAR":
        return [entry["ga"], entry["gb"]]
    return [entry["gn"], *(n for n in map(integer, filter(None, entry["gm"])) if n)]


# Relative rounding of a place that is computed as a sum.
ROUNDING = 1e-12


def turns(body: Mass) -> bool:
    """Whether the body has inertia beyond the rounding of its place."""
    return bool(np.abs(body.inertia).max() > body.mass * reach(body) ** 2)


def reach(body: Mass) -> float:
    """Rounding of the place of the body's centre."""
    return ROUNDING * float(np.linalg.norm(body.centre))


def _scalars(
    basis: Basis,
    points: dict[int, Entry],
    masses: dict[int, float],
    held: tuple[dict[int, str], set[int]],
    faults: list[DocumentFault],
) -> list[Element]:
    """Springs and masses with scalar points that are free to move."""
    values = {"PELAS": {e.id: e["k"] for e in basis.entries.of("PELAS")}, "PMASS": masses}
    return read_elements(basis.entries, points, basis.places, values, held, faults)


def _tied(element: Element, basis: Basis) -> Constraint:
    """The equation that moves an element's own node as what it sees of grids and scalar points."""
    terms: list[dict[str, Any]] = []
    for node, end, factor in tie_terms(element):
        if end is None:
            terms.append({"frame": node, "direction": WAY, "coefficient": factor})
        else:
            terms += _scaled(term_rows(basis.places, [(end[0], f"{end[1]}", factor)]), basis.units)
    moves = tuple((grid, f"{component}") for grid, component in element.grids)
    return Constraint(
        kind="equation",
        table={"name": element.name, "term": terms},
        entry=element.entry,
        key="g1",
        moves=moves,
        dependent=(),
        defines=(),
    )


def _in_metres(constraint: Constraint, units: Units) -> Constraint:
    if constraint.kind != "equation" or not constraint.table:
        return constraint
    return dataclasses.replace(
        constraint, table=constraint.table | {"term": _scaled(constraint.table["term"], units)}
    )


def _scaled(terms: list[dict[str, Any]], units: Units) -> list[dict[str, Any]]:
    """Factors of turns of grids times the length unit: shifts are in metres, and scalar points."""
    return [
        term | {"coefficient": term["coefficient"] * units.length}
        if term["frame"][0] == "g" and term["direction"][0] == "r"
        else term
        for term in terms
    ]
