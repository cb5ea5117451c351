"""Bars, beams and rods of a deck as struts of an article, in units of the deck."""

import re
from functools import cache
from typing import Any

import numpy as np

from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.deck.entries import Entries, Entry
from middeck.files.nastran.deck.known_cards import PLACES
from middeck.files.nastran.members.sections_of_bars import BarSection, Sections
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.section import default_up
from middeck.values import record

RODS = ("CROD", "CTUBE", "CONROD")
NAMES = ("CBAR", "CBEAM", *RODS)
OFFT = re.compile("[GB][GO][GO]")
FLAGS = {"0": None, "1": "GGG", "2": "GGG"}  # older: 1 for an orientation by vector, 2 by grid
DEFAULTS = {"CBAR": "BAROR", "CBEAM": "BEAMOR"}
# The sine of the angle between a member and its orientation vector.
LEAST_SINE = 1e-6


# Rigid motions of a bar of unit length at each end and component: along it, about it, and in both planes the
# shift of its first end and its turn.
WAYS = (
    ({"1": [1]}, {"1": [1]}),
    ({"4": [1]}, {"4": [1]}),
    ({"2": [1, 0], "6": [0, 1]}, {"2": [1, 1], "6": [0, 1]}),
    ({"3": [1, 0], "5": [0, 1]}, {"3": [1, -1], "5": [0, 1]}),
)


@record(kw_only=True)
class Bar:
    """A member: its grids, the places of its ends in basic coordinates, its own y axis and its section."""

    entry: Entry
    grids: tuple[int, int]
    ends: tuple[np.ndarray, np.ndarray]
    up: np.ndarray
    section: BarSection

    def released(self, end: int) -> str:
        """Components in `element_axes` that an end does not pass on (PA, PB), but those that hold the bar."""
        if self.entry.name in RODS or not (self.entry["pa"] or self.entry["pb"]):
            return ""
        return _loose(f"{self.entry['pa'] or ''}", f"{self.entry['pb'] or ''}")[end]

    @property
    def element_axes(self) -> np.ndarray:
        """Columns: the coordinates of its pins, own axes before they turned to principal ones."""
        x, y, z = own_axes(self.ends[1] - self.ends[0], self.up).T
        c, s = np.cos(self.section.angle), np.sin(self.section.angle)
        return np.column_stack([x, c * y - s * z, s * y + c * z])

    @property
    def length(self) -> float:
        """Distance between the ends."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


@cache  # a deck has many bars, and few lists of pins
def _loose(first: str, second: str) -> tuple[str, str]:
    """Released components of both ends, less those without which the bar itself would be a mechanism.

    A bar that turns about itself, slides or swings as a rigid body bears nothing, held at one end or not; the
    deck's own program has no coordinate for it.
    """
    released = [set(first), set(second)]
    for ways in WAYS:
        rows = [(end, c, np.array(row)) for end, group in enumerate(ways) for c, row in group.items()]
        held = [row for end, c, row in rows if c not in released[end]]
        for end, c, row in rows:
            if c in released[end] and _rank([*held, row]) > _rank(held):
                released[end].discard(c)
                held.append(row)
    return "".join(sorted(released[0])), "".join(sorted(released[1]))


def _rank(rows: list[np.ndarray]) -> int:
    return int(np.linalg.matrix_rank(np.array(rows))) if rows else 0


def read_bars(entries: Entries, places: GridPlaces, faults: list[DocumentFault]) -> list[Bar]:
    """All members; appends to ``faults`` what is wrong or cannot be represented."""
    sections = Sections(entries, faults)
    reader = _Reader(entries, places, faults)
    bars: list[Bar] = []
    for entry in entries.of(*NAMES):
        before = len(faults)
        entry = reader.completed(entry)
        section = sections.of(entry)
        placed = reader.place(entry)
        if section is None or placed is None or len(faults) > before:
            continue
        ends, up = placed
        if section.angle:
            _, y, z = own_axes(ends[1] - ends[0], up).T
            up = np.cos(section.angle) * y + np.sin(section.angle) * z
        bars.append(Bar(entry=entry, grids=(entry["ga"], entry["gb"]), ends=ends, up=up, section=section))
    return bars


def own_axes(along: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Unit vectors as columns: x ``along``, y towards ``up``; not finite if both are one line."""
    with np.errstate(invalid="ignore", divide="ignore"):
        x, z = along / np.linalg.norm(along), np.cross(along, up)
        z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


