"""The rest state under slightly other loads by Newton's method, on the branch of a near one."""

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.energy import Assembly, assemble_carried
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.factorisation import Factor, factorise
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import closed, static_freedom
from middeck.structure.assembly.mass import carried_mass
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration
from middeck.structure.rest.followed_branch import rest_beside
from middeck.structure.rest.imbalance import STANDARD_GRAVITY, imbalance, imbalance_scale
from middeck.structure.rest.rest_criteria import TOLERANCE
from middeck.structure.rest.rigid_and_deforming_steps import deformation, move_whole, stride

MAX_ITERATIONS = 12
# Each correction must be at most this part of the one before (Deuflhard 2004, section 2.1): Newton that does
# not contract is on its way to another branch, or to none.
CONTRACTION = 0.5
# Share of `TOLERANCE` that rounding alone leaves.
ROUNDED = 1e-4
# Largest correction: a turn [rad], or a change of shape over the article's size.
LONGEST_STEP = 0.3
# Multiples of the mass [1/s^2] that stand in for the stiffness of a motion that nothing holds, lest rounding
# drive it; the smallest that will do. They slow Newton down by their part of omega^2, and move no rest state.
HOLDS = (1e-8, 1e-5, 1e-2)


def rest_near(
    model: Model, config: Configuration, loads: Loads, mass: sp.csr_array | None = None
) -> tuple[Configuration, Assembly] | None:
    """The rest state under ``loads`` on the branch of ``config``, stable or not; None where Newton loses it.

    Nothing here descends: where the branch loses stability it is followed all the same. ``mass``, in carried
    coordinates, need not be exact. Where second-order strain of stiff members stops Newton's method on the
    potential, the forces inside become unknowns too.
    """
    mass = carried_mass(model, config) if mass is None else mass
    near = _on_potential(model, config, loads, mass)
    if near is not None:
        return near
    found = rest_beside(model, config, loads, mass)
    return None if found is None else (found, assemble_carried(model, found, loads))


def _on_potential(
    model: Model, config: Configuration, loads: Loads, mass: sp.csr_array
) -> tuple[Configuration, Assembly] | None:
    # Relative to the weight on the ground if that is more: the gravity of a path may be very small.
    lightness = max(1.0, STANDARD_GRAVITY / (float(np.linalg.norm(loads.gravity)) or STANDARD_GRAVITY))
    scale = lightness * imbalance_scale(model, loads)
    at = assemble_carried(model, config, loads)
    free = static_freedom(model, config)
    left, size, factor = imbalance(at, free, scale), np.inf, None
    for _ in range(MAX_ITERATIONS):
        if left < TOLERANCE:
            break
        correction = _correction(model, config, at, mass, free)
        if correction is None or stride(model, correction[0]) > CONTRACTION * size:
            return None
        q, factor = correction
        moved, size = closed(model, move_whole(model, config, q, mass)), stride(model, q)
        if moved is None:
            return None
        config = moved
        at, free = assemble_carried(model, config, loads), static_freedom(model, config)
        left = imbalance(at, free, scale)
    if left >= TOLERANCE:
        return None
    if factor is not None and left > ROUNDED * TOLERANCE:  # one more step, to rounding, if it does any good
        q = free.spread(-factor.solve(free.part(at.gradient)))
        moved = closed(model, move_whole(model, config, q, mass))
        if moved is not None:
            new = assemble_carried(model, moved, loads)
            if imbalance(new, static_freedom(model, moved), scale) < left:
                return moved, new
    return config, at


def _correction(
    model: Model, config: Configuration, at: Assembly, mass: sp.csr_array, free: Freedom
) -> tuple[np.ndarray, Factor] | None:
    """Newton's step in all coordinates, and the factor that it came from; None where none is short."""
    K, M = free.matrix(at.tangent), free.matrix(mass)
    for hold in HOLDS:
        factor = factorise(sp.csr_array(K + hold * M))
        q = None if factor is None else free.spread(-factor.solve(free.part(at.gradient)))
        if q is None or not np.all(np.isfinite(q)):
            continue
        if factor is not None and deformation(model, config, q, mass) < LONGEST_STEP:
            return q, factor
    return None
