"""External superelements in a deck: their cards, and their matrices in OUTPUT4 or as punched DMIG.

EXTSEOUT writes three files a component: matrices (`.op4`, or DMIG in the punch file), cards for its own BEGIN
SUPER section (`.pch`: EXTRN, boundary grids, ASET, SPOINT, DTI) and for the main bulk data (`.asm`: SEBULK,
SECONCT). EXTRN has the order of rows: grids with their components, then the scalar points of modal
coordinates.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from middeck.errors import ConfigError, DataError
from middeck.files.nastran.components.printed import as_printed
from middeck.files.nastran.deck.cards import Card, join_cards
from middeck.files.nastran.deck.coordinates import GridPlaces, place_grids
from middeck.files.nastran.deck.deck_lines import Line, Lines, raise_at
from middeck.files.nastran.deck.entries import ALL, read_entries
from middeck.files.nastran.deck.nastran_numbers import count_digits, integer, real, rounding_of
from middeck.files.nastran.deck.units import Units
from middeck.structure.model.component import ROUNDING, UNEQUAL, Component
from middeck.values import record

BARE = Units("", 1.0, 1.0, 1.0)  # units of the deck itself

# Names of stiffness, mass, viscous and structural damping in what programs write.
NAMES = {
    "stiffness": ("KXX", "KAAX", "KAA"),
    "mass": ("MXX", "MAAX", "MAA"),
    "damping": ("BXX1", "BXX", "BAAX", "BAA"),
    "structural damping": ("K4XX1", "K4XX", "K4AAX", "K4AA"),
}
GEOMETRY = ("GRID", "GRDSET", "CORD1R", "CORD2R", "CORD1C", "CORD2C", "CORD1S", "CORD2S")
# Rounding of a printed matrix in basic axes, with that of its grids' places and axes, over its own.
NOISE = 10.0
_SUPER = re.compile(r"\s*BEGIN(?:\s+BULK)?\s+SUPER\s*=?\s*(\d+)\s*$", re.IGNORECASE)
_BULK = re.compile(r"\s*BEGIN(\s*[,=]?\s*BULK)?\s*$", re.IGNORECASE)


@record(kw_only=True)
class Bulk:
    """Cards of the main bulk data and of each superelement by number; lines before BEGIN BULK.

    ``notes`` are those on includes; ``unended`` is the last line where ENDDATA lacks.
    """

    head: list[Line]
    main: list[Card]
    supers: dict[int, list[Card]]
    notes: list[str]
    unended: Line | None


def read_bulk(paths: Sequence[str | Path]) -> Bulk:
    """Bulk data of several files one after the other, with included files, sorted by superelement.

    A file without BEGIN BULK is bulk data from its first line. Raises `ConfigError` for files that cannot be
    read and includes in bulk data that are not there.
    """
    head: list[Line] = []
    main: list[Line] = []
    supers: dict[int, list[Line]] = {}
    notes: list[str] = []
    unended: Line | None = None
    for path in paths:
        reader = Lines(Path(path))
        lines, begins = reader.lines, reader.begins
        notes += reader.notes
        unended = reader.unended
        bulk = [at for at in begins if _BULK.match(lines[at][0])]
        before = head if bulk else main
        before += lines[: (*begins, len(lines))[0]]
        for start, end in pairwise((*begins, len(lines))):
            found = _SUPER.match(lines[start][0])
            if not found and start not in bulk:
                raise_at(
                    lines[start], "", "no BEGIN BULK or BEGIN SUPER with a number", lines[start][0].strip()
                )
            into = supers.setdefault(int(found[1]), []) if found else main
            into += lines[start + 1 : end]
    parts = {n: join_cards(found) for n, found in supers.items()}
    return Bulk(head=head, main=join_cards(main), supers=parts, notes=notes, unended=unended)


class Boundary(NamedTuple):
    """Coordinates of a component in their order: grids with their components, then scalar points."""

    grids: tuple[int, ...]
    components: tuple[str, ...]
    scalars: tuple[int, ...]

    @property
    def size(self) -> int:
        """Rows of its matrices."""
        return sum(map(len, self.components)) + len(self.scalars)


def read_external(
    cards: Sequence[str | Path],
    matrices: str | Path | None,
    units: Units,
    *,
    number: int | None = None,
    name: str = "component",
) -> Component:
    """The component of one superelement, in SI units, its grids named by their numbers.

    Args:
        cards: Files with its cards, such as the punch file.
        matrices: Its OUTPUT4 file; None where DMIG among the cards hold them.
        units: Units of the deck.
        number: Number of the superelement, where the cards are those of several.
        name: Name of the component.

    Raises `ConfigError` or `DataError` with file and line for cards or matrices that do not fit.
    """
    bulk = read_bulk(cards)
    if number is None and len(bulk.supers) > 1:
        raise ConfigError(
            f"cards of superelements {', '.join(map(str, bulk.supers))}",
            where=str(cards[0]),
            hint="say which",
        )
    own = (
        bulk.supers.get(number, bulk.main)
        if number is not None
        else next(iter(bulk.supers.values()), bulk.main)
    )
    if matrices is None and all(card.name != "DMIG" for card in own):  # in a file of their own
        own = own + [card for card in bulk.main if card.name == "DMIG"]
    return component_of(own, matrices, units, name, str(cards[-1]))


def component_of(
    cards: Sequence[Card],
    matrices: str | Path | None,
    units: Units,
    name: str,
    where: str,
    names: Mapping[str, tuple[str, ...]] = NAMES,
) -> Component:
    """The component of the ``cards`` of one superelement, see `read_external`; ``names`` of its matrices."""
    places = geometry_of(cards)
    wanted = {name for what in NAMES for name in names.get(what, ())}
    direct = [card for card in cards if card.name == "DMIG"]
    punched = read_dmig([card for card in direct if card.fields[0] in wanted])  # loads and outputs are not
    boundary = _boundary(cards, punched.pairs(names), places, where)
    found = _op4_matrices(matrices) if matrices is not None else punched.matrices(boundary, where)
    source = where if matrices is None else str(matrices)
    K, M, B, K4 = (_pick(found, names.get(what, ()), what, boundary.size, source) for what in NAMES)
    if K is None or M is None:
        what = names["stiffness" if K is None else "mass"]
        there = dict.fromkeys((*found, *(card.fields[0] for card in direct)))
        raise DataError(
            f"none of the matrices {', '.join(what)}; there are {', '.join(there) or 'none'}",
            where=source,
            hint="the file with both stiffness and mass of the component",
        )
    if K4 is not None:
        raise DataError(
            "structural damping (K4) is not taken from matrices",
            where=source,
            hint="give the article's [damping] a ratio, or leave K4 out",
        )
    turn, present = _to_basic(boundary, places, units, where)
    energy = units.mass * units.length**2 / units.time**2

    def si(matrix: np.ndarray | None, time: float) -> np.ndarray | None:
        return None if matrix is None else energy * time * (turn @ matrix @ turn.T)

    stiffness, mass, damping = si(K, 1.0), si(M, units.time**2), si(B, units.time)
    assert stiffness is not None
    assert mass is not None
    positions = np.array([places.grids[g] for g in boundary.grids]).reshape(-1, 3) * units.length
    noise: np.ndarray | None = None
    if matrices is None:
        printed = np.abs(turn) @ np.abs(K) @ np.abs(turn.T) * energy
        digits = max(punched.digits[name] for name in names["stiffness"] if name in punched.digits)
        noise = NOISE * rounding_of(digits) * printed
    part = Component(
        name=name,
        grids=tuple(map(str, boundary.grids)),
        frames=tuple(f"g{grid}" for grid in boundary.grids),
        positions=positions,
        stiffness=stiffness,
        mass=mass,
        damping=damping,
        present=present,
    )
    try:
        return as_printed(part, noise)
    except ConfigError as error:
        raise DataError(
            error.what,
            where=source,
            hint="do matrices, cards and units belong together? Grids need five digits or more",
        ) from None


def basic_matrix(
    cards: Sequence[Card], name: str, what: str, where: str
) -> tuple[tuple[int, ...], tuple[int, ...], np.ndarray, int]:
    """Grids and scalar points of one DMIG; its rows, six of each grid, in units of the deck and basic axes.

    Last comes the number of digits of its longest number.

    ``what`` it is; raises `ConfigError` or `DataError` as `component_of` does, and for one that is not
    symmetric.
    """
    places = geometry_of(cards)
    punched = read_dmig([card for card in cards if card.name == "DMIG" and card.fields[0] == name])
    boundary = _boundary(cards, punched.pairs({"stiffness": (name,), "mass": ()}), places, where)
    matrix = _pick(punched.matrices(boundary, where), (name,), what, boundary.size, where)
    if matrix is None:
        raise DataError(
            f"{name} is zero",
            where=where,
            hint="select another matrix, or remove its selection from the deck",
        )
    size = np.sqrt(np.abs(np.diagonal(matrix)))  # a turn's entry may be 1e9 in mm and N
    allowed = UNEQUAL * np.outer(size, size) + ROUNDING * np.abs(matrix).max()
    if np.any(np.abs(matrix - matrix.T) > allowed):
        raise DataError(
            f"the {what} is not symmetric",
            where=f"{where}, matrix {name!r}",
            hint="export it as a symmetric matrix (form 6), in more digits",
        )
    turn, _ = _to_basic(boundary, places, BARE, where)
    return boundary.grids, boundary.scalars, turn @ matrix @ turn.T, punched.digits[name]


def geometry_of(cards: Iterable[Card]) -> GridPlaces:
    """Grids and coordinate systems of ``cards``."""
    return place_grids(read_entries([card for card in cards if card.name in GEOMETRY]))


def _op4_matrices(path: str | Path) -> dict[str, np.ndarray]:
    """All square matrices of the file: not every program states which are symmetric."""
    from middeck.files.nastran.output4.matrices import op4_by_name  # needs scipy, which few decks do

    full = {name: matrix.value.toarray() for name, matrix in op4_by_name(path).items()}
    return {name: value for name, value in full.items() if value.shape[0] == value.shape[1]}


def _pick(
    found: Mapping[str, np.ndarray], names: Sequence[str], what: str, size: int, where: str
) -> np.ndarray | None:
    """The matrix of one of its names; a 1x1 of zero stands for none."""
    name, *others = [n for n in names if n in found] or [""]
    if not name:
        return None
    matrix = found[name]
    for other in others:
        if not np.array_equal(found[other], matrix):
            raise DataError(
                f"{name} and {other}, which differ: either may be the {what}",
                where=where,
                hint="leave the one out that is not meant",
            )
    if matrix.shape == (1, 1) and size > 1 and matrix[0, 0] == 0.0:
        return None
    if np.iscomplexobj(matrix):
        raise DataError(
            f"the {what} is complex",
            where=f"{where}, matrix {name!r}",
            hint="export a real matrix; damping is a matrix of its own (B or K4)",
        )
    if matrix.shape != (size, size):
        raise DataError(
            f"the {what} has {matrix.shape[0]} rows for {size} coordinates of grids and scalar points",
            where=f"{where}, matrix {name!r}",
            hint="do matrices and cards belong together?",
        )
    return matrix


def _boundary(
    cards: Sequence[Card], punched: list[tuple[int, str]], places: GridPlaces, where: str
) -> Boundary:
    """Boundary by EXTRN or, without it, by the coordinates of punched matrices in ASET and SPOINT order."""
    pairs = [pair for card in cards if card.name == "EXTRN" for pair in _pairs(card)] or punched
    if not pairs:
        raise DataError(
            "no EXTRN card: which coordinate a row is, is not known",
            where=where,
            hint="add the punch file of the component",
        )
    grids = [(number, comps) for number, comps in pairs if comps]
    scalars = [number for number, comps in pairs if not comps]
    seen: set[int] = set()
    for number in (*(grid for grid, _ in grids), *scalars):
        if number in seen:
            raise DataError(
                f"point {number} twice on the boundary",
                where=where,
                hint="name each grid once, with all its components",
            )
        seen.add(number)
    lost = [grid for grid, _ in grids if grid not in places.grids]
    if lost:
        raise DataError(
            f"no GRID {lost[0]}, a boundary grid", where=where, hint="add the punch file of the component"
        )
    first_scalar = next((i for i, (_, comps) in enumerate(pairs) if not comps), len(pairs))
    if any(comps for _, comps in pairs[first_scalar:]):
        raise DataError("scalar points before grids on the boundary", where=where, hint="grids first")
    return Boundary(tuple(g for g, _ in grids), tuple(c for _, c in grids), tuple(scalars))


def _pairs(card: Card) -> list[tuple[int, str]]:
    """Grid and components, or scalar point and none."""
    fields = [*card.fields, ""] if len(card.fields) % 2 else list(card.fields)
    out: list[tuple[int, str]] = []
    for i in range(0, len(fields), 2):
        if not fields[i]:
            continue
        number, comps = integer(fields[i]), "".join(sorted(fields[i + 1].replace("0", "")))
        if number is None or set(comps) - set(ALL) or len(set(comps)) < len(comps):
            raise_at(card.line(i), card.name, "no grid and components", f"{fields[i]} {fields[i + 1]}")
        out.append((number, comps))
    return out


def _to_basic(
    boundary: Boundary, places: GridPlaces, units: Units, where: str
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in SI and basic axes, six of each grid, times rows; and which six there are."""
    grids = len(boundary.grids)
    present = np.zeros((grids, 6), dtype=bool)
    turn = np.zeros((6 * grids + len(boundary.scalars), boundary.size))
    row = 0
    for i, (grid, comps) in enumerate(zip(boundary.grids, boundary.components, strict=True)):
        system = places.moves_in[grid]
        if system not in places.systems:
            raise DataError(
                f"grid {grid} has no coordinate system {system} (CD)",
                where=where,
                hint="add its CORD card to the deck",
            )
        axes = places.displacement_axes(grid)
        whole = np.kron(np.eye(2), axes) * np.repeat([1.0 / units.length, 1.0], 3)[:, None]
        index = np.array([int(c) - 1 for c in comps])
        turn[6 * i : 6 * i + 6, row : row + len(index)] = whole[:, index]
        present[i] = np.any(whole[:, index] != 0.0, axis=1)
        row += len(index)
    turn[6 * grids :, row:] = np.eye(len(boundary.scalars))
    return turn, present


