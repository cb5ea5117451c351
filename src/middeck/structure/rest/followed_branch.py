"""The branch of the drawn state, followed by Newton's method as all loads grow."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from middeck.structure.assembly.energy import Assembly, assemble_carried, inner_forces
from middeck.structure.assembly.environment_loads import Inner, Loads, scale_loads
from middeck.structure.assembly.factorisation import factorise, positive_factor
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import closed, followed, static_freedom, torn
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.springs import own_law
from middeck.structure.assembly.strain import predict_forces
from middeck.structure.elements.frames import Configuration, move_carried, placed
from middeck.structure.elements.motion_since_drawn import SinceDrawn
from middeck.structure.elements.rotations import skew, turn_of
from middeck.structure.rest.imbalance import article_size, imbalance, imbalance_scale
from middeck.structure.rest.rest_criteria import (
    LONGEST_STEP,
    ROUNDED,
    TOLERANCE,
    UNMOVED,
    NewtonResult,
    holding,
    is_stable,
)
from middeck.structure.rest.rigid_and_deforming_steps import stride, unmoved

# Least part of the loads in one step of following them; iterations in one.
LEAST_PART, MAX_NEWTON = 1e-3, 20
# Newton's steps that stay on the branch are at most this share of the step before (Deuflhard 2004, section
# 2.1); below the second, over the longest, the next step, its square, is rounding.
CONTRACTION, SQUARED = 0.5, 1e-7
# Share of the longest step for the last one to a state on the way; and share of the longest allowed step that
# is aimed at.
NEARBY, FITTING = 0.15, 0.9
# Turn [rad] of a node in the first step of prescribed displacements, and shift over the article's size.
PRESCRIBED_TURN = 0.1


def follow(model: Model, loads: Loads, mass: sp.csr_array) -> NewtonResult | None:
    """Follow the branch of the drawn state by Newton's method, stable or not, as all loads grow together.

    None where the branch ends. A step is as long as the last one shows that Newton's method follows, or half
    of it where that leaves the branch.
    """
    config, inner, done, step = model.rest, None, 0.0, 1.0 / prescribed_steps(model)
    history: list[tuple[float, float, float]] = []
    while done < 1.0 and step > LEAST_PART:
        part = min(1.0, done + step)
        found = _newton(
            model, config, inner, scale_loads(loads, part), mass, part=part - done, rough=part < 1.0
        )
        step = (part - done) * min(2.0, max(found.fitting, 0.25) if found.to is None else found.fitting)
        if found.to is None:
            continue
        config, inner = found.to
        history += [(part, residual, 0.0) for residual in found.left]
        done = part
    if done < 1.0:
        return None
    at = assemble_carried(model, config, loads)
    enough = TOLERANCE if history[-1][1] < TOLERANCE else ROUNDED
    return NewtonResult(
        config=config,
        assembly=at,
        residual=history[-1][1],
        enough=enough,
        history=tuple(history),
        stable=is_stable(model, config, at, loads),
        followed=True,
    )


class _Newton(NamedTuple):
    """Where Newton's method ended, None where it left the branch, and the residuals of its iterations.

    ``fitting`` times the step of the loads would have made its first step as long as it may be.
    """

    fitting: float
    to: tuple[Configuration, Inner | None] | None = None
    left: tuple[float, ...] = ()


def _newton(
    model: Model,
    start: Configuration,
    inner: Inner | None,
    loads: Loads,
    mass: sp.csr_array,
    *,
    part: float,
    rough: bool,
) -> _Newton:
    """Newton's method from nearby, after a further ``part`` of what is prescribed.

    Forces inside are unknowns (see `unfold`). It ends where the next step would be rounding, whatever
    the loads are beside the weight; on the way a ``rough`` state will do, to which it contracts.
    """
    scale = imbalance_scale(model, loads)
    config, moved = displace(model, start, loads, part, inner)
    inner = inner if moved is None else moved
    left, longest, before, fitting = [], 0.0, LONGEST_STEP, 0.5
    for _ in range(MAX_NEWTON):
        free = static_freedom(model, config)
        at = assemble_carried(model, config, loads, None, inner)
        left.append(imbalance(at, free, scale))
        # The next step would be rounding: nothing is left, the last was short, or it did no good.
        fell = len(left) < 2 or left[-1] < 0.5 * left[-2]
        if left[-1] < TOLERANCE and (left[-1] == 0.0 or before < SQUARED * longest or not fell):
            break
        held = holding(free.matrix(at.tangent), free.matrix(mass))
        q = _solve_spun(held, _spin(model, at, loads, free), free.part(at.gradient))
        if q is None:
            return _Newton(0.5)
        q = free.spread(q)
        step = stride(model, q)
        if longest == 0.0:
            fitting = FITTING * LONGEST_STEP / max(step, UNMOVED)
        if left[-1] < ROUNDED and step < unmoved(model, config):
            break
        if not step < (CONTRACTION * before if longest > 0.0 else LONGEST_STEP):
            return _Newton(min(fitting, 0.5) if longest > 0.0 else fitting)
        longest, before = max(longest, step), step
        inner = predict_forces(model, config, loads, q, at)
        moved = closed(model, move_carried(model.tree, config, q))
        if moved is None:
            return _Newton(0.5)
        config = moved
        inner = with_linear_springs(model, config, loads, inner)
        if rough and step < NEARBY * longest:
            break
    else:
        return _Newton(0.5)
    return _Newton(fitting, (config, inner), tuple(left))


def rest_beside(
    model: Model, config: Configuration, loads: Loads, mass: sp.csr_array
) -> Configuration | None:
    """The rest state on the branch of ``config``, the forces inside as unknowns; None where it is left."""
    found = _newton(model, config, None, loads, mass, part=0.0, rough=False)
    return None if found.to is None else found.to[0]


def _spin(model: Model, at: Assembly, loads: Loads, free: Freedom) -> sp.csr_array | None:
    """The antisymmetric part of the tangent for moments of fixed direction: -[M]/2 on the turn of each.

    The rest of the tangent is that of potentials in the chart exp(theta) R, where a gradient M has it.
    """
    moved = np.flatnonzero(np.any(loads.push[:, 3:] != 0.0, axis=1))
    if not len(moved):
        return None
    rows = (6 * model.load_point[moved][:, None] + np.arange(3, 6)).ravel()
    turns = free.columns(at.jacobian[rows])
    return sp.csr_array(turns.T @ sp.block_diag(list(-0.5 * skew(loads.push[moved, 3:]))) @ turns)


def _solve_spun(K: sp.csr_array, spin: sp.csr_array | None, gradient: np.ndarray) -> np.ndarray | None:
    """Newton's step; None where there is none."""
    if spin is None:
        factor = factorise(K)
        return None if factor is None else -factor.solve(gradient)
    try:
        q = -spla.splu(sp.csc_array(K + spin)).solve(gradient)
    except RuntimeError:  # SuperLU: "Factor is exactly singular"
        return None
    return q if np.all(np.isfinite(q)) else None


