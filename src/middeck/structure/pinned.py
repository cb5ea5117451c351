"""Support forces of a structure pinned at points: Newton's method with multipliers, at full gravity."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Inexact, Int

from middeck.errors import EquilibriumError
from middeck.structure.assembly import Loads, assemble, mass_matrix, no_loads
from middeck.structure.elements.frames import Configuration, frame_poses, move, points_in_world
from middeck.structure.factorisation import factorise
from middeck.structure.mesh import Model
from middeck.structure.statics import (
    LOAD_FACTORS,
    MAX_ITERATIONS,
    TOLERANCE,
    load_scale,
    scale_loads,
    spread,
    static_coordinates,
)
from middeck.values import record

# A motion that nothing resists is opposed by this acceleration, in g per metre: so weak that weight drives it
# 25 km in one step and is found out, so strong that rounding alone does not drive it.
HOLD_IN_G = 1e-5
RUNAWAY_M = 10.0
# Give of a support in one step, over that of the stiffest part; the next steps take it back. Without it,
# supports that hold one rigid motion twice would leave their forces undetermined.
SUPPORT_GIVES = 1e-4


@record
class PinnedPoints:
    """Poses held in the world directions given as letters, e.g. "yz", one string per pose."""

    point: Int[np.ndarray, " pinned"]
    held: tuple[str, ...]


@record
class Supports:
    """One row per held direction: which pinned point, its pose, world axis and undeformed coordinate."""

    row: np.ndarray
    pose: np.ndarray
    axis: np.ndarray
    start: np.ndarray


@record
class PinnedState:
    """Where the pinned structure rests, and the force [N] of each row of its supports."""

    config: Configuration
    supports: Supports
    force: np.ndarray


def solve_pinned(
    model: Model, gravity: Float[np.ndarray, "3"], pinned: PinnedPoints, others: Loads | None = None
) -> Float[np.ndarray, "pinned 3"]:
    """Support forces [N] at full gravity with the points held; nonlinear, by load steps.

    The devices of ``others`` act meanwhile; their gravity counts for nothing.

    Raises `EquilibriumError` when the weight drives a motion that the supports leave free, or when the
    iteration does not converge. A free motion that no weight drives is let be: it changes no force.
    """
    other = no_loads() if others is None else others
    loads = Loads(gravity, other.anchor, other.attach_point, other.law, other.mass)
    state = settle_pinned(model, loads, pinned)
    return support_forces(state.supports, state.force, len(pinned.point))


def settle_pinned(model: Model, loads: Loads, pinned: PinnedPoints) -> PinnedState:
    """The state behind `solve_pinned`, which says what it raises."""
    supports = find_supports(model, pinned)
    config, force = model.rest, np.zeros(len(supports.axis))
    for factor in (*LOAD_FACTORS, 1.0):
        config, force = _settle_pinned(model, scale_loads(loads, factor), supports, config, force)
    return PinnedState(config, supports, force)


def support_forces(
    supports: Supports, force: Inexact[np.ndarray, " row"], points: int
) -> Inexact[np.ndarray, "pinned 3"]:
    """The force of every row, as vectors at the pinned points."""
    out = np.zeros((points, 3), dtype=force.dtype)
    np.add.at(out, (supports.row, supports.axis), force)
    return out


def find_supports(model: Model, pinned: PinnedPoints) -> Supports:
    """The held directions of ``pinned``; analytic in the model."""
    held = [(i, p, "xyz".index(c)) for i, p in enumerate(pinned.point) for c in pinned.held[i]]
    row, pose, axis = np.array(held, dtype=int).reshape(-1, 3).T
    return Supports(row, pose, axis, support_coordinates(model, model.rest, pose, axis))


def support_coordinates(
    model: Model, config: Configuration, pose: np.ndarray, axis: np.ndarray
) -> np.ndarray:
    """World coordinates of poses, each along one axis; analytic."""
    return points_in_world(model.points, frame_poses(model.tree, config))[pose, axis]


def _settle_pinned(
    model: Model, loads: Loads, supports: Supports, config: Configuration, force: np.ndarray
) -> tuple[Configuration, np.ndarray]:
    active = static_coordinates(model)
    scale = load_scale(model, loads)
    hold = HOLD_IN_G * float(np.linalg.norm(loads.gravity))
    mass = hold * mass_matrix(model, config)[active][:, active]
    for _ in range(MAX_ITERATIONS):
        load = np.zeros((len(model.points.frame), 6))
        np.add.at(load, (supports.pose, supports.axis), -force)  # a support force is minus an energy gradient
        at = assemble(model, config, loads, load)
        gradient = at.gradient[active]
        slip = support_coordinates(model, config, supports.pose, supports.axis) - supports.start
        if np.abs(gradient).max() < TOLERANCE * scale and np.abs(slip).max() < TOLERANCE:
            return config, force
        G = at.jacobian[6 * supports.pose + supports.axis][:, active]
        q, change = _constrained_step(at.tangent[active][:, active] + mass, G, gradient, slip)
        config, force = move(model.tree, config, spread(q, active)), force - change
    raise EquilibriumError(
        f"pinned at its attach points, the article does not settle in {MAX_ITERATIONS} iterations",
        where="suspension.held",
        hint="hold more directions, or look for members too soft to carry the weight",
    )


def _constrained_step(
    K: sp.csr_array, G: sp.csr_array, gradient: np.ndarray, slip: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Newton step (q, multipliers m) with supports that give: K q + G'm = -gradient, G q - c m = -slip.

    The multipliers are eliminated, m = (G q + slip)/c.
    """
    stiff = float(np.abs(K.diagonal()).max()) / SUPPORT_GIVES
    factor = factorise(sp.csr_array(K + stiff * (G.T @ G)))
    q = np.full(len(gradient), np.inf) if factor is None else -factor.solve(gradient + stiff * (G.T @ slip))
    if not np.abs(q).max() < RUNAWAY_M:
        raise EquilibriumError(
            "pinned at its attach points, the article is still a mechanism that its weight drives",
            where="suspension.held",
            hint="hold enough directions: y and z at each of three points and x at one stop a straight bus; "
            "if they are held, the article is far too soft or heavy: check the units of its lengths and E",
        )
    return q, stiff * (G @ q + slip)