class Punched(NamedTuple):
    """Punched matrices: by name whether one triangle stands for both, and entries by two (point, way).

    ``digits`` are the most that a number of the matrix has.
    """

    symmetric: dict[str, bool]
    columns: dict[str, dict[tuple[tuple[int, int], tuple[int, int]], float]]
    digits: dict[str, int]

    def pairs(self, names: Mapping[str, tuple[str, ...]]) -> list[tuple[int, str]]:
        """Points of the stiffness and mass with their components, grids first, in ascending order."""
        ways: dict[int, set[int]] = {}
        for name in (*names["stiffness"], *names["mass"]):
            for (a, i), (b, j) in self.columns.get(name, {}):
                ways.setdefault(a, set()).add(i)
                ways.setdefault(b, set()).add(j)
        found = [
            (point, "".join(str(c) for c in sorted(comps) if c)) for point, comps in sorted(ways.items())
        ]
        return [pair for pair in found if pair[1]] + [pair for pair in found if not pair[1]]

    def matrices(self, boundary: Boundary, where: str) -> dict[str, np.ndarray]:
        """The matrices as arrays in the order of ``boundary``."""
        rows = [
            (g, int(c)) for g, comps in zip(boundary.grids, boundary.components, strict=True) for c in comps
        ]
        place = {row: i for i, row in enumerate([*rows, *((s, 0) for s in boundary.scalars)])}
        out: dict[str, np.ndarray] = {}
        for name, entries in self.columns.items():
            matrix = np.zeros((len(place), len(place)))
            for (a, b), value in entries.items():
                if a not in place or b not in place:
                    lost = a if a not in place else b
                    what = (
                        f"DMIG {name} names point {lost[0]} component {lost[1]}, which is not on the boundary"
                    )
                    raise DataError(what, where=where, hint="do matrices and cards belong together?")
                matrix[place[a], place[b]] = value
                if self.symmetric[name]:
                    matrix[place[b], place[a]] = value
            out[name] = matrix
        return out


