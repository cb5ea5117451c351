"""Bars, beams and rods as struts of an article: their sections, their ends, and the pins that part these."""

from typing import Any

import numpy as np

from middeck.files.nastran.article.article_sections import ArticleSections, article_sections, taper_notes
from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, DeckParts, Tables
from middeck.files.nastran.constraints.rigid_links import ALL
from middeck.files.nastran.deck.coordinates import along_and_about
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.members.members import RODS, Bar


def strut_tables(
    basis: Basis, parts: DeckParts, standing: Standing
) -> tuple[dict[str, dict[str, Any]], Tables, list[str]]:
    """Sections by name, struts, and notes on tapers."""
    made: dict[str, ArticleSections] = {}
    struts: Tables = []
    for bar in parts.bars:
        section = _section_name(bar.entry)
        if section not in made:
            rod = bar.entry.name in RODS
            made[section] = article_sections(
                bar.section, rod, basis.units, basis.mass_unit, basis.formulation
            )
        struts.append(_along(section, made[section]) | _strut(basis, bar, standing))
    sections = {
        name: table
        for section, found in made.items()
        for name, table in zip(_names(section, found), found.tables, strict=True)
    }
    return sections, struts, taper_notes(made)


def pin_tables(basis: Basis, parts: DeckParts, standing: Standing) -> tuple[Tables, Tables]:
    """Nodes of the ends that pins part from their grids, and the links that leave them free to move."""
    nodes: Tables = []
    links: Tables = []
    for bar in parts.bars:
        for k, (grid, end) in enumerate(zip(bar.grids, bar.ends, strict=True)):
            released = bar.released(k)
            if not released:
                continue
            name = _pin_name(bar, k)
            x, y, z = end * basis.units.length
            nodes.append({"name": name, "x_m": x, "y_m": y, "z_m": z})
            links.append(
                {
                    "name": f"pin_{name}",
                    "from": f"g{standing.carrier(grid)}",
                    "to": name,
                    **along_and_about("".join(sorted(set(ALL) - set(released))), bar.element_axes),
                }
            )
    return nodes, links


def _section_name(entry: Entry) -> str:
    if entry.name == "CONROD":
        return f"conrod{entry.id}"
    return f"{entry.name.replace('C', 'p', 1).lower()}{entry['pid']}"


def _names(section: str, made: ArticleSections) -> list[str]:
    """Names of a property's sections: its own, numbered along a taper."""
    count = len(made.tables)
    return [section] if count == 1 else [f"{section}_{k}" for k in range(1, count + 1)]


def _along(section: str, made: ArticleSections) -> dict[str, Any]:
    """The keys that struts of one property share."""
    names, count = _names(section, made), len(made.tables)
    if count == 1:
        return {"section": section}
    places = [*((k + 0.5) / count for k in range(count)), 1.0]
    stations = [{"at": at, "section": name} for at, name in zip(places, [*names, names[-1]], strict=True)]
    return {"section": names[0], "elements": count, "stations": stations}


def end_frame(basis: Basis, bar: Bar, end: int, standing: Standing) -> tuple[str, np.ndarray]:
    """The frame that an end of a strut is fixed to, a node of its own if pinned, and where on it."""
    if bar.released(end):
        return _pin_name(bar, end), np.zeros(3)
    carrier = standing.carrier(bar.grids[end])
    return f"g{carrier}", bar.ends[end] - basis.places.grids[carrier]


def _strut(basis: Basis, bar: Bar, standing: Standing) -> dict[str, Any]:
    ends = [end_frame(basis, bar, k, standing) for k in (0, 1)]
    table: dict[str, Any] = {"name": _strut_name(bar), "from": ends[0][0], "to": ends[1][0]}
    table["up"] = bar.up / np.linalg.norm(bar.up)
    if bar.entry.name in RODS:
        table["elements"] = 1  # two rods in line are a mechanism
    offsets = zip(("from_offset_m", "to_offset_m"), ends, strict=True)
    return table | {key: offset * basis.units.length for key, (_, offset) in offsets if np.any(offset)}


def _strut_name(bar: Bar) -> str:
    return f"{bar.entry.name[1:].lower()}{bar.entry.id}"


def _pin_name(bar: Bar, end: int) -> str:
    return f"{_strut_name(bar)}{'ab'[end]}"
