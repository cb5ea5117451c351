"""Rigid elements whose six independent components lie at several grids: RBE1, and RBAR with some at each end.

Six components that can move a rigid body in every way say how it moves, and the dependent ones follow:
u_d = R_d inv(R_i) u_i, with R the rows of the body's shift and turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.files.faults import Fault
from middeck.files.nastran.coordinates import Places
from middeck.files.nastran.entries import Entries, Entry
from middeck.files.nastran.numbers import integer, real

ALL = "123456"
# Of the independent rows, lengths over the size of the element: nearer to a mechanism is refused.
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


def rigid_elements(entries: Entries, faults: list[Fault]) -> Iterator[Rigid]:
    """RBE1, and RBAR that is not of one end alone (see `partial_links`)."""
    for entry in entries.of("RBAR"):
        first, second = entry["cna"] or "", entry["cnb"] or ""
        independent = _single((entry["ga"], first), (entry["gb"], second))
        stated = _single((entry["ga"], entry["cma"] or ""), (entry["gb"], entry["cmb"] or ""))
        if both := sorted(set(independent) & set(stated)):
            named = ", ".join(f"component {c} of grid {grid}" for grid, c in both)
            faults.append(entry.fault(f"independent and dependent at once: {named}", "cma"))
            continue
        if {first, second} == {ALL, ""}:
            continue
        others = tuple(m for m in _single((entry["ga"], ALL), (entry["gb"], ALL)) if m not in independent)
        yield Rigid(entry, "cna", independent, stated or others)
    for entry in entries.of("RBE1"):
        texts = list(entry["rest"])
        if "UM" not in texts:
            faults.append(entry.fault("UM is missing", "rest", "GN CN ..., then a line of UM and GM CM ..."))
            continue
        at = texts.index("UM")
        parts = [_pairs(entry, some, faults) for some in (texts[:at], texts[at + 1 :])]
        if all(parts):
            yield Rigid(entry, "rest", *parts)


def _single(*some: tuple[int, str]) -> Moves:
    return tuple((grid, c) for grid, components in some for c in components)


def _pairs(entry: Entry, texts: list[str | None], faults: list[Fault]) -> Moves:
    """Grids and components, blanks between; a last real is the thermal expansion."""
    given = [t for t in texts if t is not None]
    if len(given) % 2 and real(given[-1]) is None:
        faults.append(entry.fault(f"{given[-1]} has no components", "rest"))
        return ()
    found: list[tuple[int, str]] = []
    for grid, components in zip(given[::2], given[1::2], strict=False):
        number = integer(grid)
        if number is None or number <= 0 or not components or set(components) - set(ALL):
            faults.append(entry.fault(f"{grid} {components} is no grid and components", "rest"))
            return ()
        found.append((number, components))
    return _single(*found)


def relation(
    rigid: Rigid, places: Places, faults: list[Fault]
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


def _rows(moves: Moves, places: Places, origin: int, size: float) -> np.ndarray:
    """Each component per shift and, times ``size``, turn of the body at ``origin``."""
    rows = np.zeros((len(moves), 6))
    for row, (grid, component) in zip(rows, moves, strict=True):
        way = int(component) - 1
        axis = places.displacement_axes(grid)[:, way % 3]
        arm = places.grids[grid] - places.grids[origin]
        row[:3], row[3:] = (axis, np.cross(arm, axis) / size) if way < 3 else (0.0, axis / size)
    return rows
