"""Restraints of a deck's grids by the ground: the selected SPC and SPC1, and PS of the grids."""

from collections.abc import Container
from typing import Any

from middeck.files.nastran.constraints.rigid_links import ALL, expand
from middeck.files.nastran.deck.coordinates import GridPlaces, along_and_about, grid_default
from middeck.files.nastran.deck.deck import Deck
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.deck.nastran_numbers import integer
from middeck.files.toml.faults import DocumentFault


def read_restraints(
    deck: Deck, places: GridPlaces, scalars: Container[int], faults: list[DocumentFault]
) -> dict[int, str]:
    """Held components by grid; appends to ``faults`` what is wrong or has no clamp.

    Scalar points (``scalars``) are passed over: see `held_points`.
    """
    found: dict[int, set[str]] = {}
    default = grid_default(deck.entries, "ps")
    for entry in deck.entries.of("GRID"):
        ps = default if entry["ps"] is None else entry["ps"]
        if ps:
            found.setdefault(entry.id, set()).update(ps)
    for entry in deck.selected("SPC"):
        for key, grid, components in _terms(entry, places, scalars, faults):
            if grid in scalars:
                continue
            if grid not in places.grids:
                faults.append(entry.fault(f"there is no grid {grid}", key))
            elif not components:
                faults.append(entry.fault(f"no components of grid {grid}", key, f"some of {ALL}"))
            else:
                found.setdefault(grid, set()).update(components)
    return {grid: "".join(sorted(held)) for grid, held in found.items()}


def clamp(grid: int, held: str, places: GridPlaces) -> dict[str, Any]:
    """The clamp, in an environment's form, that holds the components ``held`` of ``grid``."""
    return {"node": f"g{grid}", **along_and_about(held, places.displacement_axes(grid))}


def _terms(
    entry: Entry, places: GridPlaces, scalars: Container[int], faults: list[DocumentFault]
) -> list[tuple[str, int, str | None]]:
    """Fields, grids and components of an SPC or SPC1; of a range (THRU) the points that are there."""
    if entry.name == "SPC1":
        texts = [text for text in entry["grids"] if text]
        alone = {integer(text) for i, text in enumerate(texts) if "THRU" not in texts[max(0, i - 1) : i + 2]}
        grids = expand(entry, texts, "grids", faults)
        found = [grid for grid in grids if grid in alone or grid in places.grids or grid in scalars]
        if grids and not found:
            faults.append(entry.fault("no grid of this range is there", "grids"))
        return [("grids", grid, entry["c"]) for grid in found]
    if entry["d1"] or entry["d2"]:
        faults.append(entry.fault("a displacement that is not zero is not converted yet", "d1"))
    if entry["c2"] and entry["g2"] is None:
        faults.append(entry.fault(f"no grid whose components {entry['c2']} these are", "c2", "G2 beside C2"))
    terms = [(f"g{i}", entry[f"g{i}"], entry[f"c{i}"]) for i in "12"]
    return [term for term in terms if term[1] is not None]