class _Reader:
    """Reads the ends, offsets and orientation of members; collects faults."""

    def __init__(self, entries: Entries, places: GridPlaces, faults: list[DocumentFault]) -> None:
        self.places, self.faults = places, faults
        self.default = {name: next(iter(entries.of(card)), None) for name, card in DEFAULTS.items()}

    def completed(self, entry: Entry) -> Entry:
        """The element with what BAROR or BEAMOR gives, and its own number as the default property."""
        other = self.default.get(entry.name)
        given: dict[str, Any] = {}
        if other is not None:
            vector = ("x1", "x2", "x3")
            bare = all(entry[key] is None for key in vector)
            if not bare and any(entry[key] is None and other[key] is not None for key in vector):
                self._add(entry, f"an orientation of which {other.name} gives a part is not converted", "x1")
            keys = ("pid", "offt", *(vector if bare else ()))
            given = {key: other[key] for key in keys if entry[key] is None}
        if entry.name != "CONROD" and entry["pid"] is None and given.get("pid") is None:
            given["pid"] = entry.id
        if entry.name in DEFAULTS:
            offt = given.get("offt") or entry["offt"]
            given["offt"] = FLAGS.get(offt, offt)
        places = PLACES[entry.name]
        values = list(entry.values)
        for key, value in given.items():
            values[places[key]] = value
        return Entry(entry.name, tuple(values), entry.card)

    def place(self, entry: Entry) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray] | None:
        """Both ends and the orientation vector in basic coordinates."""
        for key in ("ga", "gb"):
            if entry[key] not in self.places.grids:
                self._add(entry, f"there is no grid {entry[key]}", key)
                return None
        a, b = (self.places.grids[entry[key]] for key in ("ga", "gb"))
        if entry.name in RODS:
            if not np.linalg.norm(b - a) > 0.0:
                self._add(entry, "a member of no length", "gb")
                return None
            return (a, b), default_up(b - a)
        self._representable(entry)
        offt = entry["offt"] or "GGG"
        up = self._orientation(entry, a, offt[:1])
        if up is None:
            return None
        w_a, w_b = (np.array([entry[f"w{i}{end}"] for i in "123"]) for end in "ab")
        own = own_axes(b - a, up) if "O" in offt[1:] and (w_a.any() or w_b.any()) else None
        if own is not None and not np.all(np.isfinite(own)):
            self._add(entry, "offsets in its own axes, which grids and orientation do not give", "offt")
            return None
        ends = (
            a + self._vector(entry["ga"], w_a, offt[1:2], own),
            b + self._vector(entry["gb"], w_b, offt[2:3], own),
        )
        along = ends[1] - ends[0]
        length = np.linalg.norm(along)
        if not length > 0.0:
            self._add(entry, "a member of no length", "gb")
        elif not np.linalg.norm(np.cross(up, along)) > LEAST_SINE * length * np.linalg.norm(up):
            what = "its orientation vector is zero or along the member"
            hint = "a vector is in the displacement axes of GA, unless OFFT begins with B"
            self.faults.append(entry.fault(what, "x1", hint))
        return ends, up

    def _orientation(self, entry: Entry, a: np.ndarray, frame: str) -> np.ndarray | None:
        first = entry["x1"]
        if type(first) is int:
            if entry["x2"] is not None or entry["x3"] is not None:
                self._add(entry, "a grid for orientation, and components as well", "x1")
            elif first not in self.places.grids:
                self._add(entry, f"there is no grid {first}", "x1")
            else:
                return self.places.grids[first] - a
            return None
        if first is None and entry["x2"] is None and entry["x3"] is None:
            self._add(entry, "no orientation: neither a vector nor a grid", "x1")
            return None
        vector = np.array([entry[key] or 0.0 for key in ("x1", "x2", "x3")])
        return self._vector(entry["ga"], vector, frame)

    def _vector(
        self, grid: int, components: np.ndarray, frame: str, own: np.ndarray | None = None
    ) -> np.ndarray:
        """Components in the displacement coordinates of ``grid`` ("G"), basic ("B") or ``own`` ones ("O")."""
        if frame == "B" or not np.any(components):
            return components
        if frame == "O" and own is not None:
            return own @ components
        return self.places.displacement_axes(grid) @ components

    def _representable(self, entry: Entry) -> None:
        for key in ("pa", "pb"):
            if entry[key] and not set(f"{entry[key]}") <= set("123456"):
                self._add(entry, "no list of components 1 to 6", key)
        if entry.name == "CBEAM" and (entry["sa"] or entry["sb"]):
            self._add(entry, "warping is not converted yet", "sa")
        offt = entry["offt"]
        if offt is not None and not OFFT.fullmatch(offt):
            self._add(entry, "must be G or B for the orientation, then G or O for each offset", "offt")

    def _add(self, entry: Entry, message: str, key: str) -> None:
        self.faults.append(entry.fault(message, key))
