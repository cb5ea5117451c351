"""The rest state under slightly other loads, by plain Newton from a near one: on its branch or not at all."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly import Assembly, Loads, assemble_carried, carried_mass
from middeck.structure.elements.frames import Configuration
from middeck.structure.factorisation import factorise
from middeck.structure.mesh import Model
from middeck.structure.statics import (
    STANDARD_GRAVITY,
    TOLERANCE,
    imbalance,
    imbalance_scale,
    move_whole,
    spread,
    static_coordinates,
)

MAX_ITERATIONS = 12
# Each correction must be at most this part of the one before (Deuflhard 2004, section 2.1): Newton that does
# not contract is on its way to another branch, or to none.
CONTRACTION = 0.5
# Largest correction [m or rad] of any coordinate.
LONGEST_STEP = 0.3
# Multiples of the mass [1/s^2] that stand in for the stiffness of a motion that nothing holds, lest rounding
# drive it; the smallest that will do. They slow Newton down by their part of omega^2, and move no rest state.
HOLDS = (1e-8, 1e-5, 1e-2)


def rest_near(model: Model, config: Configuration, loads: Loads) -> tuple[Configuration, Assembly] | None:
    """The rest state under ``loads`` on the branch of ``config``, stable or not; None where Newton loses it.

    Nothing here descends: where the branch loses stability it is followed all the same.
    """
    active = static_coordinates(model)
    mass = carried_mass(model, config)
    # Of the weight on the ground, if that is more: the gravity of a path may be as small as it likes.
    lightness = max(1.0, STANDARD_GRAVITY / (float(np.linalg.norm(loads.gravity)) or STANDARD_GRAVITY))
    scale = lightness * imbalance_scale(model, loads)
    at = assemble_carried(model, config, loads)
    size = np.inf
    for _ in range(MAX_ITERATIONS):
        rested = imbalance(at, active, scale) < TOLERANCE
        q = _correction(at, mass, active)
        length = np.inf if q is None else float(np.abs(q).max())
        if q is None or (length > CONTRACTION * size and not rested):
            break
        moved = move_whole(model.tree, config, q, mass)
        new = assemble_carried(model, moved, loads)
        if rested:  # one more step, to rounding, if it does any good
            return (
                (moved, new) if imbalance(new, active, scale) < imbalance(at, active, scale) else (config, at)
            )
        config, at, size = moved, new, length
    return (config, at) if imbalance(at, active, scale) < TOLERANCE else None


def _correction(
    at: Assembly, mass: sp.csr_array, active: np.ndarray
) -> Float[np.ndarray, " coordinate"] | None:
    K, M = at.tangent[active][:, active], mass[active][:, active]
    for hold in HOLDS:
        factor = factorise(sp.csr_array(K + hold * M))
        if factor is None:
            continue
        q = -factor.solve(at.gradient[active])
        if np.all(np.isfinite(q)) and np.abs(q).max(initial=0.0) < LONGEST_STEP:
            return spread(q, active)
    return None
