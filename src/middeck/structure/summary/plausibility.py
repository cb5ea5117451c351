"""Plausibility warnings: densities, wave speeds, sizes and frequencies outside anything ever built.

The limits leave room for anything that was built; what is outside of them has mostly one number in another
unit: millimetres or inches for metres, GPa for Pa, grams or tonnes for kilograms.
"""

from collections.abc import Iterator

import numpy as np

from middeck.structure.model.article import Body, JointState, Node, Section, Structure
from middeck.structure.model.component import body_of, modal_hz, warnings_on_component
from middeck.structure.model.connectivity import some_names
from middeck.values import record

BODY_DENSITY = (1e-3, 2.5e4)  # kg/m^3: from a solar sail with its box to solid osmium
MATERIAL_DENSITY = (10.0, 2.5e4)  # kg/m^3: from a rigid foam to osmium
WAVE_SPEED = (30.0, 3e4)  # m/s, sqrt(E/rho): rubber to diamond, with room
FREQUENCY = (1e-3, 1e5)  # Hz
LENGTH = (1e-3, 500.0)  # m: five times the largest station
MASS = (1e-6, 1e6)  # kg: twice the largest station
LUMP = 6  # modes of a rigid body on springs
SLENDERNESS = (0.3, 1e4)  # length over radius of gyration: a disc, a cable
STOUT = 3.0  # the same of the median member: a tube as long as it is wide
DENSE, SLOW = 2500.0, 500.0  # kg/m^3, m/s: what is as dense as this is stiffer than lead (1200 m/s)
# kg/m^3, Pa: what is denser than any rubber is stiffer than this (PTFE 0.4e9; Ashby 2011, appendix A). What
# is less dense may be one: 900 to 1850 kg/m^3 with 0.7e6 Pa or more are elastomers, bare or filled.
FILLED_RUBBER, SOFTEST_SOLID = 1850.0, 0.3e9
ROOM = 3.0  # sides of a body over the clear distance that its node leaves between members
NEAR = 0.05  # of the article: nodes nearer than this only divide members more finely
SAME = 1e-6  # of half a cube: a node this near is at the same place
STEEL = 7850.0  # kg/m^3
OVERHANG = 2.0  # an offset from a frame's origin over the distance between the nodes farthest apart
ROUNDING = 1e-6  # of the first frequency: what a comparison with a test never sees
FLAT = 1e-2  # least side of a box over its largest, so that a line and a sheet have a volume
THICK = 0.2  # the same of one body, whose thin sides were not measured
# Share of the mass below which members have a token density: the bodies carry the mass.
TOKEN = 1e-3
# kg/m^3, and kg m^2: what a power of ten may be one of (SI, slug, pound, slinch with feet or inches).
DENSITY_UNITS = (1.0, 515.379, 16.0185, 27679.9, 1.06869e7)
INERTIA_UNITS = (1.0, 1.35582, 0.0421401, 2.92640e-4, 0.112985)
DIGITS = 2e-5  # relative precision of such units
NEIGHBOURS = 8  # neighbours of a node that are checked first


@record(kw_only=True)
class Measures:
    """Quantities checked: total mass, inertia about its centre, sides of the box, and two estimates."""

    mass: float
    inertia: np.ndarray
    size: np.ndarray
    bending_hz: float | None
    rounding: float


def warnings_on_measures(
    structure: Structure, of: Measures, length: np.ndarray, radius: np.ndarray, elements: np.ndarray
) -> tuple[str, ...]:
    """One warning for each implausible quantity; ``length`` and later arguments are the members'."""
    return (
        *_whole(structure, of),
        *_bodies(structure, of),
        *_densities(structure),
        *_offsets(structure),
        *_joints(structure),
        *_sections(structure, of, length),
        *_members(structure, length, radius),
        *_mesh(structure, of, length, elements),
        *_components(structure),
        *(odd for component in structure.components for odd in warnings_on_component(component)),
    )


