"""Random connected frames whose members are soft and stiff side by side, some of the soft ones massless."""

from __future__ import annotations

import numpy as np

from middeck.structure.model.article import Section, Structure
from structure_builders import NONE, body, member, node, structure

# E [Pa], nu, rho [kg/m^3]: aluminium, steel, carbon fibre
MATERIALS = ((7e10, 0.33, 2700.0), (2.1e11, 0.3, 7850.0), (1.2e11, 0.3, 1600.0))


def draw(rng: np.random.Generator, ratio: float) -> Structure:
    """Three to eight nodes, 0.1 to 30 m apart, on round rods: a tree with up to two loops closed.

    About half of the members are softer in modulus by ``ratio``, in all directions.
    """
    count, size = int(rng.integers(3, 9)), 10.0 ** rng.uniform(-1.0, 1.5)
    places = size * (
        rng.normal(size=(count, 3))
        if rng.random() < 0.5
        else np.column_stack([np.arange(count), 0.01 * rng.normal(size=(count, 2))])
    )
    E, nu, rho = MATERIALS[rng.integers(3)]
    d = size * 10.0 ** rng.uniform(-2.2, -1.0)
    A, bent = 0.25 * np.pi * d**2, np.pi * d**4 / 64.0

    def section(share: float, rho: float) -> Section:
        return Section(
            EA=share * E * A,
            GJ=share * E * bent / (1.0 + nu),
            EI_y=share * E * bent,
            EI_z=share * E * bent,
            rho_A=rho * A,
            rho_I_y=rho * bent,
            rho_I_z=rho * bent,
        )

    pairs = [(int(rng.integers(k)) if rng.random() < 0.5 else k - 1, k) for k in range(1, count)]
    for _ in range(int(rng.integers(3))):
        a, b = sorted(rng.choice(count, 2, replace=False).tolist())
        pairs += [] if (a, b) in pairs else [(a, b)]
    soft = rng.random(len(pairs)) < 0.5
    one, other = rng.choice(len(pairs), 2, replace=False)
    soft[one], soft[other] = True, False
    massless, heavy = rng.random() < 0.3, rng.random() < 0.6
    members = [
        member(
            f"n{a}",
            f"n{b}",
            section(ratio, 0.0 if massless else rho) if yields else section(1.0, rho),
            int(rng.integers(1, 13)),
            rng.normal(size=3),
        )
        for (a, b), yields in zip(pairs, soft, strict=True)
    ]
    m = rho * A * size
    bodies = [
        body(m * 10.0 ** rng.uniform(-2, 2), inertia=m * d**2 * 10.0 ** rng.uniform(-1, 2) * np.ones(3))
        if massless or (heavy and rng.random() < 0.6)
        else NONE
        for _ in range(count)
    ]
    return structure([node(f"n{i}", places[i], bodies[i]) for i in range(count)], members)
