"""Decks that join external superelements (SEBULK, SECONCT, BEGIN SUPER): the components, and the rest."""

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from middeck.errors import ConfigError
from middeck.files.nastran.components.external import (
    GEOMETRY,
    Bulk,
    component_of,
    geometry_of,
    read_bulk,
)
from middeck.files.nastran.components.printed import NEAR
from middeck.files.nastran.deck.cards import Card
from middeck.files.nastran.deck.case_control import read_selection
from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.deck.deck import Deck
from middeck.files.nastran.deck.deck_lines import Lines, fault_on
from middeck.files.nastran.deck.entries import raise_some, read_entries
from middeck.files.nastran.deck.known_cards import IDLE, PLACED, PLACING
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.nastran.deck.units import Units
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.component import Component

_ASSIGN = re.compile(r"ASSIGN\s+INPUTT4\s*=\s*['\"]?([^'\",]+)['\"]?[^\n]*?UNIT\s*=\s*(\d+)", re.IGNORECASE)
OWN = ("SEBULK", "SECONCT")
# What a superelement's own section may hold beside idle cards: all else would change it.
SETS = tuple(f"{kind}SET{end}" for kind in "ABCQ" for end in ("", "1"))
PROPERTIES = ("PBAR", "PBARL", "PBEAM", "PBEAML", "PROD", "PTUBE", "PELAS", "PBUSH", "PMASS", "MAT1")
WITHIN = frozenset(("EXTRN", "DMIG", "SPOINT", "PARAM", "EIGR", "EIGRL", *GEOMETRY, *SETS, *PROPERTIES))
# Largest distance of grids that are joined where TOL gives none [units of the deck].
TOL = 1e-5
# Distance, over the size, below which places are the same: rounding.
SAME = 1e-12
# Relative difference of modal masses that is none: printed digits.
MODAL = 1e-5
LONGEST = 100_000  # points in a range


def has_superelements(path: str | Path) -> bool:
    """Whether a line of a deck or its includes begins with SEBULK; false for what cannot be read."""
    try:
        return any(line[0].lstrip().upper().startswith("SEBULK") for line in Lines(Path(path)).lines)
    except ConfigError:
        return False


def read_assembly(
    path: str | Path, units: Units, name: str, subcase: int | None = None
) -> tuple[Deck, dict[str, Component]]:
    """Parts beside the superelements of a deck, for `convert_deck`, and these by files to be written.

    Matrices come from the OUTPUT4 files that ASSIGN INPUTT4 names (SEBULK EXTOP4), or from DMIG (EXTERNAL).
    Raises `ConfigError` or `DataError` for superelements of other types, reflected or moved ones, and grids
    that SECONCT joins to none.
    """
    bulk = read_bulk([path])
    places = geometry_of(bulk.main)
    files = _assigned(bulk, Path(path).parent)
    raise_some([*_unread(bulk)])
    parts: dict[str, Component] = {}
    for card in bulk.main:
        if card.name != "SEBULK":
            continue
        number, matrices = _declared(card, bulk, files)
        part = component_of(bulk.supers[number], matrices, units, f"se{number}", str(path))
        near = _tolerance(part, units, card)
        joins = [c for c in bulk.main if c.name == "SECONCT" and number in map(integer, c.fields[:2])]
        joined = _joined(card, number, joins, part, places, near, units)
        apart = part.positions - units.length * np.array([places.grids[grid] for grid in joined.values()])
        at_most = max(near, *(_tolerance(part, units, join) for join in joins)) if joins else near
        by = _moved_by(apart, at_most * units.length)
        part = parts[f"{name}-se{number}.npz"] = _fixed(part, joined, apart + by, at_most, units)
        bulk.notes.extend((*_scaled(part, units), *_moved(part, by, units), *_bridged(part, units)))
    if not parts:
        raise ConfigError(
            "no SEBULK in the bulk data", where=str(path), hint="does all of it stand behind BEGIN BULK?"
        )
    loose = [number for number in bulk.supers if f"{name}-se{number}.npz" not in parts]
    if loose:
        first = (bulk.supers[loose[0]] or bulk.main)[0]
        raise_some([_fault(first, f"superelement {loose[0]} is joined by no SEBULK of the bulk data")])
    cend = next((i for i, line in enumerate(bulk.head) if line[0].strip().upper() == "CEND"), len(bulk.head))
    cards = [card for card in bulk.main if card.name not in OWN]
    selection = read_selection(bulk.head[cend + 1 :], subcase)
    entries, notes = read_entries(cards), tuple(bulk.notes)
    return Deck(
        path=str(path),
        selection=selection,
        entries=entries,
        notes=notes,
        bulk_only=not bulk.head,
        cards=len(bulk.main),
        unended=bulk.unended,
    ), parts