def read_dmig(cards: Sequence[Card]) -> Punched:
    """Real DMIG by name; raises `ConfigError` with file and line for complex ones and entries given twice."""
    symmetric: dict[str, bool] = {}
    columns: dict[str, dict[tuple[tuple[int, int], tuple[int, int]], float]] = {}
    digits: dict[str, int] = {}
    for card in cards:
        name, fields = card.fields[0], card.fields
        if len(fields) > 2 and fields[1] == "0":
            kind = integer(fields[3]) if len(fields) > 3 else None
            if kind not in (1, 2) or integer(fields[2]) not in (1, 2, 6, 9):
                what = f"type TIN = {fields[3] if len(fields) > 3 else ''}, form IFO = {fields[2]}"
                _refuse(card, 2, f"{what}: real matrices (TIN 1, 2) of form 1, 2, 6 or 9 are read")
            symmetric[name] = integer(fields[2]) == 6
            columns.setdefault(name, {})
            digits.setdefault(name, 1)
            continue
        if name not in symmetric:
            _refuse(card, 0, "a column before the head of its matrix")
        column = _point(card, 1)
        if not any(fields[4:]):
            _refuse(card, 1, "a column without entries: is the deck cut?")
        for i in range(4, len(fields), 4):
            if not any(fields[i : i + 4]):
                continue
            value = real(fields[i + 2]) if i + 2 < len(fields) else None
            if value is None:
                _refuse(card, i, "no grid, component and real number")
            entry = (_point(card, i), column)
            if entry in columns[name] or (symmetric[name] and entry[::-1] in columns[name]):
                _refuse(card, i, "an entry given twice")
            columns[name][entry] = value
            digits[name] = max(digits[name], count_digits(fields[i + 2]))
    return Punched(symmetric, columns, digits)


def _point(card: Card, at: int) -> tuple[int, int]:
    number = integer(card.fields[at]) if at < len(card.fields) else None
    text = card.fields[at + 1] if at + 1 < len(card.fields) else ""
    way = integer(text) if text else 0
    if number is None or number <= 0 or way is None or not 0 <= way <= 6:
        _refuse(card, at, "no grid and component")
    return number, way


def _refuse(card: Card, at: int, message: str) -> NoReturn:
    raise_at(card.line(at), f"DMIG {card.fields[0]}", message)
