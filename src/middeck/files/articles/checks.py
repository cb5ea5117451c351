"""Faults of an article beyond the form of its keys: names, geometry, bodies.

The checks read the raw tables and pass over what the form has already refused, so that one run reports all.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, cast, get_args

import numpy as np
from pydantic_core import PydanticCustomError

from middeck.files.articles.boundary_checks import bushing_findings, clamp_findings
from middeck.files.articles.boundary_form import BushingForm, PrescribedForm, build_bushing
from middeck.files.articles.damping_checks import damping_findings
from middeck.files.articles.form import GimbalForm, NodeForm, RevoluteForm, State, section_stiffness
from middeck.files.articles.link_form import link_findings, link_names, linked_frames
from middeck.files.articles.names import (
    attach_names,
    damped_names,
    joint_names,
    named_tables,
    node_names,
)
from middeck.files.articles.unconnected import unconnected
from middeck.files.toml.faults import Finding, finding, nearest, show
from middeck.files.toml.form import inertia_matrix, keys_of
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, array_of, is_number, table_of, tables
from middeck.structure.elements.rotations import cross
from middeck.structure.model.inertia import impossible_moments
from middeck.structure.model.section_checks import RIGID_IN_SHEAR, stiffness_faults

TUBE_KEYS = ("outer_diameter_m", "inner_diameter_m", "shear")
STIFFNESS_KEYS = ("EA_n", "GJ_nm2", "EI_y_nm2", "EI_z_nm2", "rho_A_kg_per_m")
SHEAR_KEYS = ("GA_y_n", "GA_z_n")
INERTIA_KEYS = ("rho_A_kg_per_m", "rho_I_y_kg_m", "rho_I_z_kg_m")
GENERAL_KEYS = (*STIFFNESS_KEYS, *SHEAR_KEYS, *INERTIA_KEYS[1:])
AT_POINT = {"force": "a force", "accelerometer": "an accelerometer", "displacement": "a displacement"}
FORMS = {"node": NodeForm, "gimbal": GimbalForm, "revolute": RevoluteForm}
# Tables of bodies: how keys of their inertia begin, and how names of their frames end.
BODIES = (("node", "", ""), ("revolute", "", ""), ("gimbal", "stage_", "_x"), ("gimbal", "payload_", "_z"))
# Decimal input of a flat body meets the triangle inequality with equality only to rounding.
ROUNDING = 1e-9


def article_findings(data: Table) -> list[Finding]:
    """All faults of an article's content; ``data`` need not fit the form."""
    return [
        *_sections(data),
        *_stations(data),
        *_names(data),
        *_references(data),
        *_geometry(data),
        *unconnected(data),
        *_bodies(data),
        *_axes(data),
        *_travels(data),
        *_proof_masses(data),
        *_wheels(data),
        *_ports(data),
        *_attach(data),
        *_cycles(data),
        *_boundaries(data),
        *damping_findings(data, damped_names(data)),
    ]


def _boundaries(data: Table) -> Iterator[Finding]:
    yield from link_findings(data, joint_names(data))
    yield from bushing_findings(("bushing",), tables(data, "bushing"), BushingForm, build_bushing)
    for i, case in tables(data, "load_case"):
        path = ("load_case", i, "prescribed")
        yield from clamp_findings(path, tables(case, "prescribed"), PrescribedForm)
        for k, mass in tables(case, "mass"):
            if "inertia_kg_m2" in mass:
                place = ("load_case", i, "mass", k, "inertia_kg_m2")
                yield from _triangle(place, mass["inertia_kg_m2"], spins=False)


def _sections(data: Table) -> Iterator[Finding]:
    materials = named_tables(data, "material")
    for name, section in named_tables(data, "section").items():
        path = ("section", name)
        if "stiffness" in section:
            yield from _matrix(path, section)
            continue
        tube, general = "material" in section, any(k in section for k in GENERAL_KEYS)
        if not tube and not general:
            yield finding(
                (*path, "material"),
                "missing",
                hint="a material and diameters, stiffness, or EA_n ...",
            )
        for key in (k for k in (GENERAL_KEYS if tube else TUBE_KEYS if general else ()) if k in section):
            kind = "material and diameters" if tube else "stiffnesses"
            yield finding((*path, key), f"a section by its {kind} has no such key", section[key])
        for key in (k for k in STIFFNESS_KEYS if general and not tube and k not in section):
            yield finding((*path, key), "missing in a section by its stiffnesses")
        if not tube:
            continue
        yield from _unknown((*path, "material"), section["material"], list(materials), "material")
        outer, inner = section.get("outer_diameter_m"), section.get("inner_diameter_m", 0.0)
        if outer is None:
            yield finding((*path, "outer_diameter_m"), "missing, in m")
        elif _all_numbers(outer, inner) and not inner < outer:
            yield finding((*path, "inner_diameter_m"), f"must be < outer_diameter_m = {outer:g} m", inner)