def _fixed(
    part: Component, joined: dict[str, int], apart: np.ndarray, near: float, units: Units
) -> Component:
    """The component on the grids that it is ``joined`` to, by offsets where these stand ``near`` its own,
    ``apart`` from them.

    Grids that stand elsewhere are left to the checks of the article.
    """
    far = float(np.linalg.norm(apart, axis=1).max())
    offsets = apart if SAME * np.abs(part.positions).max() < far <= near * units.length else None
    return dataclasses.replace(part, frames=tuple(f"g{grid}" for grid in joined.values()), offsets=offsets)


def _moved_by(apart: np.ndarray, near: float) -> np.ndarray:
    """Mean translation of a component to the grids that it joins; zero if all are within ``near`` [m]."""
    stays = np.linalg.norm(apart, axis=1).max() <= near
    return np.zeros(3) if stays else -apart.mean(axis=0)


def _moved(part: Component, by: np.ndarray, units: Units) -> Iterator[str]:
    """A note on a component that all its grids take elsewhere."""
    if np.any(by):
        rounding = NEAR * max(np.abs(by).max(), np.abs(part.positions).max())
        listed = ", ".join(f"{x:.6g}" for x in np.where(np.abs(by) > rounding, by, 0.0) / units.length)
        yield f"{part.name} is moved by ({listed}) ({units.name}) to the grids that it is joined to"


def _bridged(part: Component, units: Units) -> Iterator[str]:
    """A note on grids that stand beside those that they are joined to."""
    far = np.linalg.norm(part.fixed_at, axis=1) / units.length
    if np.any(far):
        worst = int(np.argmax(far))
        yield (
            f"grid {part.grids[worst]} of {part.name} is joined to {part.frames[worst]} over a distance of "
            f"{far[worst]:.2g} ({units.name}), the most of its grids: printed digits?"
        )


def _scaled(part: Component, units: Units) -> Iterator[str]:
    """A note where all modal masses, which Nastran writes as one in its own units, are another number."""
    modal = np.diagonal(part.mass)[6 * len(part.grids) :] / (units.mass * units.length**2)
    if len(modal) and abs(modal[0] - 1.0) > MODAL and np.abs(modal - modal[0]).max() <= MODAL * abs(modal[0]):
        yield (
            f"{part.name} has modal masses of {modal[0]:.6g}, Nastran writes 1: is its mass a weight "
            "(386.1, 9.81), or are its matrices in units other than the deck's? Frequencies would be wrong"
        )


def _unread(bulk: Bulk) -> Iterator[DocumentFault]:
    """Cards that place superelements, and what stands within them beside their matrices."""
    for card in (*bulk.main, *(card for cards in bulk.supers.values() for card in cards)):
        if card.name in PLACING:
            yield _fault(card, f"{PLACING[card.name]}, which is not read", PLACED)
    for number, cards in bulk.supers.items():
        for card in cards:
            if card.name not in (*IDLE, *WITHIN):
                what = f"in superelement {number}, of which its matrices alone are read"
                yield _fault(card, what, "put it into the matrices, or into the main bulk data")


def _assigned(bulk: Bulk, folder: Path) -> dict[int, Path]:
    """OUTPUT4 files by unit; a line that ends with a comma goes on in the next."""
    text = re.sub(r",\s*\n\s*", ", ", "\n".join(line[0].rstrip() for line in bulk.head))
    return {int(unit): folder / file.strip() for file, unit in _ASSIGN.findall(text)}


def _fault(card: Card, message: str, hint: str = "", at: int = 0) -> DocumentFault:
    key = f"{card.name} {card.fields[0] if card.fields else ''}"
    return fault_on(card.line(at), key, message, hint=hint)


