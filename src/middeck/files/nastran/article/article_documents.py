"""The documents of an article and of what holds it, in SI units, from the parts of a deck that stand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from middeck.files.nastran.article.grounded_grids import ground_clamps, loose_clamps
from middeck.files.nastran.article.loads import LoadSets
from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.nodes_and_springs import (
    carried_points,
    node_tables,
    rider_links,
    scalar_tables,
    spring_tables,
)
from middeck.files.nastran.article.parts import Basis, DeckParts, LeftOut
from middeck.files.nastran.article.struts import pin_tables, strut_tables
from middeck.files.nastran.deck.deck import Deck
from middeck.structure.model.component import Component
from middeck.values import record


@record(kw_only=True)
class StandingDeck:
    """The parts of a deck that stand, and the grids that stand for the ``ground``; what is left out of it."""

    basis: Basis
    parts: DeckParts
    standing: Standing
    ground: frozenset[int]
    notes: list[str]
    left_out: list[LeftOut]


@record(kw_only=True)
class Documents:
    """Documents of an article and an environment.

    ``coordinates`` is how many degrees of freedom the article has, ``clamped`` how many grids are held;
    ``refused`` has what is left out of loads and gravity.
    """

    article: dict[str, Any]
    environment: dict[str, Any]
    coordinates: int
    clamped: int
    notes: list[str]
    refused: list[LeftOut]


def write_documents(name: str, settled: StandingDeck, components: Mapping[str, Component]) -> Documents:
    """Both documents; ``components``, by their files, stand on grids of the deck."""
    basis, parts, standing = settled.basis, settled.parts, settled.standing
    sets = LoadSets(basis, parts, standing, settled.ground)
    cases = sets.cases(basis.units)
    members, member_notes = _members(basis, parts, standing)
    points, bushings, grounds = spring_tables(basis, parts, standing)
    single, scalars = scalar_tables(basis, parts)
    clamps = ground_clamps(basis, parts, standing)
    loose, unheld = loose_clamps(basis, parts, standing)
    springs = grounds + single.grounds
    constants, gravity = sets.constants(bool(clamps or springs))
    modal = sum(part.modal for part in components.values())
    article = members | {
        "node": members["node"] + single.nodes,
        "attach": carried_points(basis, standing) + points + single.attach,
        "bushing": bushings + single.bushings,
        "component": _component_tables(components),
        "load_case": cases,
    }
    environment = {"constants": constants, "clamp": clamps + loose + single.clamps, "bushing": springs}
    return Documents(
        article=_filled(_head(name, basis.deck, sets.down()) | article),
        environment=_filled({"schema": 1, "name": f"{name}-supports"} | environment),
        coordinates=6 * len(members["node"]) + len(single.nodes) + modal,
        clamped=len(clamps),
        notes=[*member_notes, *scalars, *unheld, *gravity],
        refused=sets.refused,
    )


def _members(basis: Basis, parts: DeckParts, standing: Standing) -> tuple[dict[str, Any], list[str]]:
    """Tables of members with their nodes and bodies, and of what links these, with notes on them."""
    sections, struts, tapers = strut_tables(basis, parts, standing)
    pinned, pins = pin_tables(basis, parts, standing)
    nodes, rotors = node_tables(basis, standing)
    tables = {
        "section": sections,
        "node": nodes + pinned,
        "strut": struts,
        "link": rider_links(standing) + _tables(standing, "link") + pins,
        **{kind: _tables(standing, kind) for kind in ("interpolation", "equation")},
    }
    return tables, [*tapers, *rotors]


def _head(name: str, deck: Deck, down: np.ndarray | None) -> dict[str, Any]:
    title = f"{name} (from {deck.path.rsplit('/', 1)[-1]})"
    up = [] if down is None else (-down + 0.0).tolist()
    return {"schema": 1, "name": name, "title": title, "up": up, "mesh": {"elements_per_strut": 1}}


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
    """The document without empty tables, and without keys that have no value."""
    return {key: value for key, value in document.items() if value not in ([], {})}
