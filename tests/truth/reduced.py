"""Articles whole, and with a part of them reduced."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.structure.model.article import Structure
from middeck.structure.modes.craig_bampton import reduce_structure
from structure_builders import NONE, TUBE, body, member, node, structure

SOFT = dataclasses.replace(TUBE, rho_I_y=1e-4, rho_I_z=1e-4)


def bent_beam(rng: np.random.Generator, stiffness: float = 100.0) -> tuple[Structure, Structure]:
    """a-m-b-c with heavy nodes, out of plane, and its part a-m-b alone."""
    section = dataclasses.replace(
        SOFT, EI_y=stiffness, EI_z=stiffness * rng.uniform(0.7, 1.3), GJ=stiffness, EA=1e4 * stiffness
    )
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    m, b = 0.5 * d + 0.1 * rng.normal(size=3), d + 0.05 * rng.normal(size=3)
    heavy = [body(rng.uniform(0.01, 1.0), (0, 0, 0), (2e-3, 2e-3, 2e-3)) for _ in range(3)]
    nodes = [
        node("a", np.zeros(3)),
        node("m", m, heavy[0]),
        node("b", b, heavy[1]),
        node("c", b + 0.6 * (d + 0.3 * rng.normal(size=3)), heavy[2]),
    ]
    up = np.cross(d, rng.normal(size=3))
    members = [member(*ends, section, 6, up) for ends in ("am", "mb", "bc")]
    return structure(nodes, members), structure(nodes[:3], members[:2])


def with_component(whole: Structure, part: Structure, **reduction: object) -> Structure:
    """``whole`` with its part a-m-b as a component."""
    made = reduce_structure(part, ["a", "b"], name="part", **reduction).component
    kept = [dataclasses.replace(n, body=NONE) if n.name in "ab" else n for n in whole.nodes if n.name != "m"]
    bare = structure(kept, [whole.members[-1]])
    return dataclasses.replace(bare, components=(made,))
