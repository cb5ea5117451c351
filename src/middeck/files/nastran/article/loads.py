"""Loads of a deck as load cases of the article, one for each load set, and its gravity."""

from typing import Any

import numpy as np

from middeck.files.nastran.article.member_loads import member_load
from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, DeckParts
from middeck.files.nastran.deck.entries import Entry, raise_some
from middeck.files.nastran.deck.known_cards import OTHER_LOADS
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.nastran.deck.units import Units
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.connectivity import some_names

# Along a line of two grids, or across two such lines.
BY_GRIDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("FORCE1", "MOMENT1"), ("g1", "g2")),
    **dict.fromkeys(("FORCE2", "MOMENT2"), ("g1", "g2", "g3", "g4")),
}
DIRECT = ("FORCE", "MOMENT", *BY_GRIDS)
TAKEN = (*DIRECT, "PLOAD1", "GRAV")
LEAST = 1e-9  # length of a line, over the largest coordinate, that may be rounding of places
ALIKE = 1e-6  # relative difference of gravity in fields of eight columns
INSIDE = "how its member bends between its ends, which move and turn as under it"


class LoadSets:
    """The load sets of a deck; one is converted as a whole or not at all."""

    def __init__(self, basis: Basis, parts: DeckParts, standing: Standing, ground: frozenset[int]) -> None:
        """Loads on grids that stand for the ``ground`` move nothing."""
        self.basis, self.standing, self.places = basis, standing, basis.places
        self.ground = ground
        deck = basis.deck
        self.bars = {bar.entry.id: bar for bar in parts.bars}
        self.direct: dict[int, list[Entry]] = {}
        self.entries = deck.entries.of(*TAKEN, *OTHER_LOADS)
        for entry in self.entries:
            self.direct.setdefault(entry.id, []).append(entry)
        self.sums = deck.entries.numbered("LOAD")
        self.selection, self.chosen = deck.selection, deck.selection.sets.get("LOAD")
        self.refused: list[tuple[str, int, str]] = []
        self.gravity: dict[int, np.ndarray] = {}  # acceleration by set, zero in one of forces alone

    def cases(self, units: Units) -> list[dict[str, Any]]:
        """Load cases ``load7`` of the sets that case control selects, of all if it selects none.

        Sets with loads other than forces, moments, those of PLOAD1 and gravity go to ``refused``, and what is
        left out of PLOAD1. Raises `ConfigError` with all cards that cannot be read.
        """
        faults: list[DocumentFault] = []
        found: list[dict[str, Any]] = []
        there = {*self.direct, *self.sums}
        chosen = None if self.chosen is None else self.chosen & there
        what = "there is no load of this number"
        faults += [self.selection.fault("LOAD", sid, what) for sid in sorted((self.chosen or there) - there)]
        summed = {integer(text) for sid in (chosen or self.sums) for text in self._terms(sid)[1::2]}
        for sid in sorted(there):
            if chosen is not None and sid not in chosen:
                if sid in summed:
                    continue
                self.refused.append((f"load set {sid}", 1, "not selected by case control"))
                continue
            parts = self._parts(sid, faults)
            other = next((entry.name for _, entry in parts if entry.name not in TAKEN), None)
            if other is not None:
                self.refused.append((f"load set {sid}", 1, f"it has {other}, which is not converted"))
                continue
            falls = [self._acceleration(f, entry, faults) for f, entry in parts if entry.name == "GRAV"]
            loads = [self._load(f, entry, units, faults) for f, entry in parts if entry.name in DIRECT]
            along = [(f, entry) for f, entry in parts if entry.name == "PLOAD1"]
            try:
                loads += [t for f, entry in along for t in self._along(f, entry)]
            except ValueError as error:
                self.refused.append((f"load set {sid}", 1, f"{error}"))
                continue
            if along:
                self.refused.append((f"PLOAD1 of load set {sid}", len(along), INSIDE))
            loads = [load for load in loads if load]
            if loads or not falls:
                found.append({"name": f"load{sid}", "load": loads})
            if loads or chosen is not None or sid not in summed:
                self.gravity[sid] = np.sum([np.zeros(3), *falls], axis=0) * units.length / units.time**2
        raise_some(faults)
        return found

    def constants(self, holds: bool) -> tuple[dict[str, Any], list[str]]:
        """Gravity for an environment, where all sets that have some have the same, and notes.

        Gravity that is not converted goes to ``refused``, as all of it does where nothing ``holds`` the deck.
        """
        falling = {sid: g for sid, g in self.gravity.items() if np.any(g)}
        if not falling:
            return {}, [self._down()]
        first = next(iter(falling.values()))
        size = float(np.linalg.norm(first))
        along = first / size
        given = f"{size:g} m/s^2 along {along.round(6).tolist()}"
        alike = all(np.linalg.norm(g - first) <= ALIKE * size for g in falling.values())
        named = some_names([f"{sid}" for sid in falling][: None if alike else 1])
        if not alike or not holds:
            why = "nothing holds the deck" if alike else "an environment has one, and load sets differ"
            self.refused += [
                (f"gravity of load set {sid}", 1, f"{why}: {g.round(6).tolist()} m/s^2")
                for sid, g in falling.items()
            ]
            return {}, [
                f"gravity is left out: [constants] of an environment gives it, load set {named} {given}"
            ]
        notes = [
            f"the environment has the gravity of load set {named}, {given}"
            + ", though case control selects no LOAD" * (self.chosen is None)
            + ": modes are those under it; those of the deck's own program, without STATSUB, are those "
            "without [constants]"
        ]
        others = [f"load{sid}" for sid in self.gravity if sid not in falling]
        if others:
            notes.append(
                f"load case {some_names(others)} has no gravity in the deck, and the environment's here"
            )
        return {"gravity_m_s2": size, "gravity_direction": along}, notes

    def down(self) -> np.ndarray | None:
        """Common direction of gravity of the converted sets, or else of all GRAV; None without one."""
        falls = [g for g in self.gravity.values() if np.any(g)]
        falls = falls or [self._acceleration(1.0, e, []) for e in self.entries if e.name == "GRAV"]
        ways = [g / np.linalg.norm(g) for g in falls if np.any(g)]
        return ways[0] if ways and np.allclose(ways, ways[0], rtol=0.0, atol=ALIKE) else None

    def _down(self) -> str:
        """A note on where down is in a deck without gravity."""
        down = self.down()
        there = any(entry.name == "GRAV" for entry in self.entries)
        has = "GRAV of several directions" if there else "no GRAV, which would define the vertical"
        source = (
            f"the deck has {has}"
            if down is None
            else f"down is {down.round(6).tolist()} by a GRAV that is not selected"
        )
        return (
            f"{source}: in an environment gravity acts along -y unless [constants] has a gravity_direction, "
            "such as [0.0, 0.0, -1.0] for z up"
        )

    def _terms(self, sid: int) -> list[str]:
        """Factors and sets, in turn, that a LOAD of this number sums."""
        entry = self.sums.get(sid)
        return [] if entry is None else [text or "" for text in entry["rest"]]

    def _parts(self, sid: int, faults: list[DocumentFault]) -> list[tuple[float, Entry]]:
        """Factors and loads of a set: its own, or those that a LOAD of this number sums.

        A number that both have is refused: programs differ in which they take (NASTRAN-95 the set's own).
        """
        parts = [(1.0, entry) for entry in self.direct.get(sid, ())]
        entry = self.sums.get(sid)
        if entry is None:
            return parts
        if parts:
            what = f"{parts[0][1].label} has the same number: which of them counts depends on the program"
            faults.append(entry.fault(what, "sid", "a number of its own for the LOAD"))
        texts = self._terms(sid)
        for i in range(0, len(texts), 2):
            factor, number = real(texts[i]), integer("".join(texts[i + 1 : i + 2]))
            if not any(texts[i : i + 2]):
                continue
            if factor is None or number is None:
                faults.append(entry.fault(f"no factor and set of loads: {texts[i : i + 2]}", "rest"))
            elif number not in self.direct:
                why = "is a LOAD itself" if number in self.sums else "has no load"
                faults.append(entry.fault(f"load set {number} {why}", "rest", "sum FORCE, MOMENT and GRAV"))
            else:
                parts += [(entry["s"] * factor, part) for part in self.direct[number]]
        return parts

    def _acceleration(self, factor: float, entry: Entry, faults: list[DocumentFault]) -> np.ndarray:
        system = self.places.systems.get(entry["cid"])
        if system is None or system.kind != "R":
            faults.append(entry.fault(f"there is no rectangular coordinate system {entry['cid']}", "cid"))
            return np.zeros(3)
        return factor * entry["a"] * (system.axes @ _direction(entry, "a", faults))

    def _along(self, factor: float, entry: Entry) -> list[dict[str, Any]]:
        bar = self.bars.get(entry["eid"])
        if bar is None:
            raise ValueError(f"{entry.label} loads element {entry['eid']}, which is no bar or beam")
        return member_load(entry, bar, factor, self.basis, self.standing)

    def _load(self, factor: float, entry: Entry, units: Units, faults: list[DocumentFault]) -> dict[str, Any]:
        grid = entry["g"]
        carrier = self.standing.carrier(grid)
        if carrier in self.ground:
            return {}
        if carrier not in self.standing.kept:
            faults.append(entry.fault(f"grid {grid} has no element or mass, or there is no such grid", "g"))
            return {}
        place = self.places.grids[grid]
        by_grids = entry.name in BY_GRIDS
        along = self._by_grids(entry, faults) if by_grids else self._by_vector(entry, place, faults)
        vector = factor * entry["f"] * along
        key, unit = "force_n", units.force
        if entry.name.startswith("MOMENT"):
            key, unit = "moment_nm", units.force * units.length
        arm = (place - self.places.grids[carrier]) * units.length
        return {"frame": f"g{carrier}", key: vector * unit, "offset_m": arm}

    def _by_vector(self, entry: Entry, place: np.ndarray, faults: list[DocumentFault]) -> np.ndarray:
        """The vector N in basic coordinates, of any length."""
        system = self.places.systems.get(entry["cid"])
        if system is None:
            faults.append(entry.fault(f"there is no coordinate system {entry['cid']}", "cid"))
            return np.zeros(3)
        return system.axes_at(place) @ _direction(entry, "f", faults)

    def _by_grids(self, entry: Entry, faults: list[DocumentFault]) -> np.ndarray:
        """The unit vector from G1 to G2, or across that line and that from G3 to G4; zero of a zero load."""
        keys = BY_GRIDS[entry.name]
        absent = next((key for key in keys if entry[key] not in self.places.grids), None)
        if absent is not None:
            faults.append(entry.fault(f"there is no grid {entry[absent]}", absent))
            return np.zeros(3)
        ends = [self.places.grids[entry[key]] for key in keys]
        first, *second = (b - a for a, b in zip(ends[::2], ends[1::2], strict=True))
        given = np.cross(first, second[0]) if second else first
        size, longer = (
            np.linalg.norm(given),
            max(np.linalg.norm([first, second[0]], axis=1)) if second else 1.0,
        )
        origins = [system.origin for system in self.places.systems.values()]
        if not size > LEAST * np.abs([*ends, *origins]).max() * longer:
            what = "two lines that are parallel, or of no length" if second else "grids in one place"
            if entry["f"]:
                faults.append(entry.fault(f"its direction is zero: {what}", keys[-1]))
            return np.zeros(3)
        return given / size


def _direction(entry: Entry, size: str, faults: list[DocumentFault]) -> np.ndarray:
    """The vector N of a load, as long as it is given; zero is one of a load of that ``size`` alone."""
    given = np.array([entry["n1"], entry["n2"], entry["n3"]])
    if entry[size] and not given.any():
        faults.append(entry.fault("its direction is zero: one of N1 to N3 must not be", "n1"))
    return given