def _matrix(path: Path, section: Table) -> Iterator[Finding]:
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


def _stations(data: Table) -> Iterator[Finding]:
    """Sections along tapered members: in order, up to the end, of one kind."""
    sections = named_tables(data, "section")
    for i, strut in tables(data, "strut"):
        reach, kinds = 0.0, {_kind(sections.get(str(strut.get("section"))))}
        for k, station in tables(strut, "stations"):
            path = ("strut", i, "stations", k)
            yield from _unknown((*path, "section"), station.get("section"), list(sections), "section")
            kinds.add(_kind(sections.get(str(station.get("section")))))
            if not _all_numbers(station.get("at")):  # reported by the form
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
    """What sections of one member share; None for a section that there is not."""
    if section is None:
        return None
    full = len(array_of(section, "stiffness")) > len(RIGID_IN_SHEAR)
    shears = (full or key in section for key in ("GA_y_n", "GA_z_n"))
    return ("shear" in section, *shears, section.get("mass", "consistent"))


def _names(data: Table) -> Iterator[Finding]:
    """Frames share one name space; attach points, members and either side of ports have theirs."""
    frames = _named(data, "node")
    for i, t in tables(data, "gimbal"):
        frames += [(("gimbal", i, "name"), f"{t.get('name')}_{a}") for a in "xz"]
    for table in ("revolute", "proof_mass"):
        frames += _named(data, table)
    yield from _twice(frames, "frame")
    points: list[tuple[Path, Any]] = [
        (("suspension", "nodes", i), n) for i, n in enumerate(array_of(table_of(data, "suspension"), "nodes"))
    ]
    yield from _twice([*points, *_named(data, "attach")], "attach point")
    yield from _twice(_named(data, "load_case"), "load case")
    yield from _twice(_named(data, "component"), "component")
    yield from _twice(_named(data, "wheel"), "wheel")
    yield from _twice(link_names(data), "link")
    for kind in ("strut", "spring", "bushing"):
        ends = [(i, t, t.get("name", f"{t.get('from')}-{t.get('to')}")) for i, t in tables(data, kind)]
        yield from _twice([((kind, i, "name" if "name" in t else "from"), n) for i, t, n in ends], kind)
    for kind in ("actuator", "sensor"):
        ports: list[tuple[Path, Any]] = [((kind,), name) for name in _default_ports(data, kind)]
        yield from _twice([*ports, *_named(data, kind)], kind)


def _named(data: Table, table: str) -> list[tuple[Path, Any]]:
    return [((table, i, "name"), t.get("name")) for i, t in tables(data, table)]


def _default_ports(data: Table, kind: str) -> list[str]:
    ports = [f"bus_{a}" for a in "xyz"] if "wheel_node" in data else []
    for _, t in tables(data, "gimbal"):
        ports += [f"{t.get('name')}_rel_{a}" for a in "xz"]
        ports += [f"{t.get('name')}_in_{a}" for a in "xz"] if kind == "sensor" else []
    ports += [str(t.get("name")) for _, t in tables(data, "wheel")]
    slides_or_turns = (*tables(data, "revolute"), *tables(data, "proof_mass"))
    return ports + [f"{t.get('name')}_rel" for _, t in slides_or_turns]


def _twice(named: Sequence[tuple[Path, Any]], kind: str) -> Iterator[Finding]:
    seen: set[Any] = set()
    for path, name in named:
        if isinstance(name, str) and name in seen:
            yield finding(path, f"a second {kind} of this name", name, hint="give each its own name")
        seen.add(name if isinstance(name, str) else None)


