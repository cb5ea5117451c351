"""Decks that join external superelements (SEBULK, SECONCT, BEGIN SUPER) as articles with components."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from middeck.errors import ConfigError
from middeck.files.faults import Fault
from middeck.files.nastran.cards import Card
from middeck.files.nastran.case_control import Selection, read_selection
from middeck.files.nastran.convert import Conversion, Formulation, convert_deck
from middeck.files.nastran.coordinates import Places
from middeck.files.nastran.deck import Deck
from middeck.files.nastran.entries import raise_some, read_entries
from middeck.files.nastran.external import Bulk, component_of, geometry_of, has_card, read_bulk
from middeck.files.nastran.formats import IDLE, PARSED
from middeck.files.nastran.numbers import integer, real
from middeck.files.nastran.units import Units
from middeck.structure.model.component import Component

_ASSIGN = re.compile(r"ASSIGN\s+INPUTT4\s*=\s*['\"]?([^'\",]+)['\"]?[^\n]*?UNIT\s*=\s*(\d+)", re.IGNORECASE)
ELEMENTS = ("CBAR", "CBEAM", "CROD", "CONROD", "CONM1", "CONM2", "CELAS1", "CELAS2", "CBUSH")
LINKS = ("RBE2", "RBE3", "RBAR")
OWN = ("SEBULK", "SECONCT")
# Of the size: grids that are joined by place.
NEAR = 1e-5


class AssemblyConversion(NamedTuple):
    """`Conversion` of a deck with superelements, and the components by the names of files to be written."""

    conversion: Conversion
    components: dict[str, Component]


def has_superelements(path: str | Path) -> bool:
    """Whether a deck's main bulk data have SEBULK; false for what cannot be read."""
    try:
        return has_card(path, "SEBULK")
    except ConfigError:
        return False


def convert_assembly(
    path: str | Path, units: Units, formulation: Formulation, name: str
) -> AssemblyConversion:
    """The article of a deck that joins external superelements, in SI units; members as in `convert_deck`.

    Matrices come from the OUTPUT4 files that ASSIGN INPUTT4 names (SEBULK EXTOP4), or from DMIG (EXTERNAL).
    Raises `ConfigError` or `DataError` for superelements of other types, reflected or moved ones, grids that
    SECONCT joins to none, and what `convert_deck` refuses.
    """
    bulk = read_bulk([path])
    places = geometry_of(bulk.main)
    files = _assigned(bulk, Path(path).parent)
    _check_cards(bulk)
    parts: dict[str, Component] = {}
    tables: list[dict[str, Any]] = []
    for card in bulk.main:
        if card.name != "SEBULK":
            continue
        number, matrices = _declared(card, bulk, files)
        part = component_of(bulk.supers[number], matrices, units, f"se{number}", str(path))
        file = f"{name}-se{number}.npz"
        joined = _joined(card, number, bulk, part, places, units)
        parts[file] = dataclasses.replace(part, frames=tuple(f"g{grid}" for grid in joined.values()))
        nodes = {grid: f"g{to}" for grid, to in joined.items()}
        tables.append({"name": f"se{number}", "file": file, "nodes": nodes})
    if not parts:
        raise ConfigError(
            "no SEBULK in the bulk data", where=str(path), hint="does all of it stand behind BEGIN BULK?"
        )
    loose = [number for number in bulk.supers if not any(t["name"] == f"se{number}" for t in tables)]
    if loose:
        first = (bulk.supers[loose[0]] or bulk.main)[0]
        raise_some([_fault(first, f"superelement {loose[0]} is joined by no SEBULK of the bulk data")])
    base = _base(path, bulk, units, formulation, name)
    document = dict(base.document)
    there = {node["name"] for node in document["node"]}
    wanted = dict.fromkeys(frame for part in parts.values() for frame in part.frames)
    document["node"] = [
        *document["node"],
        *(_node(frame, places, units) for frame in wanted if frame not in there),
    ]
    document["component"] = tables
    converted = {**base.converted, "superelements that are components": len(parts)}
    notes = (*base.notes, *(f"include not found before BEGIN BULK: {file}" for file in bulk.missing))
    return AssemblyConversion(base._replace(document=document, converted=converted, notes=notes), parts)


def _node(frame: str, places: Places, units: Units) -> dict[str, Any]:
    x = places.grids[int(frame[1:])] * units.length
    return {"name": frame, **{f"{axis}_m": float(value) for axis, value in zip("xyz", x, strict=True)}}


def _assigned(bulk: Bulk, folder: Path) -> dict[int, Path]:
    """OUTPUT4 files by unit; a line that ends with a comma goes on in the next."""
    text = re.sub(r",\s*\n\s*", ", ", "\n".join(line[0].rstrip() for line in bulk.head))
    return {int(unit): folder / file.strip() for file, unit in _ASSIGN.findall(text)}


def _fault(card: Card, message: str, hint: str = "", at: int = 0) -> Fault:
    _, file, line = card.line(at)
    return Fault(
        file=file,
        line=line,
        key=f"{card.name} {card.fields[0] if card.fields else ''}",
        message=message,
        hint=hint,
    )


def _check_cards(bulk: Bulk) -> None:
    moved = [card for card in bulk.main if card.name.startswith("SE") and card.name not in (*OWN, *IDLE)]
    raise_some(
        [_fault(card, "superelements that are moved, mirrored or nested are not read") for card in moved]
    )
    used = {g for cards in bulk.supers.values() for g in geometry_of(cards).grids}
    for card in bulk.main:
        if card.name not in LINKS:
            continue
        # Dependent grids: all but the independent one of RBE2 and RBAR, the reference of RBE3.
        dependent = {"RBE2": card.fields[3:], "RBAR": card.fields[2:3], "RBE3": card.fields[2:3]}[card.name]
        lost = [grid for grid in dependent if (integer(grid) or 0) in used]
        if lost:
            raise_some(
                [
                    _fault(
                        card, f"grid {lost[0]} of a superelement's boundary follows others: not converted yet"
                    )
                ]
            )


