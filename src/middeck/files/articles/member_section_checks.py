"""Faults of sections and of their stations along members."""

from collections.abc import Iterator

import numpy as np
from pydantic_core import PydanticCustomError

from middeck.files.articles.form import section_stiffness
from middeck.files.articles.name_checks import unknown_name
from middeck.files.articles.names import named_tables
from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, all_numbers, array_of, tables
from middeck.structure.model.section_and_bushing_checks import RIGID_IN_SHEAR, stiffness_faults

TUBE_KEYS = ("outer_diameter_m", "inner_diameter_m", "shear")
STIFFNESS_KEYS = ("EA_n", "GJ_nm2", "EI_y_nm2", "EI_z_nm2", "rho_A_kg_per_m")
SHEAR_KEYS = ("GA_y_n", "GA_z_n")
INERTIA_KEYS = ("rho_A_kg_per_m", "rho_I_y_kg_m", "rho_I_z_kg_m")
GENERAL_KEYS = (*STIFFNESS_KEYS, *SHEAR_KEYS, *INERTIA_KEYS[1:])


def section_findings(data: Table) -> Iterator[PathFault]:
    """Sections of two kinds or of half a kind, and stations out of order."""
    yield from _sections(data)
    yield from _stations(data)


def _sections(data: Table) -> Iterator[PathFault]:
    materials = named_tables(data, "material")
    for name, section in named_tables(data, "section").items():
        path = ("section", name)
        if "stiffness" in section:
            yield from _matrix(path, section)
            continue
        tube, general = "material" in section, any(k in section for k in GENERAL_KEYS)
        if not tube and not general:
            yield finding(
                (*path, "material"), "missing", hint="a material and diameters, stiffness, or EA_n ..."
            )
        for key in (k for k in (GENERAL_KEYS if tube else TUBE_KEYS if general else ()) if k in section):
            kind = "material and diameters" if tube else "stiffnesses"
            yield finding((*path, key), f"a section by its {kind} has no such key", section[key])
        for key in (k for k in STIFFNESS_KEYS if general and not tube and k not in section):
            yield finding((*path, key), "missing in a section by its stiffnesses")
        if not tube:
            continue
        yield from unknown_name((*path, "material"), section["material"], list(materials), "material")
        outer, inner = section.get("outer_diameter_m"), section.get("inner_diameter_m", 0.0)
        if outer is None:
            yield finding((*path, "outer_diameter_m"), "missing, in m")
        elif all_numbers(outer, inner) and not inner < outer:
            yield finding((*path, "inner_diameter_m"), f"must be < outer_diameter_m = {outer:g} m", inner)


def _matrix(path: Path, section: Table) -> Iterator[PathFault]:
    """Faults of a section by its stiffness matrix."""
    others = ("material", *TUBE_KEYS, *STIFFNESS_KEYS[:-1], *SHEAR_KEYS, "centroid_m")
    for key in (k for k in others if k in section):
        yield finding((*path, key), "a section by its matrix has no such key", section[key])
    if "rho_A_kg_per_m" not in section:
        yield finding((*path, "rho_A_kg_per_m"), "missing in a section by its matrix")
    try:
        matrix = np.array(section_stiffness(section["stiffness"]))
    except PydanticCustomError:  # reported by the form
        return
    yield from (finding((*path, "stiffness"), fault) for fault in stiffness_faults(matrix))


def _stations(data: Table) -> Iterator[PathFault]:
    """Sections along tapered members: in order, up to the end, of one kind."""
    sections = named_tables(data, "section")
    for i, strut in tables(data, "strut"):
        reach, kinds = 0.0, {_kind(sections.get(str(strut.get("section"))))}
        for k, station in tables(strut, "stations"):
            path = ("strut", i, "stations", k)
            yield from unknown_name((*path, "section"), station.get("section"), list(sections), "section")
            kinds.add(_kind(sections.get(str(station.get("section")))))
            if not all_numbers(station.get("at")):  # reported by the form
                continue
            at = float(station["at"])
            if not at > reach:
                yield finding((*path, "at"), f"must be > {reach:g}, where the section before it is", at)
            reach = at
        if "stations" in strut and reach != 1.0:
            yield finding(("strut", i, "stations"), "the last one is at 1, the end of the member", reach)
        if len(kinds - {None}) > 1:
            message = "its sections are rigid in shear at some stations only, or have two kinds of mass"
            yield finding(("strut", i, "stations"), message)


def _kind(section: Table | None) -> tuple[object, ...] | None:
    """The properties that sections of one member share; None for a section that does not exist."""
    if section is None:
        return None
    full = len(array_of(section, "stiffness")) > len(RIGID_IN_SHEAR)
    shears = (full or key in section for key in ("GA_y_n", "GA_z_n"))
    return ("shear" in section, *shears, section.get("mass", "consistent"))
