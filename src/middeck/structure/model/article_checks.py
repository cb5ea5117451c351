"""Requirements of a `Structure` before it is meshed, however it was made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.model.article import Body, Member, Structure, held_angle
from middeck.structure.model.component import component_faults
from middeck.structure.model.connectivity import (
    joined_nodes,
    redrawing_commands,
    separate_parts,
    some_names,
)
from middeck.structure.model.links import link_faults
from middeck.structure.model.member_mesh import member_geometry
from middeck.structure.model.section import Section
from middeck.structure.model.section_and_bushing_checks import bushing_faults, stiffness_faults

FIELDS = ("EA", "GJ", "EI_y", "EI_z", "rho_A", "rho_I_y", "rho_I_z")
# A unit axis is one to rounding; anything further off is a mistake.
UNIT_ERROR = 1e-9


def check_structure(structure: Structure) -> None:
    """Raise one `ConfigError` with all that is wrong."""
    faults = [
        *_twice(structure),
        *_unknown_names(structure),
        *_bodies(structure),
        *_stiffnesses(structure),
        *_stations(structure),
        *_offsets(structure),
        *_axes(structure),
        *_travels(structure),
        *_ties_and_loads(structure),
        *_wheels(structure),
        *(fault for component in structure.components for fault in component_faults(component)),
    ]
    joints = {joint.name for joint in structure.joints}
    faults = faults or [f for link in structure.links for f in link_faults(link, joints)]
    faults = faults or [
        *_members(structure),
        *_parts(structure),
        *redrawing_commands(structure),
    ]  # these need the names to be right
    if faults:
        raise ConfigError(
            "; ".join(faults),
            where=f"structure {structure.title!r}",
            hint="files are checked with line numbers by load_structure and by every verb",
        )


def _twice(structure: Structure) -> Iterator[str]:
    groups = {
        "frame": (*structure.nodes, *structure.joints),
        "attach point": structure.attach_points,
        "member": structure.members,
        "actuator": structure.actuators,
        "sensor": structure.sensors,
        "bushing": structure.bushings,
        "mass": structure.masses,
        "load": structure.loads,
        "load case": structure.load_cases,
        "component": structure.components,
        "link": structure.links,
        "wheel": structure.wheels,
    }
    for kind, parts in groups.items():
        count = Counter(part.name for part in parts)
        for name in sorted(n for n, times in count.items() if times > 1):
            yield f"{kind} {name!r} is there twice"


def _unknown_names(structure: Structure) -> Iterator[str]:
    nodes = {n.name for n in structure.nodes}
    joints = {j.name for j in structure.joints}
    attach = {a.name for a in structure.attach_points}
    carriers = set(nodes)
    for joint in structure.joints:
        if joint.parent not in carriers:
            yield f"joint {joint.name!r} hangs on {joint.parent!r}, neither a node nor an earlier joint"
        carriers.add(joint.name)
    between = (
        ("member", structure.members, "node", nodes),
        ("spring", structure.springs, "attach point", attach),
        ("bushing", structure.bushings, "attach point", attach),
    )
    uses = [
        (what, part.name, kind, end, known)
        for what, parts, kind, known in between
        for part in parts
        for end in (part.start, part.end)
    ]
    on_frames = (
        ("attach point", structure.attach_points),
        ("mass", structure.masses),
        ("load", structure.loads),
        ("wheel", structure.wheels),
    )
    uses += [(what, part.name, "frame", part.frame, carriers) for what, parts in on_frames for part in parts]
    for what, parts in (("link", structure.links), ("component", structure.components)):
        uses += [(what, part.name, "frame", frame, carriers) for part in parts for frame in part.frames]
    for port in (*structure.actuators, *structure.sensors):
        kind, known = ("joint", joints) if port.axis is None else ("frame", carriers)
        uses.append(("port", port.name, kind, port.frame, known))
    uses += [("sensor", s.name, "frame", s.axis_frame, carriers) for s in structure.sensors if s.axis_frame]
    for what, name, kind, used, known in uses:
        if used not in known:
            yield f"{what} {name!r} names {kind} {used!r}, which does not exist"


def _bodies(structure: Structure) -> Iterator[str]:
    for part in (*structure.nodes, *structure.joints, *structure.masses):
        if not _possible(part.body):
            yield (
                f"{part.name!r} carries a body whose mass or inertia is negative or not a number, or whose "
                "inertia is not symmetric to the last digit: take (I + I.T) / 2"
            )
        elif not part.body.rotors_excluded and np.any(part.body.inertia):
            yield from _triangle(part.name, part.body.inertia)


def _triangle(name: str, inertia: np.ndarray) -> Iterator[str]:
    moments = impossible_moments(inertia)
    if moments is not None:
        a, b, c = moments
        yield (
            f"{name!r} carries a body whose inertia none has: {a:g} + {b:g} < {c:g} kg m^2 (triangle "
            "inequality); rotors_excluded says that it leaves spinning rotors out"
        )


def _offsets(structure: Structure) -> Iterator[str]:
    for what, part, vector in (
        *(("attach point", a, a.offset) for a in structure.attach_points),
        *(("joint", j, j.offset) for j in structure.joints),
        *(("node", n, n.position) for n in structure.nodes),
    ):
        if not np.all(np.isfinite(vector)):
            yield f"{what} {part.name!r} stands at {vector.tolist()}: not three finite numbers"


def _possible(body: Body) -> bool:
    numbers = np.concatenate([[body.mass], body.cg, body.inertia.ravel()])
    if not np.all(np.isfinite(numbers)) or not np.array_equal(body.inertia, body.inertia.T):
        return False
    least = np.linalg.eigvalsh(body.inertia)[0] if np.any(body.inertia) else 0.0  # most grids have none
    return body.mass >= 0.0 and bool(least >= -UNIT_ERROR * np.abs(body.inertia).max())


def _stiffnesses(structure: Structure) -> Iterator[str]:
    """Stiffnesses of sections, springs and joints must be numbers, none of them negative."""
    sections = {id(s): (m.name, s) for m in structure.members for s in _every_section(m)}
    for name, section in sections.values():
        yield from (f"member {name!r}: {fault}" for fault in stiffness_faults(section.stiffness))
    parts = [
        *((f"member {name!r}", s, FIELDS, s.GA_y > 0.0 and s.GA_z > 0.0) for name, s in sections.values()),
        *((f"spring {s.name!r}", s, ("stiffness", "free_length"), True) for s in structure.springs),
        *((f"joint {j.name!r}", j, ("stiffness",), np.isfinite(j.target)) for j in structure.joints),
    ]
    for what, part, fields, more in parts:
        wrong = [f for f in fields if not (np.isfinite(getattr(part, f)) and getattr(part, f) >= 0.0)]
        if wrong or not more:
            named = ", ".join(f"{f} = {getattr(part, f):g}" for f in wrong) or "GA or target"
            yield f"{what} has {named}: not a number, infinite or negative"


def _every_section(member: Member) -> tuple[Section, ...]:
    return (member.section, *(section for _, section in member.stations))


def _stations(structure: Structure) -> Iterator[str]:
    for member in structure.members:
        reach = [0.0, *(at for at, _ in member.stations)]
        if member.stations and not (np.all(np.diff(reach) > 0.0) and reach[-1] == 1.0):
            yield f"member {member.name!r} has stations at {reach[1:]}: they ascend from above 0 up to 1"
        if len({(np.isfinite(s.GA_y), np.isfinite(s.GA_z), s.mass) for s in _every_section(member)}) > 1:
            yield f"member {member.name!r} is rigid in shear at some stations only, or has two kinds of mass"


def _axes(structure: Structure) -> Iterator[str]:
    axes = [("joint", j.name, j.axis) for j in structure.joints]
    axes += [("wheel", w.name, w.axis) for w in structure.wheels]
    axes += [
        ("port", p.name, p.axis) for p in (*structure.actuators, *structure.sensors) if p.axis is not None
    ]
    for what, name, axis in axes:
        if not abs(np.linalg.norm(axis) - 1.0) < UNIT_ERROR:
            yield f"{what} {name!r} has axis {axis.tolist()}, which is no unit vector"


def _ties_and_loads(structure: Structure) -> Iterator[str]:
    for bushing in structure.bushings:
        yield from bushing_faults(bushing.name, bushing.stiffness, bushing.axes)
        if bushing.start == bushing.end:
            yield f"bushing {bushing.name!r} joins attach point {bushing.start!r} to itself"
    for load in structure.loads:
        if not np.all(np.isfinite([*load.force, *load.moment, *load.offset])):
            yield f"load {load.name!r} has a force, a moment or an offset that is not a number"


def _wheels(structure: Structure) -> Iterator[str]:
    """Across its axis a rotor has half of its inertia about it, or more, and its frame's body has that too.

    Without it a momentum would act on a motion without mass.
    """
    for wheel in structure.wheels:
        if not (np.isfinite(wheel.inertia) and wheel.inertia > 0.0):
            yield f"wheel {wheel.name!r} has an inertia of {wheel.inertia} kg m^2: positive and finite"
    parts = {part.name: part.body.inertia for part in (*structure.nodes, *structure.joints)}
    elsewhere = {frame for component in structure.components for frame in component.frames}
    for frame in dict.fromkeys(w.frame for w in structure.wheels if w.frame in parts):
        own = [w for w in structure.wheels if w.frame == frame]
        across = sum(0.5 * w.inertia * (np.eye(3) - np.outer(w.axis, w.axis)) for w in own)
        left = np.linalg.eigvalsh(parts[frame] - across)
        if frame not in elsewhere and left[0] < -UNIT_ERROR * np.abs(across).max():
            yield (
                f"wheel {own[0].name!r}: the body of frame {frame!r} has less inertia than its rotors have "
                "across their axes, half of that about them or more"
            )


def _travels(structure: Structure) -> Iterator[str]:
    for joint in structure.joints:
        (low, high), start = joint.travel, held_angle(joint)
        unit = "m" if joint.slides else "rad"
        if not low < high:
            yield f"joint {joint.name!r} has a travel that does not rise, {low:g} to {high:g} {unit}"
        elif not low <= start <= high:
            yield f"joint {joint.name!r} begins at {start:g} {unit}, out of its travel {low:g} to {high:g}"


def _members(structure: Structure) -> Iterator[str]:
    geometry = member_geometry(structure)
    up = np.array([m.up for m in structure.members]).reshape(-1, 3)
    aside = np.linalg.norm(np.cross(up, geometry.triad[:, :, 0]), axis=1)
    for member, length, sine in zip(structure.members, geometry.length, aside, strict=True):
        if not length > 0.0:
            yield f"member {member.name!r} has no length between its nodes' ends"
        elif not sine > UNIT_ERROR:
            yield f"member {member.name!r} has its up vector along itself"
        if not np.isfinite(member.tension):
            yield f"member {member.name!r} has a tension that is not a number"
        if member.elements < 1:
            yield f"member {member.name!r} has {member.elements} elements"


def _parts(structure: Structure) -> Iterator[str]:
    """Faults of separate parts, which would have rigid-body modes of their own: all nodes must be joined."""
    names = [node.name for node in structure.nodes]
    for part in separate_parts(names, joined_nodes(structure))[1:]:
        yield f"a disconnected part: no member or spring joins node {some_names(part)} to the rest"


ROUNDING = 1e-9
"""Rounding allowed, over the largest moment: flat bodies have equality."""


def impossible_moments(inertia: Float[np.ndarray, "3 3"]) -> tuple[float, float, float] | None:
    """The principal moments, ascending, where no body has them; else None.

    >>> impossible_moments(np.diag([1.0, 1.0, 3.0]))
    (1.0, 1.0, 3.0)
    """
    a, b, c = np.linalg.eigvalsh(inertia).tolist()
    return (a, b, c) if a + b < c * (1.0 - ROUNDING) else None