def _components(structure: Structure) -> Iterator[str]:
    """Components in the box of their inertia: too dense, too light, or as soft as no solid metal is.

    A lump on springs is dense and slow, in six modes at most; it is the seventh that counts.
    """
    for part in structure.components:
        whole = body_of(part)
        sides = _equivalent_box(whole.mass, np.linalg.eigvalsh(whole.inertia))
        longest = float(sides.max())
        if not longest > 0.0:
            continue  # a point
        density = whole.mass / float(np.prod(np.maximum(sides, THICK * longest)))
        hz = next(iter(modal_hz(part)[LUMP:].tolist()), np.inf)
        soft = density > DENSE and 2.0 * longest * hz < SLOW
        if soft or _outside(density, BODY_DENSITY):
            box = " x ".join(f"{side:.3g}" for side in sides)
            yield (
                f"component {part.name!r} has {whole.mass:.4g} kg and the inertia of a box of {box} m, "
                f"{density:.3g} kg/m^3"
                + f", and yet {LUMP + 1} modes up to {hz:.3g} Hz" * soft
                + ": are its units those of its matrices?"
            )


def _outside(value: float, limits: tuple[float, float]) -> bool:
    return not limits[0] <= value <= limits[1]


def _whole(structure: Structure, of: Measures) -> Iterator[str]:
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
    # A point that outweighs all else says nothing of its own size.
    points = [n.body.mass for n in structure.nodes if not np.any(n.body.inertia)]
    lone = max(points, default=0.0)
    spread = of.mass - (lone if lone > 0.5 * of.mass else 0.0)
    if volume > 0.0 and (
        _outside(of.mass / volume, BODY_DENSITY) and _outside(spread / volume, BODY_DENSITY)
    ):
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
    """Bodies in the box of their inertia; points by their node's size, and by how near the next node is. An
    inertia for form's sake is a point's: the same power of ten about all axes, or the same about all for
    bodies of several masses, where that is too little for a box. So is that of lumped halves of members,
    which says where they are and not how large."""
    parts = [part for part in (*structure.nodes, *structure.joints) if part.body.mass > 0.0]
    masses: dict[float, set[float]] = {}
    for part in parts:
        if (moment := _same_moment(part.body)) is not None:
            masses.setdefault(moment, set()).add(part.body.mass)
    found: list[tuple[str, str]] = []
    around, lumped = _Surroundings(structure), _lumped_ends(structure)
    for part in parts:
        body = part.body
        if not np.any(body.inertia):
            found += [(part.name, odd) for odd in (_point(part, around) if isinstance(part, Node) else ())]
            continue
        sides = _equivalent_box(body.mass, np.linalg.eigvalsh(body.inertia))
        density = body.mass / float(np.prod(np.maximum(sides, THICK * sides.max())))
        moment = _same_moment(body)
        token = moment is not None and (_is_power(moment, INERTIA_UNITS) or len(masses[moment]) > 1)
        if isinstance(part, Node) and (token or part.name in lumped) and density > BODY_DENSITY[1]:
            found += [(part.name, odd) for odd in _point(part, around)]
        elif _outside(density, BODY_DENSITY):
            box = " x ".join(f"{side:.3g}" for side in sides)
            odd = (
                f"carries {body.mass:.4g} kg with the inertia of a box of {box} m, "
                f"{density:.3g} kg/m^3: is its mass in kg, its inertia in kg m^2?"
            )
            found.append((part.name, odd))
    for odd in dict.fromkeys(odd for _, odd in found):
        names = [name for name, same in found if same == odd]
        more = f" (and so {'does' if len(names) == 2 else 'do'} {some_names(names[1:])})" if names[1:] else ""
        yield f"{names[0]!r} {odd}{more}"


def _lumped_ends(structure: Structure) -> set[str]:
    """Nodes of members that weigh nothing though their material does: bodies there have their halves."""
    lumped = [m for m in structure.members if not m.section.rho_A and m.section.density]
    return {end for member in lumped for end in (member.start, member.end)}


