"""Plausibility warnings: densities, wave speeds, sizes and frequencies outside anything ever built.

The limits leave room for anything that was built; what is outside of them has mostly one number in another
unit: millimetres or inches for metres, GPa for Pa, grams or tonnes for kilograms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from middeck.structure.model.article import JointState, Node, Section, Structure
from middeck.structure.model.component import component_doubts

BODY_DENSITY = (1e-3, 2.5e4)  # kg/m^3: from a solar sail with its box to solid osmium
MATERIAL_DENSITY = (10.0, 2.5e4)  # kg/m^3: from a rigid foam to osmium
WAVE_SPEED = (30.0, 3e4)  # m/s, sqrt(E/rho): rubber to diamond, with room
FREQUENCY = (1e-3, 1e5)  # Hz
LENGTH = (1e-3, 500.0)  # m: five times the largest station
MASS = (1e-6, 1e6)  # kg: twice the largest station
SLENDERNESS = (0.3, 1e4)  # length over radius of gyration: a disc, a cable
STOUT = 3.0  # the same of the median member: a tube as long as it is wide
DENSE, SLOW = 2500.0, 500.0  # kg/m^3, m/s: what is as dense as this is stiffer than lead (1200 m/s)
ROOM = 3.0  # sides of a body over the clear distance that its node leaves between members
SAME = 1e-6  # of half a cube: a node this near is at the same place
STEEL = 7850.0  # kg/m^3
OVERHANG = 2.0  # an offset from a frame's origin over the distance between the nodes farthest apart
ROUNDING = 1e-6  # of the first frequency: what a comparison with a test never sees
FLAT = 1e-2  # least side of a box over its largest, so that a line and a sheet have a volume
THICK = 0.2  # the same of one body, whose thin sides nobody measured


class Measures(NamedTuple):
    """Quantities checked: total mass, inertia about its centre, sides of the box, and two estimates."""

    mass: float
    inertia: np.ndarray
    size: np.ndarray
    bending_hz: float | None
    rounding: float


def doubt_measures(
    structure: Structure, of: Measures, length: np.ndarray, radius: np.ndarray, elements: np.ndarray
) -> tuple[str, ...]:
    """One warning for each implausible quantity; ``length`` and later arguments are the members'."""
    return (
        *_whole(of),
        *_bodies(structure, of),
        *_densities(structure),
        *_offsets(structure),
        *_joints(structure),
        *_sections(structure),
        *_members(structure, length, radius),
        *_mesh(structure, of, length, elements),
        *(doubt for component in structure.components for doubt in component_doubts(component)),
    )


def _outside(value: float, limits: tuple[float, float]) -> bool:
    return not limits[0] <= value <= limits[1]


def _whole(of: Measures) -> Iterator[str]:
    longest = float(of.size.max())
    if not of.mass > 0.0:
        yield "the article has no mass: give its bodies mass_kg, or its members a density"
        return
    if _outside(of.mass, MASS):
        yield f"the article has a mass of {of.mass:.4g} kg: are all masses in kg?"
    if longest > 0.0 and _outside(longest, LENGTH):
        yield f"the article is {longest:.4g} m long: are its positions in millimetres? they are read as m"
    sides = np.maximum(of.size, _equivalent_box(of.mass, np.diag(of.inertia)))
    volume = float(np.prod(np.maximum(sides, FLAT * sides.max())))
    if volume > 0.0 and _outside(of.mass / volume, BODY_DENSITY):
        box = " x ".join(f"{side:.3g}" for side in sides)
        yield (
            f"{of.mass:.4g} kg in a box of {box} m is {of.mass / volume:.3g} kg/m^3: "
            "masses are read in kg and positions in m"
        )
    if of.bending_hz is not None and _outside(of.bending_hz, FREQUENCY):
        yield (
            f"the lowest bending frequency would be of the order of {of.bending_hz:.1e} Hz: "
            "look at E (Pa), diameters (m) and masses (kg)"
        )


def _equivalent_box(mass: float, moments: np.ndarray) -> np.ndarray:
    """Sides of the uniform box of this mass that has these moments about its axes."""
    spread = np.maximum(0.5 * moments.sum() - moments, 0.0) / mass
    return np.sqrt(12.0 * spread)


def _densities(structure: Structure) -> Iterator[str]:
    """Bodies in the box of their inertia; points by their node's size, and by how near the next node is."""
    for part in (*structure.nodes, *structure.joints):
        body = part.body
        if not body.mass > 0.0:
            continue
        if np.any(body.inertia):
            sides = _equivalent_box(body.mass, np.linalg.eigvalsh(body.inertia))
            density = body.mass / float(np.prod(np.maximum(sides, THICK * sides.max())))
            if _outside(density, BODY_DENSITY):
                box = " x ".join(f"{side:.3g}" for side in sides)
                yield (
                    f"{part.name!r} carries {body.mass:.4g} kg with the inertia of a box of {box} m, "
                    f"{density:.3g} kg/m^3: is its mass in kg, its inertia in kg m^2?"
                )
        elif isinstance(part, Node):
            yield from _point(part, structure)


def _point(node: Node, structure: Structure) -> Iterator[str]:
    """A mass without inertia: it is somewhere within its node, or out to where its centre stands."""
    mass, cg = node.body.mass, node.body.cg
    room = max(ROOM * node.size, 2.0 * float(np.linalg.norm(cg)))
    reach = 0.5 * (mass / STEEL) ** (1.0 / 3.0)
    others = [np.linalg.norm(n.position - node.position - cg) for n in structure.nodes if n is not node]
    # A node at the same place is what a link or a joint ties to it there.
    nearest = float(min((d for d in others if d > SAME * reach), default=np.inf))
    if node.size > 0.0 and mass > BODY_DENSITY[1] * room**3:
        yield f"{node.name!r} carries {mass:.4g} kg on a node of {node.size:.3g} m: is its mass in kg?"
    elif reach > nearest:
        yield (
            f"{node.name!r} carries {mass:.4g} kg: a solid steel cube of it would reach past the next node, "
            f"{nearest:.3g} m away; is its mass in kg?"
        )


