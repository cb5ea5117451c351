"""Newton's method on the potential: pinned supports by multipliers, free hanging by damped descent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float, Int

from middeck.errors import EquilibriumError
from middeck.structure.article import JointState
from middeck.structure.assembly import Assembly, Loads, assemble, mass_matrix, no_loads
from middeck.structure.devices import SpringLaw
from middeck.structure.frames import Configuration, frame_poses, move, points_in_world
from middeck.structure.mesh import Model
from middeck.values import record

# Relative to the load scale: a bus of axial stiffness 1e7 N/m at 1 m has rounding of 1e-9 N in 1e2 N.
TOLERANCE = 1e-9
LOAD_STEPS = 4
MAX_ITERATIONS = 60
STANDARD_GRAVITY = 9.80665


@record
class PinnedPoints:
    """Poses held in the world directions given as letters, e.g. "yz", one string per pose."""

    point: Int[np.ndarray, " pinned"]
    held: tuple[str, ...]


class Settled(NamedTuple):
    """Where Newton ended: configuration, its assembly, and (load factor, residual, damping) per iteration."""

    config: Configuration
    assembly: Assembly
    history: tuple[tuple[float, float, float], ...]


def static_coordinates(model: Model) -> Bool[np.ndarray, " coordinate"]:
    """Coordinates that move in statics: roots and sprung joints; other joints are held."""
    joints = [j.state is JointState.SPRUNG for j in model.structure.joints]
    return np.concatenate([np.ones(6 * model.tree.roots, dtype=bool), np.array(joints, dtype=bool)])


def dynamic_coordinates(model: Model) -> Bool[np.ndarray, " coordinate"]:
    """Coordinates that move in dynamics: roots, free and sprung joints."""
    joints = [j.state in (JointState.FREE, JointState.SPRUNG) for j in model.structure.joints]
    return np.concatenate([np.ones(6 * model.tree.roots, dtype=bool), np.array(joints, dtype=bool)])


def solve_pinned(
    model: Model, gravity: Float[np.ndarray, "3"], pinned: PinnedPoints
) -> Float[np.ndarray, "pinned 3"]:
    """Support forces [N] at full gravity with the points held; nonlinear, by load steps.

    Raises `EquilibriumError` when the supports leave a mechanism or the iteration does not converge.
    """
    points, axes = _held_directions(pinned)
    config, force = model.rest, np.zeros(len(points))
    active = static_coordinates(model)
    start = points_in_world(model.points, frame_poses(model.tree, model.rest))[points, axes]
    weight = _load_scale(model, gravity)
    none = no_loads()
    for step in range(1, LOAD_STEPS + 1):
        loads = Loads(gravity * step / LOAD_STEPS, none.anchor, none.attach_point, none.law)
        for _ in range(MAX_ITERATIONS):
            load = np.zeros((len(model.points.frame), 6))
            np.add.at(load, (points, axes), -force)  # a support force is minus an energy gradient
            at = assemble(model, config, loads, load)
            G = at.jacobian[6 * points + axes][:, active].toarray()
            slip = points_in_world(model.points, frame_poses(model.tree, config))[points, axes] - start
            residual = float(np.abs(at.gradient[active]).max()) / weight
            if residual < TOLERANCE and float(np.abs(slip).max()) < TOLERANCE:
                break
            K = at.tangent[active][:, active].toarray()
            q, change = _constrained_step(K, G, at.gradient[active], slip)
            config = move(model.tree, config, _spread(q, active))
            force = force - change
        else:
            raise EquilibriumError(
                f"pinned at its attach points, the article does not settle (residual {residual:.1e})",
                hint="check that the held directions stop every rigid motion",
            )
    out = np.zeros((len(pinned.point), 3))
    rows = np.concatenate([np.full(len(h), i) for i, h in enumerate(pinned.held)])
    np.add.at(out, (rows, axes), force)
    return out


def _held_directions(pinned: PinnedPoints) -> tuple[np.ndarray, np.ndarray]:
    pairs = [(p, "xyz".index(c)) for p, h in zip(pinned.point, pinned.held, strict=True) for c in h]
    points, axes = np.array(pairs, dtype=int).T
    return points, axes


def _constrained_step(
    K: np.ndarray, G: np.ndarray, gradient: np.ndarray, slip: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Newton step (q, multipliers) of the saddle-point system, scaled to comparable rows."""
    m = len(G)
    scale = np.sqrt(np.abs(K).max())
    KKT = np.block([[K, scale * G.T], [scale * G, np.zeros((m, m))]])
    try:
        with np.errstate(all="ignore"):
            lu = sla.lu_factor(KKT)
            step = sla.lu_solve(lu, -np.concatenate([gradient, scale * slip]))
    except (sla.LinAlgError, sla.LinAlgWarning, ValueError) as error:
        raise _mechanism() from error
    if not np.all(np.isfinite(step)) or np.abs(step[: len(K)]).max() > 1e3:
        raise _mechanism()
    return step[: len(K)], scale * step[len(K) :]