def _references(data: Table) -> Iterator[Finding]:
    nodes, joints = dict.fromkeys(node_names(data)), dict.fromkeys(joint_names(data))
    frames, points = nodes | joints, dict.fromkeys(attach_names(data))
    sections = dict.fromkeys(named_tables(data, "section"))
    unknown = partial(
        _unknown, carriers={str(t.get("name")): t.get("frame") for _, t in tables(data, "attach")}
    )
    if "wheel_node" in data:
        yield from unknown(("wheel_node",), data["wheel_node"], nodes, "node")
    wanted = [
        ("strut", "from", nodes, "node"),
        ("strut", "to", nodes, "node"),
        ("strut", "section", sections, "section"),
        ("gimbal", "node", frames, "frame"),
        ("revolute", "parent", frames, "frame"),
        ("proof_mass", "node", frames, "frame"),
        ("attach", "frame", frames, "frame"),
        ("wheel", "frame", frames, "frame"),
        ("spring", "from", points, "attach point"),
        ("spring", "to", points, "attach point"),
        ("sensor", "axis_frame", frames, "frame"),
        ("bushing", "from", points, "attach point"),
        ("bushing", "to", points, "attach point"),
    ]
    for i, component in tables(data, "component"):
        for grid, name in table_of(component, "nodes").items():
            yield from unknown(("component", i, "nodes", grid), name, frames, "frame")
    for ends in linked_frames(data):
        for path, name in ends:
            yield from unknown(path, name, frames, "frame")
    yield from _case_references(data, nodes, frames, unknown)
    for table, key, known, kind in wanted:
        for i, t in tables(data, table):
            if key in t:
                yield from unknown((table, i, key), t[key], known, kind)
    for table in ("actuator", "sensor"):
        for i, t in tables(data, table):
            anywhere = "axis" in t or t.get("kind") in AT_POINT
            known, kind = (frames, "frame") if anywhere else (joints, "joint (or give an axis)")
            yield from unknown((table, i, "frame"), t.get("frame"), known, kind)
    for i, name in enumerate(array_of(table_of(data, "suspension"), "nodes")):
        yield from unknown(("suspension", "nodes", i), name, frames, "frame")


def _case_references(
    data: Table, nodes: Collection[str], frames: Collection[str], unknown: Callable[..., Iterator[Finding]]
) -> Iterator[Finding]:
    """Frames and nodes that load cases name."""
    wanted = (("load", "frame", frames), ("mass", "frame", frames), ("prescribed", "node", nodes))
    for i, case in tables(data, "load_case"):
        for table, key, known in wanted:
            for k, t in tables(case, table):
                yield from unknown(("load_case", i, table, k, key), t.get(key), known, key)


def _unknown(
    path: Path,
    name: Any,
    known: Collection[str],
    kind: str,
    carriers: Mapping[str, Any] | None = None,
) -> Iterator[Finding]:
    """A name that is not ``known``; ``carriers`` are the frames of attach points, which may be meant."""
    if isinstance(name, str) and name not in known:
        hint = nearest(name, known) or f"define a {kind} first"
        if carriers and name in carriers and kind != "section":
            frame = show(carriers[name])
            hint = f"it is an attach point on {frame}: name that, and its offset_m as the place there"
        yield finding(path, f"no {kind} of this name", name, hint=hint)


def _geometry(data: Table) -> Iterator[Finding]:
    nodes = {t["name"]: t for _, t in tables(data, "node") if isinstance(t.get("name"), str)}
    for i, strut in tables(data, "strut"):
        a, b = nodes.get(str(strut.get("from"))), nodes.get(str(strut.get("to")))
        places = [_position(n) for n in (a, b) if n is not None]
        sizes = [n.get("size_m", 0.0) for n in (a, b) if n is not None]
        offsets = [strut.get(key, [0.0, 0.0, 0.0]) for key in ("from_offset_m", "to_offset_m")]
        if len(places) < 2 or places[0] is None or places[1] is None or not _all_numbers(*sizes):
            continue
        if not all(map(_is_vector, offsets)):
            continue
        along = places[1] - places[0] + np.subtract(offsets[1], offsets[0], dtype=float)
        spacing, taken = float(np.linalg.norm(along)), 0.5 * sum(sizes)
        ends = f"{strut['from']} to {strut['to']}"
        if spacing == 0.0 or spacing <= taken:
            message = f"a member of no length: its ends are {spacing:g} m apart and take {taken:g} m of it"
            yield Finding(
                path=("strut", i, "to"),
                message=message,
                value=ends,
                hint="move the nodes apart or lessen size_m",
            )
        up = strut.get("up")
        if _is_vector(up) and spacing > 0.0:
            way = np.array(up, dtype=float)
            if np.linalg.norm(cross(along / spacing, way)) <= 1e-6 * np.linalg.norm(way):  # own y axis open
                yield finding(("strut", i, "up"), "must not be zero nor along the member", up)


def _position(node: Table) -> np.ndarray | None:
    xyz = [node.get("x_m"), node.get("y_m", 0.0), node.get("z_m", 0.0)]
    return np.array(xyz, dtype=float) if _all_numbers(*xyz) else None


def _all_numbers(*values: Any) -> bool:
    return all(is_number(v) and math.isfinite(v) for v in values)


