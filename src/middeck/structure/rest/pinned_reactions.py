"""Support forces of a structure pinned at points: Newton's method with multipliers, at full gravity."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact, Int

from middeck.errors import EquilibriumError
from middeck.structure.assembly.energy import assemble_carried
from middeck.structure.assembly.environment_loads import Loads, scale_loads
from middeck.structure.assembly.factorisation import factorise
from middeck.structure.assembly.linked import closed, static_freedom
from middeck.structure.assembly.mass import drawn_mass
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.springs import pose_shift
from middeck.structure.elements.frames import Configuration, move_carried, points_in_world
from middeck.structure.elements.motion_since_drawn import uncarried
from middeck.structure.rest.damped_descent import MAX_ITERATIONS
from middeck.structure.rest.followed_branch import CONTRACTION
from middeck.structure.rest.imbalance import article_size, imbalance, imbalance_scale
from middeck.structure.rest.rest_criteria import LONGEST_STEP, TOLERANCE
from middeck.structure.rest.settle import LOAD_FACTORS
from middeck.values import record

# A motion that nothing resists is opposed by this acceleration, in g per metre: so weak that weight drives it
# 25 km in one step and is found out, so strong that rounding alone does not drive it.
HOLD_IN_G = 1e-5
RUNAWAY_M = 10.0
# What moves farther under its weight is taken for a mechanism (rad, and m or sizes of a large article).
SWING = 0.8
# Compliance of a motion, over the largest of the supports, below which it is rigid and held twice: statics
# then leaves the share of each support open, and they share equally.
HELD_TWICE = 1e-13


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
    """Rest state of the pinned structure, and the force [N] of each row of its supports."""

    config: Configuration
    supports: Supports
    force: np.ndarray


def settle_pinned(model: Model, loads: Loads, pinned: PinnedPoints) -> PinnedState:
    """The structure under ``loads`` with the points held; nonlinear, by load steps.

    Raises `EquilibriumError` when the weight drives a motion that the supports leave free, or when the
    iteration does not converge. A free motion that no weight drives is ignored: it changes no force.
    """
    supports = find_supports(model, pinned)
    mass = drawn_mass(model)
    start, none = model.rest, np.zeros(len(supports.axis))
    found = _settle_pinned(model, loads, supports, mass, start, none, contract=True)
    if found is None:
        found = _settle_pinned(model, loads, supports, mass, start, none, carried_first=True)
    if found is None:
        found = start, none
        for factor in (*LOAD_FACTORS, 1.0):
            found = _settle_pinned(model, scale_loads(loads, factor), supports, mass, *found)
            if found is None:
                raise EquilibriumError(
                    f"the article, held at its attach points, does not settle in {MAX_ITERATIONS} iterations",
                    where="suspension.held",
                    hint="hold more directions, or look for members too soft to carry the weight",
                )
    return PinnedState(found[0], supports, found[1])


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
    return Supports(row, pose, axis, points_in_world(model.points, model.drawn)[pose, axis])


def _settle_pinned(
    model: Model,
    loads: Loads,
    supports: Supports,
    mass: sp.csr_array,
    config: Configuration,
    force: np.ndarray,
    *,
    contract: bool = False,
    carried_first: bool = False,
) -> tuple[Configuration, np.ndarray] | None:
    """Newton's method from ``config`` and ``force``; None where it does not settle.

    Or where its steps do not ``contract``: it is then on its way to some other branch. ``carried_first``:
    the first step finds support forces alone, and all others add up to no more than `SWING`.
    """
    scale = imbalance_scale(model, loads)
    size, swung = np.inf, np.zeros(1)
    most = SWING * np.where(model.tree.turns, 1.0, max(article_size(model), 1.0))
    for step in range(MAX_ITERATIONS):
        free = static_freedom(model, config)
        first = carried_first and step == 0
        hold = HOLD_IN_G * float(np.linalg.norm(loads.gravity)) * free.matrix(mass)
        load = np.zeros((len(model.points.frame), 6))
        np.add.at(load, (supports.pose, supports.axis), -force)  # a support force is minus an energy gradient
        at = assemble_carried(model, config, loads, load)
        slip = pose_shift(model, config, supports.pose)[np.arange(len(force)), supports.axis]
        if imbalance(at, free, scale) < TOLERANCE and np.abs(slip).max(initial=0.0) < TOLERANCE:
            return config, force
        G = free.columns(at.jacobian[6 * supports.pose + supports.axis])
        K = sp.csr_array(free.matrix(at.tangent) + hold)
        soft = uncarried(config.since_drawn, len(free.active))[free.active]
        spring = max(float(np.abs(K.diagonal()[soft]).max(initial=0.0)), scale[0] / article_size(model))
        q, change = _constrained_step(K, G, free.part(at.gradient), slip, spring)
        if first:
            force = force - change
            continue
        before, size = size, float(np.abs(q).max(initial=0.0))
        if not (size < RUNAWAY_M or contract or carried_first):
            raise EquilibriumError(
                "the article, held at its attach points, is still a mechanism that moves under its weight",
                where="suspension.held",
                hint="hold enough directions: y and z at each of three points and x at one stop a straight "
                "bus; if they are held, the centre of mass lies far beside or above the attach points, or "
                "the article is far too soft or heavy: check the units of its lengths and E",
            )
        if contract and not size <= min(CONTRACTION * before, LONGEST_STEP):
            return None
        if carried_first:
            if not np.isfinite(size):
                return None
            q *= LONGEST_STEP / max(size, LONGEST_STEP)
            swung = swung + free.spread(q)
            if not np.all(np.abs(swung) <= most):
                return None
        moved = closed(model, move_carried(model.tree, config, free.spread(q)))
        if moved is None:
            return None
        config, force = moved, force - change
    return None


def _constrained_step(
    K: sp.csr_array, G: sp.csr_array, gradient: np.ndarray, slip: np.ndarray, spring: float
) -> tuple[np.ndarray, np.ndarray]:
    """Newton step (q, multipliers m): K q + G'm = -gradient, G q = -slip.

    A ``spring`` at every support makes the matrix regular and changes nothing, for it adds the same to both
    sides; the multipliers then follow from the compliance of the supports, S m = G q(m = 0) + slip.
    """
    factor = factorise(sp.csr_array(K + spring * (G.T @ G)))
    q = np.full(len(gradient), np.inf)
    m = np.zeros(len(slip))
    if factor is not None:
        across = factor.solve(G.T.toarray())
        q = -factor.solve(gradient + spring * (G.T @ slip))
        S = G @ across
        m = np.linalg.pinv(0.5 * (S + S.T), rcond=HELD_TWICE, hermitian=True) @ (G @ q + slip)
        q = q - across @ m
    return q, m
