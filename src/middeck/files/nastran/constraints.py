"""Constraints of a deck as links of an article: RBE3, RBE2 and RBAR of some components, the selected MPC."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any, NamedTuple

import numpy as np

from middeck.files.faults import Fault
from middeck.files.nastran.coordinates import Places
from middeck.files.nastran.deck import Deck
from middeck.files.nastran.entries import Entry
from middeck.files.nastran.numbers import integer, real
from middeck.files.nastran.rigid_links import ALL, expand, partial_links
from middeck.structure.model.clamps import LETTERS

# Directions of an equation's terms, shifts and turns in W.
WAYS = ("x", "y", "z", "rx", "ry", "rz")
# Of a direction cosine: what rounding leaves of none.
SQUARE = 1e-14


class Constraint(NamedTuple):
    """One constraint: the kind of its table in an article, that table, and what depends by which field.

    It means nothing where a grid of ``defines`` carries nothing else.
    """

    kind: str
    table: dict[str, Any]
    entry: Entry
    key: str
    grids: tuple[int, ...]
    dependent: tuple[tuple[int, str], ...]
    defines: tuple[int, ...]


def read_constraints(deck: Deck, places: Places, faults: list[Fault]) -> list[Constraint]:
    """All constraints, whether they mean anything or not; appends to ``faults`` what is wrong."""
    found = [
        *_averages(deck, places, faults),
        *_links(deck, places, faults),
        *_equations(deck, places, faults),
    ]
    absent = [(c, g) for c in found for g in c.grids if g not in places.grids]
    faults += [c.entry.fault(f"there is no grid {grid}", c.key) for c, grid in absent]
    return found


def that_matter(constraints: list[Constraint], used: Container[int]) -> list[Constraint]:
    """Those that do more than say how a grid moves on which nothing stands."""
    while True:
        kept = [
            c
            for c in constraints
            if all(
                g in used or any(g in o.grids and g not in o.defines for o in constraints if o is not c)
                for g in c.defines
            )
        ]
        if len(kept) == len(constraints):
            return kept
        constraints = kept


def check_dependent(
    constraints: list[Constraint], carriers: dict[int, int], held: dict[int, str], faults: list[Fault]
) -> None:
    """Appends to ``faults`` what depends twice, or depends and is held."""
    first: dict[tuple[int, str], Constraint] = {}
    for c in constraints:
        for grid, component in c.dependent:
            what = f"component {component} of grid {grid}"
            other = first.setdefault((grid, component), c)
            if grid in carriers:
                faults.append(c.entry.fault(f"{what} depends on grid {carriers[grid]} already", c.key))
            elif other is not c:
                _, file, line = other.entry.card.line()
                at = f"{other.entry.label} at {file}:{line}"
                faults.append(c.entry.fault(f"{what} is dependent twice; first by {at}", c.key))
            elif component in held.get(grid, ""):
                faults.append(c.entry.fault(f"{what} is dependent and held by the ground", c.key))
            else:
                continue
            break


def _letters(components: str) -> dict[str, str]:
    along, about = (
        "".join(letter for letter, digit in zip(LETTERS, digits, strict=True) if digit in components)
        for digits in ("123", "456")
    )
    return {"along": along, "about": about}


def _directions(places: Places, grid: int, components: str) -> dict[str, Any]:
    axes = places.displacement_axes(grid) if grid in places.grids else np.eye(3)
    return {**_letters(components), "x_axis": axes[:, 0], "y_axis": axes[:, 1]}


def _averages(deck: Deck, places: Places, faults: list[Fault]) -> Iterator[Constraint]:
    for entry in deck.entries.of("RBE3"):
        at, components, shares = entry["refgrid"], entry["refc"], list[dict[str, Any]]()
        groups = _weights(entry, faults)
        for weight, moves, grids in groups:
            shares += [{"frame": f"g{g}", "weight": weight, **_directions(places, g, moves)} for g in grids]
        grids = (at, *(g for _, _, found in groups for g in found))
        if len(set(grids)) < len(grids):
            faults.append(entry.fault("a grid is named twice, which is not converted", "rest"))
        table = {"name": f"rbe3_{entry.id}", "frame": f"g{at}", **_directions(places, at, components)}
        table["follows"] = shares
        depends = tuple((at, c) for c in components)
        yield Constraint("interpolation", table, entry, "refgrid", grids, depends, (at,))


def _weights(entry: Entry, faults: list[Fault]) -> list[tuple[float, str, list[int]]]:
    """Weight, components and grids of each group; how dependent ones are chosen (UM) changes nothing."""
    texts = [text for text in entry["rest"] if text is not None]
    for mark in ("UM", "ALPHA"):
        if mark in texts:
            texts = texts[: texts.index(mark)]
    starts = [i for i, text in enumerate(texts) if integer(text) is None and real(text) is not None]
    if not starts or starts[0] != 0:
        faults.append(entry.fault("the first weight is missing", "rest"))
        return []
    found: list[tuple[float, str, list[int]]] = []
    for start, end in zip(starts, [*starts[1:], len(texts)], strict=True):
        weight, moves = real(texts[start]), texts[start + 1] if start + 1 < end else ""
        if weight is None or not weight > 0.0 or not moves or set(moves) - set(ALL) or end < start + 3:
            faults.append(entry.fault("a group is a weight > 0, components and grids", "rest"))
            return []
        found.append((weight, moves, expand(entry, texts[start + 2 : end], "rest", faults)))
    return found


def _links(deck: Deck, places: Places, faults: list[Fault]) -> Iterator[Constraint]:
    for entry, key, carrier, grid, components in partial_links(deck.entries, faults):
        table = {"name": f"{entry.name.lower()}_{entry.id}_g{grid}", "from": f"g{carrier}", "to": f"g{grid}"}
        table |= _directions(places, grid, components)
        depends = tuple((grid, c) for c in components)
        yield Constraint("link", table, entry, key, (carrier, grid), depends, (grid,))


def _equations(deck: Deck, places: Places, faults: list[Fault]) -> Iterator[Constraint]:
    count: dict[int, int] = {}
    for entry in deck.selected("MPC"):
        number = count[entry.id] = count.get(entry.id, 0) + 1
        terms = _terms(entry, faults)
        total: dict[tuple[int, str], float] = {}
        for grid, component, factor in terms:
            axes = places.displacement_axes(grid) if grid in places.grids else np.eye(3)
            way = int(component) - 1
            for k, cosine in enumerate(axes[:, way % 3].tolist()):
                if abs(cosine) > SQUARE:
                    direction = grid, WAYS[k + 3 * (way // 3)]
                    total[direction] = total.get(direction, 0.0) + factor * cosine
        if terms:
            rows = [{"frame": f"g{g}", "direction": w, "coefficient": a} for (g, w), a in total.items()]
            grids = tuple(dict.fromkeys(grid for grid, _, _ in terms))
            table = {"name": f"mpc{entry.id}_{number}", "term": rows}
            yield Constraint("equation", table, entry, "terms", grids, ((terms[0][0], terms[0][1]),), grids)


def _terms(entry: Entry, faults: list[Fault]) -> list[tuple[int, str, float]]:
    """Grid, component and factor of each term: two in a line, its first and last fields blank."""
    texts = [entry.id, *entry["terms"]]
    found: list[tuple[int, str, float]] = []
    for start in range(0, len(texts), 8):
        line = [*texts[start : start + 8], *([None] * 7)]
        for three in (line[1:4], line[4:7]):
            if three == [None] * 3:
                continue
            grid, component, factor = integer(three[0] or ""), three[1] or "", real(three[2] or "")
            if grid is None or component not in tuple(ALL) or factor is None:
                faults.append(entry.fault(f"{three} is no grid, component 1 to 6 and factor", "terms"))
                return []
            found.append((grid, component, factor))
        if (start and line[0] is not None) or line[7] is not None:
            faults.append(entry.fault("the first and last fields of a line are blank", "terms"))
            return []
    if not found or found[0][2] == 0.0:
        faults.append(entry.fault("its first factor is zero or missing", "terms"))
        return []
    return found