def _is_vector(value: Any) -> bool:
    items = cast("list[Any]", value) if isinstance(value, list) else []
    return len(items) == 3 and _all_numbers(*items)


def _bodies(data: Table) -> Iterator[Finding]:
    for table, prefix in (("node", ""), ("revolute", ""), ("gimbal", "stage_"), ("gimbal", "payload_")):
        for i, t in tables(data, table):
            key = f"{prefix}inertia_kg_m2"
            if key not in t:
                continue
            whole = set(t) <= set(keys_of(FORMS[table]))  # else the mass may be there, misspelt
            spins = "rotors_excluded" in keys_of(FORMS[table])
            if spins and t.get("rotors_excluded"):  # no inertia of a whole body
                continue
            if t.get(f"{prefix}mass_kg", 0.0) == 0.0 and whole:
                yield finding((table, i, key), "an inertia without mass", hint=f"give {prefix}mass_kg")
            yield from _triangle((table, i, key), t[key], spins)


def _triangle(path: Path, inertia: Any, spins: bool) -> Iterator[Finding]:
    """The sum of two principal inertias is at least the third; not so without what ``spins`` in it."""
    try:
        moments = impossible_moments(np.array(inertia_matrix(inertia)))
    except ValueError:  # the form has refused it
        return
    if moments is not None:
        a, b, c = moments
        message = f"no body has this inertia: {a:g} + {b:g} < {c:g} kg m^2 (triangle inequality)"
        advice = f"{c:g} or more for the sum of the smaller two; a flat plate has just that"
        rotors = "; or rotors_excluded = true if it leaves spinning rotors out" if spins else ""
        yield finding(path, message, inertia, hint=advice + rotors)


def _axes(data: Table) -> Iterator[Finding]:
    """Axis vectors must have a length; spring and target keys belong to one state each."""
    for table in ("revolute", "proof_mass", "wheel", "actuator", "sensor"):
        for i, t in tables(data, table):
            if _is_vector(t.get("axis")) and not any(t["axis"]):
                yield finding((table, i, "axis"), "must not be the zero vector", t["axis"])
    for table, middles in (("gimbal", ("_x", "_z")), ("revolute", ("",))):
        for (i, t), middle in itertools.product(tables(data, table), middles):
            yield from _axis_state((table, i), t, middle)


def _travels(data: Table) -> Iterator[Finding]:
    """A travel runs from least to largest; where the axis begins must lie within."""
    for table, middles in (("gimbal", ("_x", "_z")), ("revolute", ("",))):
        for (i, t), middle in itertools.product(tables(data, table), middles):
            driven = t.get(f"state{middle}") == "driven"
            start = f"command{middle}_deg" if driven and f"command{middle}_deg" in t else f"angle{middle}_deg"
            yield from _travel((table, i), t, f"travel{middle}_deg", start)
    for i, t in tables(data, "proof_mass"):
        yield from _travel(("proof_mass", i), t, "travel_m", "travel_m")


def _travel(path: Path, t: Table, key: str, start: str) -> Iterator[Finding]:
    ends = array_of(t, key)
    if len(ends) != 2 or not _all_numbers(*ends):  # the form has refused it, or there is none
        return
    at = 0.0 if start == key else t.get(start, 0.0)
    if not ends[0] < ends[1]:
        yield finding((*path, key), "must rise from the least to the largest", ends)
    elif _all_numbers(at) and not ends[0] <= at <= ends[1]:
        place = (*path, start if start in t else key)
        message = f"outside of {key} = {show(ends)}" if start != key else "must hold 0, where the mass begins"
        yield finding(place, message, t.get(start, 0.0), hint="widen the travel or move the angle")


def _proof_masses(data: Table) -> Iterator[Finding]:
    """One spring, by its stiffness or by its frequency."""
    for i, t in tables(data, "proof_mass"):
        given = [key for key in ("stiffness_n_per_m", "natural_hz") if key in t]
        if not given:
            message = "missing; a proof mass needs it, or natural_hz"
            yield finding(("proof_mass", i, "stiffness_n_per_m"), message)
        elif len(given) == 2:
            yield finding(
                ("proof_mass", i, "natural_hz"),
                "beside stiffness_n_per_m",
                t["natural_hz"],
                hint="leave out one of the two",
            )


