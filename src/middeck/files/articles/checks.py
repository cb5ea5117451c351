"""Faults of an article beyond the form of its keys: names, geometry, bodies.

The checks read the raw tables and skip values that the form has already refused, so that one run reports all.
"""

import itertools
from collections.abc import Iterator
from typing import Any, get_args

import numpy as np

from middeck.files.articles.boundary_checks import bushing_findings, clamp_findings
from middeck.files.articles.boundary_form import BushingForm, PrescribedForm, build_bushing
from middeck.files.articles.damping_checks import damping_findings
from middeck.files.articles.form import GimbalForm, NodeForm, RevoluteForm, State
from middeck.files.articles.link_form import link_findings
from middeck.files.articles.member_section_checks import section_findings
from middeck.files.articles.name_checks import AT_POINT, name_findings
from middeck.files.articles.names import damped_names, joint_names
from middeck.files.articles.unconnected import unconnected
from middeck.files.toml.faults import PathFault, finding, show
from middeck.files.toml.form import inertia_matrix, keys_of
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, all_numbers, array_of, is_number, is_vector, table_of, tables
from middeck.structure.elements.rotations import cross
from middeck.structure.model.article_checks import impossible_moments

FORMS = {"node": NodeForm, "gimbal": GimbalForm, "revolute": RevoluteForm}
# Tables of bodies: how keys of their inertia begin, and how names of their frames end.
BODIES = (("node", "", ""), ("revolute", "", ""), ("gimbal", "stage_", "_x"), ("gimbal", "payload_", "_z"))
# Decimal input of a flat body meets the triangle inequality with equality only to rounding.
ROUNDING = 1e-9


def article_findings(data: Table) -> list[PathFault]:
    """All faults of an article's content; ``data`` need not fit the form."""
    return [
        *section_findings(data),
        *name_findings(data),
        *_geometry(data),
        *unconnected(data),
        *_bodies(data),
        *_axes(data),
        *_proof_masses(data),
        *_wheels(data),
        *_ports(data),
        *_attach(data),
        *_cycles(data),
        *_boundaries(data),
        *damping_findings(data, damped_names(data)),
    ]


def _boundaries(data: Table) -> Iterator[PathFault]:
    yield from link_findings(data, joint_names(data))
    yield from bushing_findings(("bushing",), tables(data, "bushing"), BushingForm, build_bushing)
    for i, case in tables(data, "load_case"):
        path = ("load_case", i, "prescribed")
        yield from clamp_findings(path, tables(case, "prescribed"), PrescribedForm)
        for k, mass in tables(case, "mass"):
            if "inertia_kg_m2" in mass:
                place = ("load_case", i, "mass", k, "inertia_kg_m2")
                yield from _triangle(place, mass["inertia_kg_m2"], spins=False)


def _geometry(data: Table) -> Iterator[PathFault]:
    nodes = {t["name"]: t for _, t in tables(data, "node") if isinstance(t.get("name"), str)}
    for i, strut in tables(data, "strut"):
        a, b = nodes.get(str(strut.get("from"))), nodes.get(str(strut.get("to")))
        places = [_position(n) for n in (a, b) if n is not None]
        sizes = [n.get("size_m", 0.0) for n in (a, b) if n is not None]
        offsets = [strut.get(key, [0.0, 0.0, 0.0]) for key in ("from_offset_m", "to_offset_m")]
        if len(places) < 2 or places[0] is None or places[1] is None or not all_numbers(*sizes):
            continue
        if not all(map(is_vector, offsets)):
            continue
        along = places[1] - places[0] + np.subtract(offsets[1], offsets[0], dtype=float)
        spacing, taken = float(np.linalg.norm(along)), 0.5 * sum(sizes)
        ends = f"{strut['from']} to {strut['to']}"
        if spacing == 0.0 or spacing <= taken:
            message = f"a member of no length: its ends are {spacing:g} m apart and take {taken:g} m of it"
            yield PathFault(
                path=("strut", i, "to"),
                message=message,
                value=ends,
                hint="move the nodes apart or lessen size_m",
            )
        up = strut.get("up")
        if is_vector(up) and spacing > 0.0:
            way = np.array(up, dtype=float)
            if np.linalg.norm(cross(along / spacing, way)) <= 1e-6 * np.linalg.norm(way):  # own y axis open
                yield finding(("strut", i, "up"), "must not be zero nor along the member", up)


