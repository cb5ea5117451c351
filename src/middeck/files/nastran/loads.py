"""Forces and moments of a deck as load cases of the article, one for each load set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from middeck.files.faults import Fault
from middeck.files.nastran.coordinates import Places
from middeck.files.nastran.deck import Deck
from middeck.files.nastran.entries import Entry
from middeck.files.nastran.formats import OTHER_LOADS
from middeck.files.nastran.numbers import integer, real
from middeck.files.nastran.units import Units

DIRECT = ("FORCE", "MOMENT")


class LoadSets:
    """The load sets of a deck; one is converted as a whole or not at all."""

    def __init__(self, deck: Deck, places: Places, carriers: Mapping[int, int], kept: set[int]) -> None:
        self.places, self.carriers, self.kept = places, carriers, kept
        self.direct: dict[int, list[Entry]] = {}
        for entry in deck.entries.of(*DIRECT, "GRAV", *OTHER_LOADS):
            self.direct.setdefault(entry.id, []).append(entry)
        self.sums = deck.entries.numbered("LOAD")
        self.chosen = deck.selection.sets.get("LOAD")
        self.refused: list[tuple[str, int, str]] = []

    def cases(self, units: Units, faults: list[Fault]) -> list[dict[str, Any]]:
        """Load cases ``load7`` of the sets that case control selects, of all if it selects none.

        Sets with other loads go to ``refused``.
        """
        found: list[dict[str, Any]] = []
        chosen = None if self.chosen is None else self.chosen & {*self.direct, *self.sums}
        summed = {integer(text or "") for sid in chosen or () for text in self._terms(sid)[1::2]}
        for sid in sorted({*self.direct, *self.sums}):
            if chosen is not None and sid not in chosen:
                if sid in summed:
                    continue
                self.refused.append((f"load set {sid}", 1, "not selected by case control"))
                continue
            parts = self._parts(sid, faults)
            other = next((entry.name for _, entry in parts if entry.name not in DIRECT), None)
            if other is not None:
                hint = ": give it as [constants] of an environment" if other == "GRAV" else ""
                self.refused.append((f"load set {sid}", 1, f"it has {other}, which is no point load{hint}"))
                continue
            loads = [self._load(factor, entry, units, faults) for factor, entry in parts]
            found.append({"name": f"load{sid}", "load": [load for load in loads if load]})
        return found

    def _terms(self, sid: int) -> list[str]:
        """Factors and sets, in turn, that a LOAD of this number sums."""
        entry = self.sums.get(sid)
        return [] if entry is None else [text or "" for text in entry["rest"]]

    def _parts(self, sid: int, faults: list[Fault]) -> list[tuple[float, Entry]]:
        """Factors and loads of a set: its own, and those that a LOAD of this number sums."""
        parts = [(1.0, entry) for entry in self.direct.get(sid, ())]
        entry = self.sums.get(sid)
        if entry is None:
            return parts
        texts = self._terms(sid)
        for i in range(0, len(texts), 2):
            factor, number = real(texts[i]), integer("".join(texts[i + 1 : i + 2]))
            if not any(texts[i : i + 2]):
                continue
            if factor is None or number not in self.direct:
                faults.append(entry.fault(f"no factor and set of loads: {texts[i : i + 2]}", "rest"))
            else:
                parts += [(entry["s"] * factor, part) for part in self.direct[number]]
        return parts

    def _load(self, factor: float, entry: Entry, units: Units, faults: list[Fault]) -> dict[str, Any]:
        grid, cid = entry["g"], entry["cid"]
        carrier = self.carriers.get(grid, grid)
        if carrier not in self.kept:
            faults.append(entry.fault(f"nothing stands on grid {grid}, or it is not there", "g"))
        elif cid not in self.places.systems:
            faults.append(entry.fault(f"there is no coordinate system {cid}", "cid"))
        else:
            place = self.places.grids[grid]
            given = np.array([entry["n1"], entry["n2"], entry["n3"]])
            vector = factor * entry["f"] * (self.places.systems[cid].axes_at(place) @ given)
            key, unit = "force_n", units.force
            if entry.name == "MOMENT":
                key, unit = "moment_nm", units.force * units.length
            arm = (place - self.places.grids[carrier]) * units.length
            return {"frame": f"g{carrier}", key: vector * unit, "offset_m": arm}
        return {}