def _mechanism() -> EquilibriumError:
    return EquilibriumError(
        "pinned at its attach points, the article is still a mechanism",
        where="suspension.held",
        hint="hold enough directions: y and z at each of three points and x at one stop a straight bus",
    )


def settle(model: Model, loads: Loads) -> Settled:
    """Equilibrium under growing gravity and preload; the tangent is re-formed at every iteration.

    Damping (Levenberg 1944: a multiple of the mass) keeps each step a descent of the potential where the
    tangent is not positive definite; it is reduced after every success and the last step is a pure Newton
    step. Convergence is on the true residual alone.
    """
    active = static_coordinates(model)
    scale = _load_scale(model, loads.gravity, loads)
    config = model.rest
    history: list[tuple[float, float, float]] = []
    steps = np.linspace(1.0 / LOAD_STEPS, 1.0, LOAD_STEPS)
    at = assemble(model, config, _scaled(loads, float(steps[0])))
    for factor in steps:
        now = _scaled(loads, float(factor))
        config, at = _descend(model, config, now, active, float(factor), scale, history)
    return Settled(config, at, tuple(history))


def _scaled(loads: Loads, factor: float) -> Loads:
    law = SpringLaw(loads.law.preload * factor, loads.law.stiffness, loads.law.length)
    return Loads(loads.gravity * factor, loads.anchor, loads.attach_point, law)


def _descend(
    model: Model,
    config: Configuration,
    loads: Loads,
    active: np.ndarray,
    factor: float,
    scale: float,
    history: list[tuple[float, float, float]],
) -> tuple[Configuration, Assembly]:
    at = assemble(model, config, loads)
    damping = 0.0
    M = mass_matrix(model, config)[active][:, active].toarray()
    for _ in range(MAX_ITERATIONS):
        residual = float(np.abs(at.gradient[active]).max(initial=0.0)) / scale
        history.append((factor, residual, damping))
        if residual < TOLERANCE:
            break
        q, damping = _damped_step(at.tangent[active][:, active].toarray(), M, at.gradient[active], damping)
        for _ in range(30):
            trial = move(model.tree, config, _spread(q, active))
            new = assemble(model, trial, loads)
            smaller = np.abs(new.gradient[active]).max() < np.abs(at.gradient[active]).max()
            if new.energy < at.energy or smaller:
                break
            q = 0.5 * q
        else:
            break
        config, at = trial, new
    return config, at


def _damped_step(
    K: np.ndarray, M: np.ndarray, gradient: np.ndarray, damping: float
) -> tuple[np.ndarray, float]:
    """Solve (K + damping M) q = -gradient with the least damping that makes the matrix positive definite."""
    damping = 0.0 if damping < 1e-3 else damping / 10.0
    while True:
        try:
            q = -sla.cho_solve(sla.cho_factor(K + damping * M), gradient)
        except sla.LinAlgError:
            damping = max(10.0 * damping, 1e-3)
            continue
        if np.abs(q).max() < 0.5:  # no rotation or shift beyond what the chart follows well
            return q, damping
        damping = max(10.0 * damping, 1e-3)


def _load_scale(model: Model, gravity: np.ndarray, loads: Loads | None = None) -> float:
    """What a residual is compared with: the weight, on the ground at least, or the largest preload [N]."""
    weight = model.structure.mass * max(float(np.linalg.norm(gravity)), STANDARD_GRAVITY)
    pull = 0.0 if loads is None else float(np.abs(loads.law.preload).max(initial=0.0))
    return max(weight, pull)


def _spread(q: np.ndarray, active: np.ndarray) -> np.ndarray:
    full = np.zeros(len(active))
    full[active] = q
    return full