def _wheels(data: Table) -> Iterator[Finding]:
    """Across its axis a rotor has half of its inertia about it, or more: its frame's body has that too."""
    bodies = {f"{t.get('name')}{end}": t.get(f"{part}inertia_kg_m2") for table, part, end in BODIES
              for _, t in tables(data, table)}  # fmt: skip
    in_component = {name for _, c in tables(data, "component") for name in table_of(c, "nodes").values()}
    for i, t in tables(data, "wheel"):
        frame, axis, rotor = str(t.get("frame")), array_of(t, "axis"), t.get("rotor_inertia_kg_m2")
        known = frame in bodies and frame not in in_component
        if not (known and _is_vector(axis) and any(axis) and rotor is not None and is_number(rotor)):
            continue
        try:
            own = np.zeros((3, 3)) if bodies[frame] is None else np.array(inertia_matrix(bodies[frame]))
        except ValueError:  # the form has refused it
            continue
        across = np.linalg.svd(np.array([axis], dtype=float))[2][1:].T
        least = float(np.linalg.eigvalsh(across.T @ own @ across)[0])
        if least < 0.5 * rotor * (1.0 - ROUNDING):
            yield finding(
                ("wheel", i, "rotor_inertia_kg_m2"),
                f"a rotor has half of this across its axis or more, and frame {frame!r} has {least:g} kg m^2",
                rotor,
                hint="give the frame the rotor's mass and its inertia across the axis (inertia_kg_m2)",
            )


def _ports(data: Table) -> Iterator[Finding]:
    """A force, an accelerometer or a displacement has a point and an axis; a torque or an angle does not."""
    for table in ("actuator", "sensor"):
        for i, t in tables(data, table):
            kind = t.get("kind")
            if kind in AT_POINT and "axis" not in t:
                yield finding((table, i, "axis"), f"missing; {AT_POINT[kind]} needs one")
            if kind not in AT_POINT and "offset_m" in t:
                message = "a torque or an angle is the same all over its frame: it has no offset"
                yield finding((table, i, "offset_m"), message, t["offset_m"])
            if kind == "displacement" and "axis_frame" in t:
                message = "a displacement is along an axis of the world, which stands still"
                yield finding((table, i, "axis_frame"), message, t["axis_frame"], hint="leave it out")
            if kind == "accelerometer" and t.get("axis_frame", t.get("frame")) != t.get("frame"):
                message = "an accelerometer's axis is fixed to its own frame"
                yield finding((table, i, "axis_frame"), message, t["axis_frame"], hint="leave it out")


def _axis_state(path: Path, t: Table, middle: str) -> Iterator[Finding]:
    state = t.get(f"state{middle}", "free")
    stiffness = f"stiffness{middle}_nm_per_rad"
    if state == "sprung" and stiffness not in t:
        yield finding((*path, stiffness), "missing: a sprung axis needs its stiffness, in N m/rad")
    owners = {stiffness: "sprung", f"rest{middle}_deg": "sprung", f"command{middle}_deg": "driven"}
    for key, owner in owners.items():
        if key in t and state != owner and state in get_args(State):
            advice = f'state{middle} = "{owner}"'
            yield finding(
                (*path, key), f"only a {owner} axis has this; this one is {state}", t[key], hint=advice
            )


def _attach(data: Table) -> Iterator[Finding]:
    suspension = table_of(data, "suspension")
    nodes, offsets = array_of(suspension, "nodes"), array_of(suspension, "offsets_m")
    if {"nodes", "offsets_m"} <= set(suspension) and len(nodes) != len(offsets):
        message = f"{len(offsets)} offsets for {len(nodes)} nodes; must be one each, in m"
        yield finding(("suspension", "offsets_m"), message)
    for i, t in tables(data, "spring"):
        if t.get("from") == t.get("to"):
            yield finding(("spring", i, "to"), "a spring from an attach point to itself", t.get("to"))


def _cycles(data: Table) -> Iterator[Finding]:
    """Every chain of joints must end at a node."""
    parents: dict[str, tuple[str, Path]] = {}
    for i, t in tables(data, "gimbal"):
        parents[f"{t.get('name')}_x"] = (str(t.get("node")), ("gimbal", i, "node"))
        parents[f"{t.get('name')}_z"] = (f"{t.get('name')}_x", ("gimbal", i, "node"))
    for i, t in tables(data, "revolute"):
        parents[str(t.get("name"))] = (str(t.get("parent")), ("revolute", i, "parent"))
    for i, t in tables(data, "proof_mass"):
        parents[str(t.get("name"))] = (str(t.get("node")), ("proof_mass", i, "node"))
    for name, (parent, path) in parents.items():
        trail = {name}
        while parent in parents and parent not in trail:
            trail.add(parent)
            parent = parents[parent][0]
        if parent == name:
            yield finding(
                path, f"joint {name!r} carries itself", hint="let the chain of joints end at a node"
            )
