"""Masses and measures of an article before anything is solved, where wrong units show first."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.mesh import lay_out
from middeck.structure.elements.frames import Poses, points_in_world
from middeck.structure.model.article import Member, Structure
from middeck.structure.model.article_checks import check_structure
from middeck.structure.model.component import body_of
from middeck.structure.model.member_mesh import member_geometry
from middeck.structure.model.section import MemberMass, mean_section
from middeck.structure.summary.plausibility import Measures, warnings_on_measures
from middeck.values import record

EPS = float(np.finfo(float).eps)
# First free-free bending of a uniform beam: omega^2 = FREE EI / (M L^3), with FREE = 4.7300^4.
FREE = 500.5639
STATIONS = 24
LEAST_SPAN = 0.1  # least span over the largest side of the article


@record(kw_only=True)
class Summary:
    """Masses and measures of a structure, undeformed, with its joints where statics begin.

    Attributes:
        mass, centre, inertia: Total [kg], centre of mass in W [m], and inertia about it in the axes of W [kg
            m^2].
        size: Sides [m] of the box in W around nodes, joints, centres of mass and attach points.
        coordinates: Degrees of freedom at its mesh.
        bending_hz: The scale of its lowest free-free bending frequency, by decades rather than by per cent;
            None where no member bends, and where all frames lie across the length of the mass. A uniform beam
            with the article's mass and length, and the mean compliance of 24 cuts across it: EI of the
            members cut and their EA times the square of the distance from the middle.
        slenderness: Least and largest length of a member's elements over its radius of gyration sqrt(EI/EA),
            of those that bend.
        rounding: Relative rounding error of the first frequency from the number of elements: 0.05 eps (L/h)^4
            for a straight beam.
        warnings: Implausible quantities, each with the part and what to try.
    """

    mass: float
    centre: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]
    size: Float[np.ndarray, "3"]
    coordinates: int
    bending_hz: float | None
    slenderness: tuple[float, float] | None
    rounding: float
    warnings: tuple[str, ...]


@record(kw_only=True)
class _Rods:
    """Members as straight rods: ends, axis, length, section and elements; one row each."""

    start: np.ndarray
    along: np.ndarray
    length: np.ndarray
    triad: np.ndarray
    EA: np.ndarray
    EI: np.ndarray
    rho_A: np.ndarray
    rho_I: np.ndarray
    elements: np.ndarray
    centre: np.ndarray  # from the start, own axes
    spread: np.ndarray  # second moments of the mass about its centre over the mass [m^2], own axes


def summarise(structure: Structure) -> Summary:
    """Mass, size, and scales of frequency and rounding of ``structure``, with warnings of its units.

    Costs no eigensolution and no mesh. Raises `ConfigError` for what `mesh_structure` refuses.
    """
    check_structure(structure)
    model = lay_out(dataclasses.replace(structure, members=(), components=()))
    poses = model.drawn
    points = points_in_world(model.points, poses)
    rods = _rods(structure)
    mass, centre, inertia = _mass_properties(structure, rods, points[model.body_point], poses)
    size = _size(structure, np.vstack([poses.p, points]))
    span, EI = _bending(rods, np.linalg.eigh(inertia)[1][:, 0], poses.p)
    squared = FREE * EI / (mass * span**3) if EI > 0.0 and span > 0.0 and mass > 0.0 else 0.0
    # Half of eps |phi|'|K||phi| / omega^2, with 48 EI/h^3 of each element and phi of the mean size.
    rounding = 24.0 * EPS * float(np.sum(rods.elements**4 * rods.EI / rods.length**3))
    measures = Measures(
        mass=mass,
        inertia=inertia,
        size=size,
        bending_hz=float(np.sqrt(squared) / (2.0 * np.pi)) if squared > 0.0 else None,
        rounding=rounding / (mass * squared) if squared > 0.0 else 0.0,
    )
    radius = np.sqrt(rods.EI / rods.EA)
    bends = radius > 0.0
    slim = rods.length[bends] / rods.elements[bends] / radius[bends]
    return Summary(
        mass=mass,
        centre=centre,
        inertia=inertia,
        size=size,
        coordinates=6 * (len(structure.nodes) + int(np.sum(rods.elements - 1)))
        + len(structure.joints)
        + sum(part.modal for part in structure.components),
        bending_hz=measures.bending_hz,
        slenderness=(float(slim.min()), float(slim.max())) if len(slim) else None,
        rounding=measures.rounding,
        warnings=warnings_on_measures(structure, measures, rods.length, radius, rods.elements),
    )


def _rods(structure: Structure) -> _Rods:
    members = structure.members
    geometry = member_geometry(structure)
    x = np.array([n.position for n in structure.nodes]).reshape(-1, 3)[geometry.nodes[:, 0]]
    along = geometry.triad[:, :, 0]
    sections = [mean_section(m.sections) for m in members]

    def column(name: str) -> np.ndarray:
        return np.array([getattr(s, name) for s in sections], dtype=float)

    spread = [_spread(m, length) for m, length in zip(members, geometry.length.tolist(), strict=True)]
    return _Rods(
        start=x + geometry.offset[:, 0],
        along=along,
        length=geometry.length,
        triad=geometry.triad,
        EA=column("EA"),
        EI=np.minimum(column("EI_y"), column("EI_z")),
        rho_A=column("rho_A"),
        rho_I=np.stack([column("rho_I_y") + column("rho_I_z"), column("rho_I_y"), column("rho_I_z")], axis=1),
        elements=np.array([m.elements for m in members], dtype=float),
        centre=np.array([mean for mean, _ in spread]).reshape(-1, 3),
        spread=np.array([second for _, second in spread]).reshape(-1, 3, 3),
    )


def _spread(member: Member, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean place of a member's mass from its start, and its second moments about that, in own axes."""
    sections = member.sections
    rho = np.array([s.rho_A for s in sections])
    share = rho / rho.sum() if rho.sum() > 0.0 else np.full(len(rho), 1.0 / len(rho))
    along = (np.arange(len(rho)) + 0.5) / len(rho) * length
    at = np.column_stack([along, [(s.mass_centre_y, s.mass_centre_z) for s in sections]])
    mean = share @ at
    second = (at - mean).T @ (share[:, None] * (at - mean))
    halves = [s.mass == MemberMass.COUPLED_ROD for s in sections]
    second[0, 0] += (length / len(rho)) ** 2 * (share @ np.where(halves, 1.0 / 4.0, 1.0 / 12.0))
    return mean, second


