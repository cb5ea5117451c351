"""Rigid elements whose six independent components lie at several grids: RBE1, and RBAR with some at each end.

Six components that can move a rigid body in every way say how it moves, and the dependent ones follow:
u_d = R_d inv(R_i) u_i, with R the rows of the body's shift and turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.deck.entries import ALL, Entries, Entry
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.toml.faults import DocumentFault

LINE = 8  # fields of a line
# Largest condition of the independent rows, lengths over the size of the element: beyond is a mechanism.
WORST = 1e6

Moves = tuple[tuple[int, str], ...]


class Rigid(NamedTuple):
    """One element: the field that names its dependent components, and single components of grids."""

    entry: Entry
    key: str
    independent: Moves
    dependent: Moves

    @property
    def grids(self) -> tuple[int, ...]:
        """The grids that it joins, the independent first."""
        return tuple(dict.fromkeys(grid for grid, _ in (*self.independent, *self.dependent)))

    @property
    def whole(self) -> bool:
        """Whether it ties all components of all its grids: a rigid body, in large turns too."""
        return len(self.independent) + len(self.dependent) == len(ALL) * len(self.grids)


def rigid_elements(entries: Entries, faults: list[DocumentFault]) -> Iterator[Rigid]:
    """RBE1, and RBAR that is not of one end alone (see `partial_links`)."""
    for entry in entries.of("RBAR"):
        first, second = entry["cna"] or "", entry["cnb"] or ""
        independent = _single((entry["ga"], first), (entry["gb"], second))
        stated = _single((entry["ga"], entry["cma"] or ""), (entry["gb"], entry["cmb"] or ""))
        if _at_once(entry, "cma", (independent, stated), faults) or {first, second} == {ALL, ""}:
            continue
        others = tuple(m for m in _single((entry["ga"], ALL), (entry["gb"], ALL)) if m not in independent)
        yield Rigid(entry, "cna", independent, stated or others)
    for entry in entries.of("RBE1"):
        texts = list(entry["rest"])
        if "UM" not in texts:
            faults.append(entry.fault("UM is missing", "rest", "GN CN ..., then a line of UM and GM CM ..."))
            continue
        at = texts.index("UM")
        independent = _pairs(entry, texts[:at], faults)
        dependent = _pairs(entry, _without_expansion(texts[at + 1 :]), faults)
        both = independent, dependent
        if all(both) and not _at_once(entry, "rest", both, faults):
            yield Rigid(entry, "rest", *both)


def _single(*some: tuple[int, str]) -> Moves:
    return tuple((grid, c) for grid, components in some for c in components)


def _at_once(entry: Entry, key: str, moves: tuple[Moves, Moves], faults: list[DocumentFault]) -> bool:
    """Whether a component is both independent and dependent; adds a fault if so."""
    both = sorted(set(moves[0]) & set(moves[1]))
    if both:
        named = ", ".join(f"component {c} of grid {grid}" for grid, c in both)
        faults.append(entry.fault(f"independent and dependent at once: {named}", key))
    return bool(both)


def _without_expansion(texts: list[str | None]) -> list[str | None]:
    """The fields without a last real number, the coefficient of thermal expansion."""
    given = [(k, text) for k, text in enumerate(texts) if text is not None]
    return texts[: given[-1][0]] if given and real(given[-1][1]) is not None else texts


def _pairs(entry: Entry, texts: list[str | None], faults: list[DocumentFault]) -> Moves:
    """Grids and components by their places: three pairs a line, a blank field before and after them."""
    found: list[tuple[int, str]] = []
    for pair in _by_place(texts):
        grid, components = pair
        number = integer(grid) if grid is not None else None
        if number is None or number <= 0 or not components or set(components) - set(ALL):
            named = " ".join("(blank)" if text is None else text for text in pair)
            faults.append(entry.fault(f"{named} is no grid and components", "rest"))
            return ()
        found.append((number, components))
    return _single(*found)


def _by_place(texts: list[str | None]) -> Iterator[tuple[str | None, str | None]]:
    """The pairs that are not blank; what stands in a blank field is a pair of which one half lacks."""
    padded = [None, *texts, *[None] * (-(len(texts) + 1) % LINE)]
    for k in range(0, len(padded), LINE):
        before, *fields, after = padded[k : k + LINE]
        pairs = [(before, None), *zip(fields[::2], fields[1::2], strict=True), (None, after)]
        yield from ((a, b) for a, b in pairs if a is not None or b is not None)


def relation(
    rigid: Rigid, places: GridPlaces, faults: list[DocumentFault]
) -> Float[np.ndarray, "dependent independent"] | None:
    """Dependent components per independent one; None, with a fault, where these leave the body loose."""
    size = max(
        *(float(np.linalg.norm(places.grids[g] - places.grids[rigid.grids[0]])) for g in rigid.grids), 1e-300
    )
    rows = _rows(rigid.independent, places, rigid.grids[0], size)
    if len(rows) != len(ALL) or np.linalg.cond(rows) > WORST:
        message = f"{len(rows)} independent components that do not say how a rigid body moves"
        faults.append(rigid.entry.fault(message, rigid.key, "six that hold it against every motion"))
        return None
    return np.linalg.solve(rows.T, _rows(rigid.dependent, places, rigid.grids[0], size).T).T


def _rows(moves: Moves, places: GridPlaces, origin: int, size: float) -> np.ndarray:
    """Each component per shift and, times ``size``, turn of the body at ``origin``."""
    rows = np.zeros((len(moves), 6))
    for row, (grid, component) in zip(rows, moves, strict=True):
        way = int(component) - 1
        axis = places.displacement_axes(grid)[:, way % 3]
        arm = places.grids[grid] - places.grids[origin]
        row[:3], row[3:] = (axis, np.cross(arm, axis) / size) if way < 3 else (0.0, axis / size)
    return rows