def _declared(card: Card, bulk: Bulk, files: dict[int, Path]) -> tuple[int, Path | None]:
    """Number of a superelement, and its OUTPUT4 file; None for matrices among its cards."""
    fields = [*card.fields, *[""] * 8]
    number, kind, reference = integer(fields[0]), fields[1], integer(fields[2]) or 0
    unit = integer(fields[6])
    faults: list[DocumentFault] = []
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
        hint = f"ASSIGN INPUTT4='FILE.op4',UNIT={unit} before SOL"
        faults.append(_fault(card, f"no ASSIGN INPUTT4 of unit {unit}; assigned are {known}", hint))
    raise_some(faults)
    assert number is not None
    return number, files[unit or 0] if kind == "EXTOP4" else None


def _ranges(card: Card, listed: list[str]) -> Iterator[tuple[range, range]]:
    """Points of both sides that ``listed`` fields join one by one: pairs, or ``a THRU b c THRU d``."""
    while listed:
        step = 3 if listed[1:2] == ["THRU"] else 1
        texts, listed = listed[: 2 * step], listed[2 * step :]
        places = (0, 2, 3, 5) if step == 3 else (0, 0, 1, 1)
        ends = [integer(texts[i]) or 0 for i in places if i < len(texts)]
        if len(ends) < 4 or min(ends) <= 0 or (step == 3 and texts[4] != "THRU"):
            raise_some([_fault(card, "no pairs of grids", "pairs, or a THRU b with c THRU d")])
        first, second = range(ends[0], ends[1] + 1), range(ends[2], ends[3] + 1)
        if not 0 < len(first) == len(second) <= LONGEST:
            raise_some([_fault(card, "THRU over unequal or backward ranges", "as many points on both sides")])
        yield first, second


def _stated_tolerance(card: Card) -> float:
    """TOL of a SEBULK or SECONCT [units of the deck]."""
    field = [*card.fields, *[""] * 5][4 if card.name == "SEBULK" else 2]
    given = real(field) if field else TOL
    if given is None or not given >= 0.0:
        raise_some([_fault(card, f"TOL = {field} is no distance", "a number of zero or more")])
    return given or 0.0


def _tolerance(part: Component, units: Units, card: Card) -> float:
    """Largest distance [units of the deck] of grids that a SEBULK or SECONCT joins: TOL, or by digits."""
    return max(TOL, NEAR * float(np.abs(part.positions).max()) / units.length, _stated_tolerance(card))


def _joined(
    sebulk: Card,
    number: int,
    joins: list[Card],
    part: Component,
    places: GridPlaces,
    near: float,
    units: Units,
) -> dict[str, int]:
    """Main grid of each boundary grid: by SECONCT, or by place where SEBULK says AUTO."""
    pairs: dict[int, int] = {}
    for card in joins:
        if sorted((integer(f) or 0) for f in card.fields[:2]) != [0, number]:
            raise_some([_fault(card, "joins two superelements directly: not read", "join both to grids")])
        turned = integer(card.fields[0]) != number
        listed, found = [field for field in card.fields[8:] if field], list[tuple[int, int]]()
        own = set(map(int, part.grids))
        for first, second in _ranges(card, listed):
            one, other = (second, first) if turned else (first, second)
            if not own.isdisjoint(one) and not own.issuperset(one):
                raise_some([_fault(card, "THRU over numbers that are no boundary grids", "pairs of grids")])
            found += zip(one, other, strict=True)
        for a, b in found:
            if pairs.setdefault(a, b) != b:
                raise_some([_fault(card, f"grid {a} is joined twice")])
    method = sebulk.fields[3] if len(sebulk.fields) > 3 else ""
    out: dict[str, int] = {}
    for grid, x in zip(part.grids, part.positions / units.length, strict=True):
        to = pairs.get(int(grid))
        if to is None and method != "MANUAL":
            to = _at_place(sebulk, grid, x, places, near)
            if to in out.values():
                raise_some([_fault(sebulk, f"two boundary grids stand at grid {to}", "SECONCT")])
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


def _at_place(sebulk: Card, grid: str, x: np.ndarray, places: GridPlaces, near: float) -> int | None:
    """The main grid that stands at ``x`` within TOL or, by digits, ``near``; of several none is the one."""
    apart = {g: float(np.linalg.norm(place - x)) for g, place in places.grids.items()}
    stated = _stated_tolerance(sebulk)
    reach = stated if min(apart.values(), default=np.inf) <= stated else near
    there = [g for g, distance in apart.items() if distance <= reach]
    if len(there) > 1:
        several = ", ".join(map(str, there[:4]))
        raise_some([_fault(sebulk, f"boundary grid {grid} stands at several grids: {several}", "SECONCT")])
    return there[0] if there else None