def _mass_properties(
    structure: Structure, rods: _Rods, bodies_at: np.ndarray, poses: Poses
) -> tuple[float, np.ndarray, np.ndarray]:
    """Bodies where they stand, members as rods with their rotary inertia, components as bodies."""
    frames = (*structure.nodes, *structure.joints)
    carried = [
        (i, part.body) for i, part in enumerate(frames) if part.body.mass != 0.0 or np.any(part.body.inertia)
    ]
    names = [part.name for part in frames]
    carried += [(names.index(added.frame), added.body) for added in structure.masses]
    wholes = [body_of(part) for part in structure.components]
    mass = np.concatenate(
        [[body.mass for _, body in carried], rods.rho_A * rods.length, [whole.mass for whole in wholes]]
    )
    middle = rods.start + np.matvec(rods.triad, rods.centre)
    parts = np.zeros((len(wholes), 3))
    for k, (part, whole) in enumerate(zip(structure.components, wholes, strict=True)):
        i = names.index(part.frames[0])
        parts[k] = poses.p[i] + poses.R[i] @ part.fixed_at[0] + part.axes @ (whole.cg - part.positions[0])
    x = np.vstack([bodies_at.reshape(-1, 3), middle, parts])
    total = float(mass.sum())
    centre = mass @ x / total if total > 0.0 else np.zeros(3)
    own = np.zeros((len(x), 3, 3))
    for row, (i, body) in enumerate(carried):
        own[row] = poses.R[i] @ body.inertia @ poses.R[i].T
    apart = (rods.rho_A * rods.length)[:, None, None] * rods.spread
    spin = (rods.rho_I * rods.length[:, None])[:, None, :] + np.trace(apart, axis1=1, axis2=2)[:, None, None]
    straight = slice(len(carried), len(carried) + len(middle))
    own[straight] = rods.triad @ (np.eye(3) * spin - apart) @ np.swapaxes(rods.triad, 1, 2)
    for k, (part, whole) in enumerate(zip(structure.components, wholes, strict=True)):
        own[straight.stop + k] = part.axes @ whole.inertia @ part.axes.T
    r = x - centre
    second = (mass[:, None] * r).T @ r
    return total, centre, own.sum(axis=0) + np.trace(second) * np.eye(3) - second


def _size(structure: Structure, points: np.ndarray) -> np.ndarray:
    half = np.zeros(len(points))
    half[: len(structure.nodes)] = [0.5 * node.size for node in structure.nodes]
    return (points + half[:, None]).max(axis=0) - (points - half[:, None]).min(axis=0)


def _bending(rods: _Rods, axis: np.ndarray, frames: np.ndarray) -> tuple[float, float]:
    """Length along ``axis`` and the harmonic mean of EI over the cuts across it; zero without members.

    Zero too where the frames lie across it, as those below a tall body or component do: no beam along it.
    """
    reach = frames @ axis
    span = float(np.ptp(reach))
    if span < LEAST_SPAN * np.ptp(frames, axis=0).max():
        return span, 0.0
    start = rods.start @ axis
    slope = rods.along @ axis
    end = start + rods.length * slope
    least, largest = np.minimum(start, end), np.maximum(start, end)
    stiffness: list[float] = []
    for i in range(STATIONS):
        at = reach.min() + (i + 0.5) / STATIONS * span
        cut = (least < at) & (at < largest)
        if np.any(cut):
            x = rods.start[cut] + ((at - start[cut]) / slope[cut])[:, None] * rods.along[cut]
            stiffness.append(_cut_stiffness(x, np.abs(slope[cut]), rods.EA[cut], rods.EI[cut], axis))
    return span, len(stiffness) / sum(1.0 / k for k in stiffness) if all(stiffness) and stiffness else 0.0


def _cut_stiffness(
    x: np.ndarray, cosine: np.ndarray, EA: np.ndarray, EI: np.ndarray, axis: np.ndarray
) -> float:
    """Bending stiffness of the members cut, about the softer axis across.

    A member that leans by ``cosine`` stretches along it with EA cosine^3; leaning bends as it stands upright.
    """
    k = EA * cosine**3
    r = x - k @ x / k.sum()
    r = r - (r @ axis)[:, None] * axis
    across = np.linalg.svd(axis[None, :])[2][1:]
    apart = across @ ((k[:, None] * r).T @ r) @ across.T
    return float(np.linalg.eigvalsh(apart)[0] + np.sum(EI * cosine))