def _position(node: Table) -> np.ndarray | None:
    xyz = [node.get("x_m"), node.get("y_m", 0.0), node.get("z_m", 0.0)]
    return np.array(xyz, dtype=float) if all_numbers(*xyz) else None


def _bodies(data: Table) -> Iterator[PathFault]:
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


def _triangle(path: Path, inertia: Any, spins: bool) -> Iterator[PathFault]:
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


def _axes(data: Table) -> Iterator[PathFault]:
    """Spring and target keys belong to one state each; where an axis begins must lie within its travel."""
    for table, middles in (("gimbal", ("_x", "_z")), ("revolute", ("",))):
        for (i, t), middle in itertools.product(tables(data, table), middles):
            yield from _axis_state((table, i), t, middle)
            driven = t.get(f"state{middle}") == "driven"
            start = f"command{middle}_deg" if driven and f"command{middle}_deg" in t else f"angle{middle}_deg"
            yield from _travel((table, i), t, f"travel{middle}_deg", start)
    for i, t in tables(data, "proof_mass"):
        yield from _travel(("proof_mass", i), t, "travel_m", "travel_m")


def _travel(path: Path, t: Table, key: str, start: str) -> Iterator[PathFault]:
    ends = array_of(t, key)
    if len(ends) != 2 or not all_numbers(*ends):  # the form has refused it, or there is none
        return
    at = 0.0 if start == key else t.get(start, 0.0)
    if ends[0] < ends[1] and all_numbers(at) and not ends[0] <= at <= ends[1]:
        place = (*path, start if start in t else key)
        message = f"outside of {key} = {show(ends)}" if start != key else "must hold 0, where the mass begins"
        yield finding(place, message, t.get(start, 0.0), hint="widen the travel or move the angle")


def _proof_masses(data: Table) -> Iterator[PathFault]:
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


def _wheels(data: Table) -> Iterator[PathFault]:
    """Across its axis a rotor has half of its inertia about it, or more: its frame's body has that too."""
    bodies = {f"{t.get('name')}{end}": t.get(f"{part}inertia_kg_m2") for table, part, end in BODIES
              for _, t in tables(data, table)}  # fmt: skip
    in_component = {name for _, c in tables(data, "component") for name in table_of(c, "nodes").values()}
    for i, t in tables(data, "wheel"):
        frame, axis, rotor = str(t.get("frame")), array_of(t, "axis"), t.get("rotor_inertia_kg_m2")
        known = frame in bodies and frame not in in_component
        if not (known and is_vector(axis) and any(axis) and rotor is not None and is_number(rotor)):
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


def _ports(data: Table) -> Iterator[PathFault]:
    """A force, an accelerometer or a displacement has a point and an axis; a torque or an angle does not."""
    for table in ("actuator", "sensor"):
        for i, t in tables(data, table):
            kind = str(t.get("kind"))  # what is no text, the form has refused
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


def _axis_state(path: Path, t: Table, middle: str) -> Iterator[PathFault]:
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


def _attach(data: Table) -> Iterator[PathFault]:
    suspension = table_of(data, "suspension")
    nodes, offsets = array_of(suspension, "nodes"), array_of(suspension, "offsets_m")
    if {"nodes", "offsets_m"} <= set(suspension) and len(nodes) != len(offsets):
        message = f"{len(offsets)} offsets for {len(nodes)} nodes; must be one each, in m"
        yield finding(("suspension", "offsets_m"), message)
    for i, t in tables(data, "spring"):
        if t.get("from") == t.get("to"):
            yield finding(("spring", i, "to"), "a spring from an attach point to itself", t.get("to"))


def _cycles(data: Table) -> Iterator[PathFault]:
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
