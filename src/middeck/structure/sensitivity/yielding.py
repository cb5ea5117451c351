"""How a rest state moves as its members strain further at the same forces."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import static_coordinates
from middeck.structure.assembly.strain import strain_pull
from middeck.structure.elements.frames import move
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.sensitivity.links_and_components import Tied
from middeck.structure.sensitivity.patches import STEP
from middeck.structure.sensitivity.rest import RestMotion, support_slopes, tension_slopes
from middeck.structure.sensitivity.static_solver import StaticSolver


def yield_further(rest: Equilibrium, strain: Float[np.ndarray, "element 6 field"]) -> RestMotion:
    """Motion of the rest state by ``strain`` (stretch, y1, z1, y2, z2, twist) of each beam element and field.

    Forces were D e; with D (e - strain) in their place the rest state moves by K_t^-1 B' D strain. Raises
    `NumericalError` as `differentiate_rest`.
    """
    at = assemble(rest.model, rest.config, rest.loads)
    pull = strain_pull(rest.model, rest.config, strain)
    motion = StaticSolver.at(rest, at).solve(pull)
    gradient = at.tangent @ motion - pull
    links = Tied.at(rest.model, rest.config, static_coordinates(rest.model))
    gradient = gradient + links.slope.T @ links.multipliers(gradient)
    still = dataclasses.replace(rest.config, since_drawn=None)
    along = [move(rest.model.tree, still, STEP * 1j * step) for step in motion.T]
    moved = [(rest.model, there, rest.loads) for there in along]
    return RestMotion(
        motion=motion,
        drawn=np.zeros_like(motion),
        tension=tension_slopes(rest, moved),
        support=support_slopes(rest, gradient, moved),
    )