def prescribed_steps(model: Model) -> int:
    """Steps of prescribed displacements that the tangent predicts well."""
    moved = np.zeros((1, 6)) if model.held is None else model.held.moved
    turn = np.linalg.norm(moved[:, 3:], axis=1).max() / PRESCRIBED_TURN
    shift = np.linalg.norm(moved[:, :3], axis=1).max() / (PRESCRIBED_TURN * article_size(model))
    return 1 + int(max(turn, shift))


def displace(
    model: Model, config: Configuration, loads: Loads, part: float, inner: Inner | None = None
) -> tuple[Configuration, Inner | None]:
    """``config`` after a further ``part`` of what is prescribed; the rest follows by the tangent.

    With the forces inside to first order, None where nothing followed. ``inner`` are those before, where they
    are not the configuration's own: those of a rough state are out of balance, and a tangent with them keeps
    Newton's method from the branch however short a step is.
    """
    since = config.since_drawn
    if model.held is None or since is None or not np.any(model.held.moved):
        return config, None
    moved = part * model.held.moved
    free, pushed = static_freedom(model, config), np.zeros(model.tree.size)
    pushed[: moved.size] = moved.ravel()
    drawn_along = followed(model, config, pushed)
    pushed = pushed + drawn_along
    at = assemble_carried(model, config, loads, None, inner)
    factor = positive_factor(free.matrix(at.tangent))
    turn = turn_of(moved[:, 3:])
    shifted = since.shift + moved[:, :3]
    displaced = placed(
        SinceDrawn(since.drawn, since.carrier, shifted, since.turn + turn + turn @ since.turn), config.angle
    )
    q = None if factor is None else free.spread(-factor.solve(free.part(at.tangent @ pushed)))
    there = move_carried(model.tree, displaced, drawn_along if q is None else drawn_along + q)
    there = closed(model, there)
    if there is None:
        raise torn(model, config, pushed)
    if q is None:
        return there, None
    after, now = (predict_forces(model, config, loads, step, at) for step in (pushed + q, 0.0 * q))
    return there, after if inner is None else Inner(
        *(i + a - n for i, a, n in zip(inner, after, now, strict=True))
    )


def with_linear_springs(model: Model, config: Configuration, loads: Loads, inner: Inner) -> Inner:
    """Springs without free length keep their own forces, as stiff across as along wherever they point."""
    linear = [law.preload == law.stiffness * law.length for law in (own_law(model), loads.law)]
    if not np.any(linear[0]) and not np.any(linear[1]):
        return inner
    own = inner_forces(model, config, loads)
    return inner._replace(
        spring=np.where(linear[0], own.spring, inner.spring),
        device=np.where(linear[1], own.device, inner.device),
    )
