"""Derivatives of the support forces of the pinned article, to which devices are tuned.

The pinned article balances, g(q, p) = G'f, with its held coordinates where they were drawn, s(q, p) = 0. The
derivatives of q and f solve

    K dq - G'df = -dg,    G dq = -ds,

with the same matrices as the last Newton step of `pinned`.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from middeck.errors import NumericalError
from middeck.structure.assembly.energy import assemble, energy_gradient
from middeck.structure.assembly.factorisation import factorise
from middeck.structure.assembly.linked import static_coordinates, static_freedom
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import frame_poses, points_in_world
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.pinned_reactions import HOLD_IN_G, Supports, find_supports, support_forces
from middeck.structure.rest.suspension_tuning import pinned_loads, pinned_points
from middeck.structure.sensitivity.links_and_components import Tied, TieModel
from middeck.structure.sensitivity.patches import (
    STEP,
    Patch,
    columns,
    derivative,
    float_patches,
    restrict,
    spread_gradients,
)

# Give of a support in one step, over that of the stiffest part; the next steps take it back.
SUPPORT_GIVES = 1e-4
# What the iteration may leave, over the terms that balance in it.
SOLVED = 1e-11
MAX_ITERATIONS = 30


def differentiate_support(
    rest: Equilibrium, patches: Sequence[Patch], tied: Sequence[TieModel], drawn: np.ndarray
) -> list[np.ndarray | None]:
    """Support forces (pinned, 3) of every patch with their derivatives; None where nothing is tuned.

    ``tied`` are the links and components of the patches, ``drawn`` the derivatives of the undeformed
    configuration, a column a patch.
    """
    state = rest.suspension.pinned
    if state is None or not patches:
        return [None] * len(patches)
    loads = pinned_loads(rest.model, rest.environment)
    at = assemble(rest.model, state.config, loads, _hold(rest.model, state.supports, state.force))
    rows = 6 * state.supports.pose + state.supports.axis
    G = sp.csr_array(at.jacobian[rows])
    own = [find_supports(patch.model, pinned_points(patch.model, patch.environment)) for patch in patches]
    here = [restrict(p, state.config) for p in patches]
    held = [_hold(p.model, s, state.force) for p, s in zip(patches, own, strict=True)]
    rafts = float_patches(patches, here, [pinned_loads(p.model, p.environment) for p in patches])
    gradients = [
        energy_gradient(at.raft.model, at.config, at.loads, np.concatenate([held[p] for p in at.which]))
        for at in rafts
    ]
    force = spread_gradients(rest.model, patches, list(zip(rafts, gradients, strict=True)))
    slip = [
        points_in_world(p.model.points, frame_poses(p.model.tree, config))[s.pose, s.axis] - s.start
        for p, config, s in zip(patches, here, own, strict=True)
    ]
    free = static_freedom(rest.model, state.config, in_world=True)
    links = Tied.at(rest.model, state.config, static_coordinates(rest.model))
    load = _hold(rest.model, state.supports, state.force)
    multiplier = links.multipliers(energy_gradient(rest.model, state.config, loads, load))
    ties = [
        t.change(state.config, 0.0 * d, p.environment.gravity, multiplier + 0j)
        for t, p, d in zip(tied, patches, drawn.T, strict=True)
    ]
    force = force + columns([t.gradient for t in ties], len(force))
    base = drawn + links.follow(links.slope @ drawn + columns([t.value for t in ties], len(multiplier)))
    mass = mass_matrix(rest.model, state.config)
    hold = HOLD_IN_G * float(np.linalg.norm(loads.gravity)) * free.matrix(mass)
    change = _solve(
        free.matrix(at.tangent),
        sp.csr_array(hold),
        free.columns(G),
        -free.part(force + at.tangent @ base),
        -columns([derivative(s) for s in slip], len(rows)) - G @ base,
    )
    forces = (state.force + STEP * 1j * change[:, p] for p in range(len(patches)))
    points = int(state.supports.row.max()) + 1
    return [support_forces(s, f, points) for s, f in zip(own, forces, strict=True)]


def _hold(model: Model, supports: Supports, force: np.ndarray) -> np.ndarray:
    """The energy gradient that stands for the support forces."""
    load = np.zeros((len(model.points.frame), 6))
    np.add.at(load, (supports.pose, supports.axis), -force)
    return load


def _solve(
    K: sp.csr_array, hold: sp.csr_array, G: sp.csr_array, load: np.ndarray, shift: np.ndarray
) -> np.ndarray:
    """Forces f of K q - G'f = load, G q = shift, by iterative refinement of supports that give."""
    held = sp.csr_array(K + hold)
    stiff = float(np.abs(held.diagonal()).max()) / SUPPORT_GIVES
    factor = factorise(sp.csr_array(held + stiff * (G.T @ G)))
    if factor is None:
        raise _loose()
    q, f = np.zeros_like(load), np.zeros_like(shift)
    length = np.abs(shift).max(axis=0)
    for _ in range(MAX_ITERATIONS):
        left, slip = load - K @ q + G.T @ f, shift - G @ q
        force = np.abs(load).max(axis=0) + (abs(K) @ np.abs(q)).max(axis=0)
        length = np.maximum(length, np.abs(q).max(axis=0))
        balanced = np.abs(left).max(axis=0) <= SOLVED * force
        if np.all(balanced & (np.abs(slip).max(axis=0) <= SOLVED * length)):
            return f
        step = factor.solve(left + stiff * (G.T @ slip))
        q, f = q + step, f - stiff * (G @ step - slip)
    raise _loose()


def _loose() -> NumericalError:
    return NumericalError(
        "the pinned article has no derivative: a parameter drives a motion that its supports leave free",
        where="suspension.held",
        hint="hold more directions while the devices are tuned",
    )
