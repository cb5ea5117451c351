"""Coordinate systems of a deck in basic coordinates: rectangular, cylindrical and spherical, in chains."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.files.nastran.deck.entries import Entries, Entry, raise_some
from middeck.files.nastran.deck.known_cards import PLACES
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.clamps import LETTERS

# The sine of the angle between two axes that span a plane.
LEAST_SINE = 1e-6
# Distance from the polar axis, over the largest coordinate, below which a point is on it.
ON_AXIS = 1e-9


class System(NamedTuple):
    """A coordinate system: "R", "C" or "S", its origin, and its axes (columns) in basic coordinates."""

    kind: str
    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]

    def to_basic(self, place: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """The point with coordinates ``place`` (angles in degrees) in basic coordinates."""
        a, b, c = map(float, place)
        if self.kind == "C":
            turn = np.deg2rad(b)
            place = np.array([a * np.cos(turn), a * np.sin(turn), c])
        elif self.kind == "S":
            polar, turn = np.deg2rad(b), np.deg2rad(c)
            place = a * np.array([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])
        return self.origin + self.axes @ place

    def axes_at(self, point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
        """Directions (columns) of components at ``point``, both basic; on the polar axis those of 0 deg."""
        if self.kind == "R":
            return self.axes
        x, y, z = self.axes.T @ (point - self.origin)
        size = np.abs([self.origin, point]).max()
        if np.hypot(x, y) <= ON_AXIS * size:  # what rounding leaves has no direction
            x, y, z = 0.0, 0.0, z if abs(z) > ON_AXIS * size else 0.0
        turn = np.arctan2(y, x)
        c, s = np.cos(turn), np.sin(turn)
        round_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        if self.kind == "C":
            return self.axes @ round_z
        polar = np.arctan2(np.hypot(x, y), z)
        c, s = np.cos(polar), np.sin(polar)
        # r, theta and phi in the meridian's own axes (outward, along phi, up).
        return self.axes @ round_z @ np.array([[s, c, 0.0], [0.0, 0.0, 1.0], [c, -s, 0.0]])


BASIC = System("R", np.zeros(3), np.eye(3))


class GridPlaces(NamedTuple):
    """All coordinate systems by number; every grid in basic coordinates, and the system it moves in."""

    systems: dict[int, System]
    grids: dict[int, Float[np.ndarray, "3"]]
    moves_in: dict[int, int]

    def displacement_axes(self, grid: int) -> Float[np.ndarray, "3 3"]:
        """Directions (columns, basic) of the displacement components of ``grid``."""
        return self.systems[self.moves_in[grid]].axes_at(self.grids[grid])


def place_grids(entries: Entries) -> GridPlaces:
    """Resolve chains of coordinate systems and grids.

    Raises `ConfigError` for chains that close, for systems and grids that are not there, and for three points
    of a system on one line.
    """
    return _Resolver(entries).places()


def grid_default(entries: Entries, field: str) -> Any:
    """Default by GRDSET, if any, for a field of grids (CP, CD, PS) that is left blank; else 0."""
    return next((entry[field] for entry in entries.of("GRDSET")), 0)


def along_and_about(components: str, axes: Float[np.ndarray, "3 3"]) -> dict[str, Any]:
    """Components 1 to 6 in the form of a clamp or link: letters of shifts and turns, and their ``axes``."""
    along, about = (
        "".join(letter for letter, digit in zip(LETTERS, digits, strict=True) if digit in components)
        for digits in ("123", "456")
    )
    return {"along": along, "about": about, "x_axis": axes[:, 0], "y_axis": axes[:, 1]}


class _Resolver:
    """Coordinate systems and grids found so far; 0 is the basic one."""

    def __init__(self, entries: Entries) -> None:
        names = [f"CORD{i}{kind}" for i in "12" for kind in "RCS"]
        self.defined = entries.numbered(*names)
        self.grid = entries.numbered("GRID")
        self.cp = grid_default(entries, "cp")
        self.systems: dict[int, System] = {0: BASIC}
        self.grids: dict[int, np.ndarray] = {}
        cd = grid_default(entries, "cd")
        self.moves_in = {n: cd if e["cd"] is None else e["cd"] for n, e in self.grid.items()}
        self.faults: dict[str, DocumentFault] = {}

    def places(self) -> GridPlaces:
        for cid in self.defined:
            self._resolve(("system", cid))
        for number, entry in self.grid.items():
            if (self.cp if entry["cp"] is None else entry["cp"]) == 0:
                self.grids[number] = np.array(entry.values[2:5])
            else:
                self._resolve(("grid", number))
        raise_some(list(self.faults.values()))
        return GridPlaces(self.systems, self.grids, self.moves_in)

    def _done(self, what: tuple[str, int]) -> bool:
        return what[1] in (self.systems if what[0] == "system" else self.grids)

    def _needs(self, what: tuple[str, int]) -> list[tuple[str, tuple[str, int]]]:
        """The field of each system or grid that must be known before."""
        kind, number = what
        if kind == "grid":
            cp = self.grid[number]["cp"]
            return [("cp", ("system", self.cp if cp is None else cp))]
        entry = self.defined[number]
        if entry.name[4] == "1":
            return [(key, ("grid", entry[key])) for key in ("g1", "g2", "g3")]
        return [("rid", ("system", entry["rid"]))]

    def _resolve(self, first: tuple[str, int]) -> None:
        """Everything that ``first`` needs, then itself; without recursion, as chains may be long."""
        stack, within = [first], {first}
        while stack:
            what = stack[-1]
            if self._done(what):
                within.discard(stack.pop())
                continue
            entry = (self.grid if what[0] == "grid" else self.defined)[what[1]]
            missing: list[tuple[str, int]] = []
            for key, need in self._needs(what):
                if self._done(need):
                    continue
                if need[1] not in (self.grid if need[0] == "grid" else self.defined):
                    self._refuse(entry.fault(f"there is no {_word(need)}", key))
                    return
                if need in within:
                    self._refuse(entry.fault(f"{_word(need)} is defined by itself: a circle", key))
                    return
                missing.append(need)
            if missing:
                stack.append(missing[0])
                within.add(missing[0])
            elif what[0] == "grid":
                cp = self.cp if entry["cp"] is None else entry["cp"]
                place = np.array([entry["x1"], entry["x2"], entry["x3"]])
                self.grids[what[1]] = self.systems[cp].to_basic(place)
            elif not self._define(what[1], entry):
                return

    def _define(self, cid: int, entry: Entry) -> bool:
        if entry.name[4] == "1":
            a, b, c = (self.grids[entry[key]] for key in ("g1", "g2", "g3"))
        else:
            # NASTRAN User's Manual, 2.4, CORD2R, remark 1: the continuation must be present.
            if len(entry.card.fields) <= PLACES[entry.name]["c1"]:
                hint = "is the deck whole? 0. is a zero; three blanks are no point"
                self._refuse(entry.fault("its third point is missing", "c1", hint))
                return False
            based = self.systems[entry["rid"]]
            a, b, c = (
                based.to_basic(np.array([entry[f"{p}1"], entry[f"{p}2"], entry[f"{p}3"]])) for p in "abc"
            )
        up, aside = b - a, c - a
        across = np.cross(up, aside)
        size = float(np.linalg.norm(up) * np.linalg.norm(aside))
        if not np.linalg.norm(across) > LEAST_SINE * size:
            self._refuse(entry.fault("its three points are on one line"))
            return False
        z = up / np.linalg.norm(up)
        y = across / np.linalg.norm(across)
        self.systems[cid] = System(entry.name[5], a, np.stack([np.cross(y, z), y, z], axis=1))
        return True

    def _refuse(self, fault: DocumentFault) -> None:
        self.faults.setdefault(str(fault), fault)


def _word(what: tuple[str, int]) -> str:
    return f"{'grid' if what[0] == 'grid' else 'coordinate system'} {what[1]}"
