"""From a deck to the document of an article: nodes, members, bodies and rigid links, in SI units."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from middeck.files.nastran.article.article_sections import Formulation
from middeck.files.nastran.article.floating_parts import check_whole
from middeck.files.nastran.article.ground_springs import ground_springs
from middeck.files.nastran.article.grounded_grids import ground_clamps, loose_clamps
from middeck.files.nastran.article.loads import LoadSets
from middeck.files.nastran.article.nodes import carried_points, node_tables, rider_links
from middeck.files.nastran.article.nodes_and_riders import Standing, find_standing
from middeck.files.nastran.article.parts import Basis, LeftOut, read_parts, set_out
from middeck.files.nastran.article.springs import scalar_tables, spring_tables
from middeck.files.nastran.article.struts import pin_tables, strut_tables
from middeck.files.nastran.article.what_became_of_cards import account_left_out, count_converted, note_doubts
from middeck.files.nastran.components.direct_input import NAME
from middeck.files.nastran.deck.coordinates import place_grids
from middeck.files.nastran.deck.deck import Deck, reference_grid, weight_factor
from middeck.files.nastran.deck.units import Units
from middeck.files.nastran.members.sections_of_bars import read_material
from middeck.structure.model.component import Component


class Conversion(NamedTuple):
    """An article's document, and what became of the cards.

    ``environment`` is the document of an environment: what holds the deck, if anything does, and its gravity.
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
    components: dict[str, Component] = {}  # noqa: RUF012 -- of a frozen tuple, never changed
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
    left_out: list[LeftOut] = []
    standing = find_standing(basis, parts, list(components.values()), left_out)
    check_whole(basis, parts, standing)
    parts, standing, ground, grounded = ground_springs(basis, parts, standing)
    sets = LoadSets(basis, parts, standing, ground)
    cases = sets.cases(units)

    sections, struts, tapers = strut_tables(basis, parts, standing)
    pinned, pins = pin_tables(basis, parts, standing)
    nodes, rotors = node_tables(basis, standing)
    points, bushings, grounds = spring_tables(basis, parts, standing)
    single, scalars = scalar_tables(basis, parts)
    clamps = ground_clamps(basis, parts, standing)
    loose, unheld = loose_clamps(basis, parts, standing)
    constants, gravity = sets.constants(bool(clamps or grounds or single.grounds))

    idle = len(parts.held) - len(clamps) - len(ground)
    left_out += account_left_out(basis, parts, standing)
    left_out += [("SPC, PS", idle, "at grids without an element or a mass")] if idle else []
    left_out += sets.refused
    converted = count_converted(basis, parts, standing)
    converted |= {
        "clamped grids": len(clamps),
        "springs to the ground": len(grounds + single.grounds),
        "load cases": len(cases),
        "gravity": min(len(constants), 1),
    }
    reference, lost = _reference(basis)
    coordinates = 6 * len(nodes + pinned) + len(single.nodes) + sum(c.modal for c in components.values())
    document = _head(name, deck, sets.down()) | {
        "section": sections,
        "node": nodes + pinned + single.nodes,
        "strut": struts,
        "attach": carried_points(basis, standing) + points + single.attach,
        "bushing": bushings + single.bushings,
        "component": _component_tables(components),
        "link": rider_links(standing) + _tables(standing, "link") + pins,
        **{kind: _tables(standing, kind) for kind in ("interpolation", "equation")},
        "load_case": cases,
    }
    return Conversion(
        document=_filled(document),
        read={card: len(found) for card, found in deck.entries.by_name.items()},
        converted=converted,
        left_out=tuple(left_out),
        notes=(
            *(f"{fault.place}: {fault.what}" for fault in lacking),
            *note_doubts(basis, parts, coordinates),
            *grounded,
            *tapers,
            *scalars,
            *unheld,
            *rotors,
            *gravity,
            *lost,
        ),
        environment=_supports(name, constants, clamps + loose + single.clamps, grounds + single.grounds),
        components=components,
        reference=reference,
    )


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


def _head(name: str, deck: Deck, down: np.ndarray | None) -> dict[str, Any]:
    title = f"{name} (from {deck.path.rsplit('/', 1)[-1]})"
    up = [] if down is None else -down + 0.0
    return {"schema": 1, "name": name, "title": title, "up": up, "mesh": {"elements_per_strut": 1}}


def _supports(
    name: str, constants: dict[str, Any], clamps: list[dict[str, Any]], bushings: list[dict[str, Any]]
) -> dict[str, Any]:
    found = {"schema": 1, "name": f"{name}-supports", "constants": constants or []}
    return _filled(found | {"clamp": clamps, "bushing": bushings})


def _component_tables(components: Mapping[str, Component]) -> list[dict[str, Any]]:
    return [
        {"name": part.name, "file": file, "nodes": dict(zip(part.grids, part.frames, strict=True))}
        | (
            {"offsets_m": dict(zip(part.grids, part.fixed_at.tolist(), strict=True))}
            if np.any(part.fixed_at)
            else {}
        )
        for file, part in components.items()
    ]


def _tables(standing: Standing, kind: str) -> list[dict[str, Any]]:
    return [c.table for c in standing.tied if c.kind == kind]


def _filled(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if not isinstance(value, list) or value}