def _offsets(structure: Structure) -> Iterator[str]:
    """Centres of mass, joints and attach points far out of the article."""
    positions = np.array([n.position for n in structure.nodes])
    across = float(np.linalg.norm(np.ptp(positions, axis=0)))
    places = [
        *((f"the centre of mass of {p.name!r}", p.body.cg) for p in (*structure.nodes, *structure.joints)),
        *((f"joint {j.name!r}", j.offset) for j in structure.joints),
        *((f"attach point {a.name!r}", a.offset) for a in structure.attach_points),
    ]
    for what, offset in places:
        away = float(np.linalg.norm(offset))
        if across > 0.0 and away > OVERHANG * across:
            yield (
                f"{what} stands {away:.4g} m from its frame, in an article whose nodes are {across:.3g} m "
                "across: is it in millimetres? it is read as m"
            )


def _joints(structure: Structure) -> Iterator[str]:
    """Sprung joints by the frequency of what they carry, on a fixed carrier."""
    for joint in structure.joints:
        body = joint.body
        arm = np.cross(joint.axis, body.cg)
        moved = (
            body.mass if joint.slides else joint.axis @ body.inertia @ joint.axis + body.mass * (arm @ arm)
        )
        if joint.state is not JointState.SPRUNG or not (moved > 0.0 and joint.stiffness > 0.0):
            continue
        hz = float(np.sqrt(joint.stiffness / moved) / (2.0 * np.pi))
        if _outside(hz, FREQUENCY):
            unit = "N/m" if joint.slides else "N m/rad"
            yield f"joint {joint.name!r} would swing at {hz:.3g} Hz: is its stiffness in {unit}?"


def _bodies(structure: Structure, of: Measures) -> Iterator[str]:
    """No part of an article turns as if all its mass were farther out than the article is long."""
    far = float(of.size @ of.size)
    for part in (*structure.nodes, *structure.joints, *structure.masses):
        body = part.body
        largest = float(np.linalg.eigvalsh(body.inertia)[-1])
        if far > 0.0 and body.mass > 0.0 and largest > body.mass * far:
            out = float(np.sqrt(largest / body.mass))
            yield (
                f"{part.name!r} has an inertia of {largest:.4g} kg m^2, {body.mass:.4g} kg at {out:.3g} m; "
                f"the article measures {np.sqrt(far):.3g} m across: is the inertia in kg mm^2?"
            )


def _sections(structure: Structure) -> Iterator[str]:
    """One sentence a section, at the first member that has it."""
    seen: dict[Section, str] = {}
    for member in structure.members:
        seen.setdefault(member.section, member.name)
    for section, name in seen.items():
        if section.density is not None and _outside(section.density, MATERIAL_DENSITY):
            yield f"member {name!r} is of a material of {section.density:.4g} kg/m^3: is rho in kg/m^3?"
        heavy = section.density is not None and section.density >= DENSE
        speed = float(np.sqrt(section.EA / section.rho_A)) if section.rho_A > 0.0 else np.nan
        if np.isfinite(speed) and (_outside(speed, WAVE_SPEED) or (heavy and speed < SLOW)):
            yield (
                f"in member {name!r} sound would travel at {speed:.3g} m/s (steel has 5000): "
                "is E in Pa, EA in N, and mass per length in kg/m?"
            )


def _members(structure: Structure, length: np.ndarray, radius: np.ndarray) -> Iterator[str]:
    members = [m for m, own in zip(structure.members, radius, strict=True) if own > 0.0]  # those that bend
    length, radius = length[radius > 0.0], radius[radius > 0.0]
    if not members:
        return
    slim = length / radius
    longest, stoutest = int(slim.argmax()), int(slim.argmin())
    for worst, wrong in (
        (longest if slim[longest] > SLENDERNESS[1] else None, "are positions in millimetres?"),
        (stoutest if slim[stoutest] < SLENDERNESS[0] else None, "are diameters in millimetres?"),
    ):
        if worst is not None:
            yield (
                f"member {members[worst].name!r} is {length[worst]:.4g} m long, its section's "
                f"radius of gyration {radius[worst]:.3g} m: {wrong} all are read as m"
            )
    middle = float(np.median(slim))
    if SLENDERNESS[0] <= slim[stoutest] and middle < STOUT:
        yield (
            f"half of all members are shorter than {middle:.2g} radii of gyration of their sections, such as "
            f"{members[stoutest].name!r}: are diameters in inches? all are read as m"
        )


def _mesh(structure: Structure, of: Measures, length: np.ndarray, elements: np.ndarray) -> Iterator[str]:
    if of.rounding <= ROUNDING:
        return
    h = length / elements
    finest, across = int(h.argmin()), float(np.linalg.norm(of.size))
    ratio = (across / h[finest]) ** 4
    yield (
        f"sliced too finely: member {structure.members[finest].name!r} has elements of {h[finest]:.3g} m in "
        f"an article of {across:.3g} m; (L/h)^4 = {ratio:.1e} exceeds what double precision holds, and the "
        f"first frequency may be wrong by {of.rounding:.0e}; grow by adding members instead"
    )
