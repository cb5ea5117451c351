"""What can hardly be meant: densities, wave speeds, sizes and frequencies that no laboratory has seen.

The limits leave room for anything that was built; what is outside of them has mostly one number in another
unit: millimetres for metres, MPa for Pa, grams for kilograms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from middeck.structure.article import Section, Structure

BODY_DENSITY = (1e-3, 2.5e4)  # kg/m^3: from a solar sail with its box to solid osmium
MATERIAL_DENSITY = (10.0, 2.5e4)  # kg/m^3: from a rigid foam to osmium
WAVE_SPEED = (30.0, 3e4)  # m/s, sqrt(E/rho): rubber to diamond, with room
FREQUENCY = (1e-3, 1e5)  # Hz
LENGTH = (1e-3, 2e3)  # m
SLENDERNESS = (0.3, 1e4)  # length over radius of gyration: a disc, a cable
ROUNDING = 1e-6  # of the first frequency: what a comparison with a test never sees
FLAT = 1e-2  # least side of a box over its largest, so that a line and a sheet have a volume


class Measures(NamedTuple):
    """What is doubted: total mass, inertia about its centre, sides of the box, and two estimates."""

    mass: float
    inertia: np.ndarray
    size: np.ndarray
    bending_hz: float | None
    rounding: float


def doubt_measures(
    structure: Structure, of: Measures, length: np.ndarray, radius: np.ndarray, elements: np.ndarray
) -> tuple[str, ...]:
    """One sentence for each thing that can hardly be meant; ``length`` and on are the members'."""
    return (
        *_whole(of),
        *_bodies(structure, of),
        *_sections(structure),
        *_members(structure, length, radius),
        *_mesh(structure, of, length, elements),
    )


def _outside(value: float, limits: tuple[float, float]) -> bool:
    return not limits[0] <= value <= limits[1]


def _whole(of: Measures) -> Iterator[str]:
    longest = float(of.size.max())
    if not of.mass > 0.0:
        yield "the article has no mass: give its bodies mass_kg, or its members a density"
        return
    if longest > 0.0 and _outside(longest, LENGTH):
        yield f"the article is {longest:.4g} m long: are its positions in millimetres? they are read as m"
    sides = np.maximum(of.size, _equivalent_box(of))
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


def _equivalent_box(of: Measures) -> np.ndarray:
    """Sides of the uniform box, along W, that has this mass and these moments about W's axes."""
    diagonal = np.diag(of.inertia)
    spread = np.maximum(0.5 * diagonal.sum() - diagonal, 0.0) / of.mass
    return np.sqrt(12.0 * spread)


def _bodies(structure: Structure, of: Measures) -> Iterator[str]:
    """No part of an article turns as if all its mass were farther out than the article is long."""
    far = float(of.size @ of.size)
    for part in (*structure.nodes, *structure.joints):
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
        speed = float(np.sqrt(section.EA / section.rho_A)) if section.rho_A > 0.0 else np.nan
        if np.isfinite(speed) and _outside(speed, WAVE_SPEED):
            yield (
                f"in member {name!r} sound would travel at {speed:.3g} m/s (steel has 5000): "
                "is E in Pa, EA in N, and mass per length in kg/m?"
            )


def _members(structure: Structure, length: np.ndarray, radius: np.ndarray) -> Iterator[str]:
    if not len(length):
        return
    slim = length / radius
    longest, stoutest = int(slim.argmax()), int(slim.argmin())
    for worst, wrong in (
        (longest if slim[longest] > SLENDERNESS[1] else None, "are positions in millimetres?"),
        (stoutest if slim[stoutest] < SLENDERNESS[0] else None, "are diameters in millimetres?"),
    ):
        if worst is not None:
            yield (
                f"member {structure.members[worst].name!r} is {length[worst]:.4g} m long, its section's "
                f"radius of gyration {radius[worst]:.3g} m: {wrong} all are read as m"
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
