"""Box trusses for the tests of names and pictures."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.structure.model.article import Member, Section, Structure
from middeck.structure.model.section import MemberMass
from structure_builders import body, member, node, structure

CORNERS = ((-1, -1), (-1, 1), (1, 1), (1, -1))


def bar(name: str, start: str, end: str, section: Section, up: tuple[float, float, float]) -> Member:
    return dataclasses.replace(member(start, end, section, 1, up), name=name)


def truss(bays: int, length: float, width: float, depth: float, rng: np.random.Generator) -> Structure:
    """A box truss along x of bars that also bend; with a mass at each node, so that stations have inertia."""
    strong = Section(EA=2e6, GJ=60.0, EI_y=80.0, EI_z=80.0, rho_A=0.1, rho_I_y=0.0, rho_I_z=0.0)
    weak = dataclasses.replace(strong, EA=float(rng.uniform(2e5, 1e6)), EI_y=20.0, EI_z=20.0)
    nodes = [
        node(f"{i}{c}", (i * length, 0.5 * y * depth, 0.5 * z * width), body(0.3))
        for i in range(bays + 1)
        for c, (y, z) in enumerate(CORNERS)
    ]
    members: list[Member] = []
    for i in range(bays + 1):
        for c in range(4):
            up = (1.0, 0.0, 0.0)
            members.append(bar(f"batten {4 * i + c}", f"{i}{c}", f"{i}{(c + 1) % 4}", weak, up))
            if i < bays:
                other = (c + 1) % 4 if i % 2 else (c - 1) % 4
                up = (0.0, 0.31, 0.95)
                members.append(bar(f"longeron {4 * i + c}", f"{i}{c}", f"{i + 1}{c}", strong, up))
                members.append(bar(f"diagonal {4 * i + c}", f"{i}{c}", f"{i + 1}{other}", weak, up))
    return structure(nodes, members)


def rod_mast(bays: int, length: float, width: float) -> Structure:
    """A square mast of rods along x, both faces of each bay crossed: no member bends or twists."""
    rod = Section(
        EA=7e6, GJ=0.0, EI_y=0.0, EI_z=0.0, rho_A=0.27, rho_I_y=0.0, rho_I_z=0.0, mass=MemberMass.ROD
    )
    nodes = [
        node(f"{i}{c}", (i * length, 0.5 * y * width, 0.5 * z * width), body(5.0))
        for i in range(bays + 1)
        for c, (y, z) in enumerate(CORNERS)
    ]
    members: list[Member] = []
    for i, c in np.ndindex(bays, 4):
        here, beside, above, across = f"{i}{c}", f"{i}{(c + 1) % 4}", f"{i + 1}{c}", f"{i + 1}{(c + 1) % 4}"
        for kind, (start, end) in {
            "leg": (here, above),
            "diagonal": (here, across),
            "other": (beside, above),
            "batten": (above, across),
        }.items():
            members.append(bar(f"{kind} {4 * i + c}", start, end, rod, (0.31, 0.53, 0.79)))
    members += [
        bar(f"brace {2 * i + c}", f"{i}{c}", f"{i}{c + 2}", rod, (1.0, 0.0, 0.0))
        for i in range(1, bays + 1)
        for c in (0, 1)
    ]
    return structure(nodes, members)
