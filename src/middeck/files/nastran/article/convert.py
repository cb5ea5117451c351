"""From a deck to the documents of an article and of its supports, with a report on the cards."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from middeck.files.nastran.article.article_documents import Documents, StandingDeck, write_documents
from middeck.files.nastran.article.article_sections import Formulation
from middeck.files.nastran.article.floating_parts import check_whole
from middeck.files.nastran.article.ground_springs import ground_springs, idle_springs
from middeck.files.nastran.article.nodes_and_riders import find_standing
from middeck.files.nastran.article.parts import Basis, DeckParts, LeftOut, read_parts, set_out
from middeck.files.nastran.article.what_became_of_cards import (
    account_left_out,
    count_converted,
    note_warnings,
)
from middeck.files.nastran.components.direct_input import NAME
from middeck.files.nastran.deck.coordinates import place_grids
from middeck.files.nastran.deck.deck import Deck, reference_grid, weight_factor
from middeck.files.nastran.deck.units import Units
from middeck.files.nastran.members.sections_of_bars import read_material
from middeck.structure.model.component import Component
from middeck.values import record


@record(kw_only=True)
class Conversion:
    """An article's document, and what became of the cards.

    ``environment`` is the document of an environment: the deck's supports, if any, and its gravity.
    ``read`` counts the cards whose fields were read; ``left_out`` has rows (card, how many, why);
    ``notes`` are sentences for the report, ``components`` what the document names, by file; ``reference`` is
    the grid (0: the origin) about which the deck wants its mass, and where it is [m].
    """

    document: dict[str, Any]
    read: dict[str, int]
    converted: dict[str, int]
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]
    environment: dict[str, Any]
    components: dict[str, Component] = dataclasses.field(default_factory=dict)
    reference: tuple[int, np.ndarray] | None = None

    @property
    def holds(self) -> bool:
        """Whether the ground holds the deck anywhere."""
        return "clamp" in self.environment or "bushing" in self.environment


def materials_and_size(deck: Deck) -> tuple[list[tuple[float, float]], float]:
    """Young's modulus and density (times PARAM WTMASS) of each MAT1, and the extent, in the deck's units."""
    places = place_grids(deck.entries).grids
    factor = weight_factor(deck)
    x = np.array(list(places.values())).reshape(-1, 3)
    size = float(np.linalg.norm(np.ptp(x, axis=0))) if len(x) else 0.0
    materials: list[tuple[float, float]] = []
    for card in deck.entries.of("MAT1"):
        try:
            material = read_material(card)
        except ValueError:
            continue
        materials.append((material.E, factor * material.rho))
    return materials, size


def convert_deck(
    deck: Deck,
    units: Units,
    formulation: Formulation,
    name: str,
    components: Mapping[str, Component] | None = None,
) -> Conversion:
    """The article that ``deck`` describes, in SI units, its members' mass by ``formulation``.

    ``components`` stand on its grids, see `read_assembly`, by the names of the files that they will be in.

    ``consistent`` is middeck's own (with rotary inertia), ``coupled`` the coupled bar mass of MSC and NX
    Nastran (`MemberMass.COUPLED`, no rotary nor torsional inertia), ``lumped`` halves at the ends of each
    member. Raises `ConfigError` with all that cannot be represented and would change the modes.
    """
    lacking = list(deck.lacking())
    basis = set_out(deck, units, formulation)
    parts = read_parts(basis, [] if components else lacking)
    direct = {} if parts.direct is None else {f"{name}-{NAME}.npz": parts.direct}
    components = {**(components or {}), **direct}
    settled = _settle(basis, parts, list(components.values()))
    made = write_documents(name, settled, components)
    reference, lost = _reference(basis)
    notes = [f"{fault.place}: {fault.what}" for fault in lacking]
    notes += note_warnings(basis, settled.parts, made.coordinates)
    return Conversion(
        document=made.article,
        read={card: len(found) for card, found in deck.entries.by_name.items()},
        converted=_count(settled, made),
        left_out=(*settled.left_out, *_left_out(settled, made), *made.refused),
        notes=(*notes, *settled.notes, *made.notes, *lost),
        environment=made.environment,
        components=components,
        reference=reference,
    )


def _settle(basis: Basis, parts: DeckParts, components: list[Component]) -> StandingDeck:
    """The converted parts, and the held grids; raises `ConfigError` if they are not one structure."""
    left_out: list[LeftOut] = []
    standing = find_standing(basis, parts, components, left_out)
    idle = idle_springs(basis, parts, standing)
    check_whole(basis, idle.parts, idle.standing)
    grounded = ground_springs(basis, idle.parts, idle.standing)
    ground, notes = idle.grids | grounded.grids, idle.notes + grounded.notes
    return StandingDeck(
        basis=basis,
        parts=grounded.parts,
        standing=grounded.standing,
        ground=ground,
        notes=notes,
        left_out=left_out,
    )


def _count(settled: StandingDeck, made: Documents) -> dict[str, int]:
    """Cards and what became of them, by name."""
    return count_converted(settled.basis, settled.parts, settled.standing) | {
        "clamped grids": made.clamped,
        "springs to the ground": len(made.environment.get("bushing", ())),
        "load cases": len(made.article.get("load_case", ())),
        "gravity": int("constants" in made.environment),
    }


def _left_out(settled: StandingDeck, made: Documents) -> list[LeftOut]:
    """Cards that the documents have no part for, and what holds grids that are not there."""
    rows = account_left_out(settled.basis, settled.parts, settled.standing)
    idle = len(settled.parts.held) - made.clamped - len(settled.ground)
    return rows + ([("SPC, PS", idle, "at grids without an element or a mass")] if idle else [])


def _reference(basis: Basis) -> tuple[tuple[int, np.ndarray] | None, list[str]]:
    """The grid of PARAM GRDPNT and its place [m], and a note on one that is not there."""
    grid = reference_grid(basis.deck)
    if grid is None:
        return None, []
    at = basis.places.grids.get(grid)
    if at is not None:
        return (grid, basis.units.length * at), []
    lost = [f"PARAM GRDPNT names grid {grid}, which is not there: the mass is about the origin"]
    return (0, np.zeros(3)), lost if grid else []