def _declared(card: Card, bulk: Bulk, files: dict[int, Path]) -> tuple[int, Path | None]:
    """Number of a superelement, and its OUTPUT4 file; None for matrices among its cards."""
    fields = [*card.fields, *[""] * 8]
    number, kind, reference = integer(fields[0]), fields[1], integer(fields[2]) or 0
    unit = integer(fields[6])
    faults: list[Fault] = []
    if number is None or number not in bulk.supers:
        faults.append(_fault(card, f"there is no BEGIN SUPER {fields[0]}"))
    if kind not in ("EXTOP4", "EXTERNAL") or reference:
        faults.append(
            _fault(
                card,
                f"a superelement of type {kind} of {reference or 'none'} is not read",
                "EXTOP4 or EXTERNAL",
            )
        )
    if kind == "EXTOP4" and (unit is None or unit not in files):
        known = ", ".join(f"{n}: {file.name}" for n, file in files.items()) or "none"
        faults.append(_fault(card, f"no ASSIGN INPUTT4 of unit {unit}; assigned are {known}"))
    raise_some(faults)
    assert number is not None
    return number, files[unit or 0] if kind == "EXTOP4" else None


def _joined(
    sebulk: Card, number: int, bulk: Bulk, part: Component, places: Places, units: Units
) -> dict[str, int]:
    """Main grid of each boundary grid: by SECONCT, or by place where SEBULK says AUTO."""
    pairs: dict[int, int] = {}
    for card in bulk.main:
        if card.name != "SECONCT" or number not in map(integer, card.fields[:2]):
            continue
        if sorted((integer(f) or 0) for f in card.fields[:2]) != [0, number]:
            raise_some([_fault(card, "joins two superelements directly: not read", "join both to grids")])
        turned = integer(card.fields[0]) != number
        listed = [field for field in card.fields[8:] if field]
        if "THRU" in listed or len(listed) % 2 or any(integer(f) is None for f in listed):
            raise_some([_fault(card, "no pairs of grids", "pairs, without THRU")])
        for a, b in zip(map(int, listed[::2]), map(int, listed[1::2]), strict=True):
            a, b = (b, a) if turned else (a, b)
            if pairs.setdefault(a, b) != b:
                raise_some([_fault(card, f"grid {a} is joined twice")])
    method = sebulk.fields[3] if len(sebulk.fields) > 3 else ""
    near = NEAR * max(1.0, float(np.abs(part.positions).max())) / units.length
    tolerance = (real(sebulk.fields[4]) or near) if len(sebulk.fields) > 4 else near
    out: dict[str, int] = {}
    for grid, x in zip(part.grids, part.positions / units.length, strict=True):
        to = pairs.get(int(grid))
        if to is None and method != "MANUAL":
            at = {g: float(np.linalg.norm(place - x)) for g, place in places.grids.items()}
            to = min(at, key=at.__getitem__, default=None)
            to = to if to is not None and at[to] <= tolerance else None
        if to is None or to not in places.grids:
            raise_some(
                [
                    _fault(
                        sebulk, f"boundary grid {grid} is joined to no grid of the main bulk data", "SECONCT"
                    )
                ]
            )
        out[grid] = to or 0
    return out


def _check_free(cards: list[Card], selection: Selection) -> None:
    """A clamp would stand at grids that the components share, which have no place in `convert_deck`."""
    hint = "leave it out, and clamp the nodes of the article in an environment"
    sets = [card for card in cards if card.name in ("SPC", "SPC1", "SPCADD")]
    held = [card for card in sets if selection.selects("SPC", integer(card.fields[0]) or 0)]
    held += [
        c for c in cards if c.name in ("GRID", "GRDSET") and "".join(c.fields[6:7]).strip() not in ("", "0")
    ]
    message = "a deck of superelements that the ground holds is not read"
    raise_some([_fault(card, message, hint) for card in held])


def _base(path: str | Path, bulk: Bulk, units: Units, formulation: Formulation, name: str) -> Conversion:
    """What stands beside the superelements; without elements, none of it is part of an article."""
    cards = [card for card in bulk.main if card.name not in OWN]
    cend = next((i for i, line in enumerate(bulk.head) if line[0].strip().upper() == "CEND"), len(bulk.head))
    selection = read_selection(bulk.head[cend + 1 :])
    _check_free(cards, selection)
    if any(card.name in ELEMENTS or (card.name not in PARSED and card.name not in IDLE) for card in cards):
        deck = Deck(str(path), selection, read_entries(cards), (), not bulk.head, len(cards))
        return convert_deck(deck, units, formulation, name)
    names = dict.fromkeys(card.name for card in cards)
    left = tuple(
        (n, sum(card.name == n for card in cards), "nothing but superelements has stiffness or mass")
        for n in names
        if n not in ("GRID", "CORD2R", "CORD2C", "CORD2S", "CORD1R", "CORD1C", "CORD1S")
    )
    document = {
        "schema": 1,
        "name": name,
        "title": f"{name} (from {Path(path).name})",
        "node": [],
    }
    return Conversion(
        document,
        {n: sum(c.name == n for c in bulk.main) for n in dict.fromkeys(c.name for c in bulk.main)},
        {},
        left,
        (),
        {},
    )