def _same_moment(body: Body) -> float | None:
    """A body's inertia if it is the same about every axis, and not zero."""
    moment = float(body.inertia[0, 0])
    alike = moment > 0.0 and np.all(np.abs(body.inertia - moment * np.eye(3)) <= DIGITS * moment)
    return float(f"{moment:.4e}") if alike else None


def _is_power(value: float, units: tuple[float, ...]) -> bool:
    """Whether ``value`` is a power of ten in any of ``units``: a placeholder, not a measured value."""
    decades = np.log10(value / np.array(units))
    return bool(np.any(np.abs(decades - np.round(decades)) <= DIGITS / np.log(10.0)))


class _Surroundings:
    """The nodes of an article and how far they reach; a deck has 1e4 bodies among as many."""

    def __init__(self, structure: Structure) -> None:
        from scipy.spatial import KDTree

        positions = np.array([n.position for n in structure.nodes]).reshape(-1, 3)
        self.index = {n.name: i for i, n in enumerate(structure.nodes)}
        self.tree = KDTree(positions)
        self.across = float(np.linalg.norm(np.ptp(positions, axis=0))) if len(positions) else 0.0

    def nearest(self, node: Node, beyond: float) -> float:
        """Distance from the centre of mass of ``node`` to the next other node beyond ``beyond``."""
        count, size = NEIGHBOURS, self.tree.n
        while True:
            far, which = self.tree.query(node.position + node.body.cg, np.arange(1, min(count, size) + 1))
            others = far[(far > beyond) & (which != self.index[node.name])]
            if len(others) or count >= size:
                return float(others[0]) if len(others) else float("inf")
            count *= NEIGHBOURS


def _point(node: Node, around: _Surroundings) -> Iterator[str]:
    """A mass without inertia: it is somewhere within its node, or out to where its centre stands."""
    mass, cg = node.body.mass, node.body.cg
    room = max(ROOM * node.size, 2.0 * float(np.linalg.norm(cg)))
    reach = 0.5 * (mass / STEEL) ** (1.0 / 3.0)
    # A node at the same place is what a link or a joint ties to it there.
    nearest, across = around.nearest(node, SAME * reach), around.across
    if node.size > 0.0 and mass > BODY_DENSITY[1] * room**3:
        yield f"carries {mass:.4g} kg on a node of {node.size:.3g} m: is its mass in kg?"
    elif reach > max(nearest, NEAR * across):
        yield (
            f"carries {mass:.4g} kg: a solid steel cube of it would reach past the next node, "
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


def _sections(structure: Structure, of: Measures, length: np.ndarray) -> Iterator[str]:
    """One sentence a section, at the first member that has it.

    A density of zero, or of a power of ten, is one for form's sake where its members weigh next to nothing.
    """
    seen: dict[Section, str] = {}
    weight: dict[Section, float] = {}
    for member, long in zip(structure.members, length.tolist(), strict=True):
        seen.setdefault(member.section, member.name)
        weight[member.section] = weight.get(member.section, 0.0) + member.section.rho_A * long
    for section, name in seen.items():
        if weight[section] <= TOKEN * of.mass and _is_token(section.density):
            continue
        if section.density is not None and _outside(section.density, MATERIAL_DENSITY):
            yield f"member {name!r} is of a material of {section.density:.4g} kg/m^3: is rho in kg/m^3?"
        density = section.density or 0.0
        speed = float(np.sqrt(section.EA / section.rho_A)) if section.rho_A > 0.0 else np.nan
        soft = density >= DENSE and speed < SLOW
        soft = soft or (density >= FILLED_RUBBER and density * speed**2 < SOFTEST_SOLID)
        if np.isfinite(speed) and (soft or _outside(speed, WAVE_SPEED)):
            yield (
                f"in member {name!r} sound would travel at {speed:.3g} m/s (steel has 5000): "
                "is E in Pa, EA in N, and mass per length in kg/m?"
            )


def _is_token(density: float | None) -> bool:
    if density is None or density >= MATERIAL_DENSITY[0]:
        return False
    return density == 0.0 or _is_power(density, DENSITY_UNITS)


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
