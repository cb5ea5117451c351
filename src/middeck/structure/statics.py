"""Newton's method on the potential of a hanging structure, by damped descent under a growing load."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from middeck.errors import NumericalError
from middeck.structure.article import JointState
from middeck.structure.assembly import Assembly, Loads, assemble, mass_matrix
from middeck.structure.elements.devices import SpringLaw
from middeck.structure.elements.frames import Configuration, move_whole, split_rigid
from middeck.structure.factorisation import positive_factor
from middeck.structure.mesh import Model

# Largest residual that counts as rest, over `load_scale`.
TOLERANCE = 1e-9
# Enough on the way to full load.
ROUGH = 1e-4
LOAD_FACTORS = (0.25, 0.5, 0.75)
MAX_ITERATIONS = 200
MAX_HALVINGS = 30
STANDARD_GRAVITY = 9.80665
# Least damping [1/s^2]: a thousandth of a slow pendulum's omega^2 neither holds nor hurries anything.
LEAST_DAMPING = 1e-3
DAMPING_STEP = 4.0
# Beyond any omega^2 of a structure: what is still indefinite has no mass.
MOST_DAMPING = 1e20
# Largest turn [rad] and largest change [m or rad] of a coordinate beside the rigid motion in one step: what
# the second-order chart follows well. A translation of the whole may be of any length.
LONGEST_STEP = 0.5


class Settled(NamedTuple):
    """Where Newton ended, and (load factor, residual, damping) of every iteration on the way."""

    config: Configuration
    assembly: Assembly
    residual: float
    history: tuple[tuple[float, float, float], ...]


def static_coordinates(model: Model) -> Bool[np.ndarray, " coordinate"]:
    """Coordinates that move in statics: roots and sprung joints; other joints are held."""
    return _moving(model, (JointState.SPRUNG,))


def dynamic_coordinates(model: Model) -> Bool[np.ndarray, " coordinate"]:
    """Coordinates that move in dynamics: roots, free and sprung joints."""
    return _moving(model, (JointState.FREE, JointState.SPRUNG))


def _moving(model: Model, states: tuple[JointState, ...]) -> np.ndarray:
    joints = [joint.state in states for joint in model.structure.joints]
    return np.concatenate([np.ones(6 * model.tree.roots, dtype=bool), np.array(joints, dtype=bool)])


def settle(model: Model, loads: Loads) -> Settled:
    """Equilibrium under gravity and preload at once or, should that fail, by steps of the load.

    The tangent is re-formed at every iteration. Damping (Levenberg 1944: a multiple of the mass) keeps each
    step a descent of the potential where the tangent is not positive definite; it is reduced after every
    success and the last step is a pure Newton step. Convergence is on the true residual alone; on the way
    there a rough one will do.
    """
    mass = mass_matrix(model, model.rest)
    at_once = _by_steps(model, loads, mass, ())
    return at_once if at_once.residual < TOLERANCE else _by_steps(model, loads, mass, LOAD_FACTORS)


def _by_steps(model: Model, loads: Loads, mass: sp.csr_array, factors: tuple[float, ...]) -> Settled:
    scale = load_scale(model, loads)
    config = model.rest
    history: list[tuple[float, float, float]] = []
    for factor in factors:
        config, _, steps = _descend(model, config, scale_loads(loads, factor), mass, ROUGH * scale)
        history += [(factor, residual / scale, damping) for residual, damping in steps]
    config, at, steps = _descend(model, config, loads, mass, TOLERANCE * scale)
    history += [(1.0, residual / scale, damping) for residual, damping in steps]
    return Settled(config, at, history[-1][1], tuple(history))


def scale_loads(loads: Loads, factor: float) -> Loads:
    """Gravity and preloads times ``factor``; stiffnesses as they are."""
    law = SpringLaw(loads.law.preload * factor, loads.law.stiffness, loads.law.length)
    return Loads(loads.gravity * factor, loads.anchor, loads.attach_point, law, loads.mass)


def load_scale(model: Model, loads: Loads) -> float:
    """What a residual is compared with [N].

    The weight (in orbit that on the ground), the largest preload, or, where that is more, the force that the
    rounding of positions makes in the stiffest part: a stiffness of 1e7 N/m at 1 m rounds to 1e-9 N.
    """
    weight = model.structure.mass * max(float(np.linalg.norm(loads.gravity)), STANDARD_GRAVITY)
    preload = float(np.abs(loads.law.preload).max(initial=0.0))
    beams = model.beams
    stiffness = (
        beams.EA / beams.length,
        12.0 * np.maximum(beams.EI_y, beams.EI_z) / beams.length**3,
        loads.law.stiffness,
        np.array([spring.stiffness for spring in model.structure.springs]),
    )
    stiffest = max(float(k.max(initial=0.0)) for k in stiffness)
    farthest = max(float(np.abs(x).max(initial=0.0)) for x in (model.rest.x, loads.anchor))
    rounding = 4.0 * np.finfo(float).eps * stiffest * farthest
    return max(weight, preload, rounding / TOLERANCE)


def _descend(
    model: Model, config: Configuration, loads: Loads, mass: sp.csr_array, enough: float
) -> tuple[Configuration, Assembly, list[tuple[float, float]]]:
    """Where the descent ends, and (residual [N], damping) of every iteration; ``mass`` need not be exact."""
    active = static_coordinates(model)
    at = assemble(model, config, loads)
    damping = 0.0
    history: list[tuple[float, float]] = []
    for _ in range(MAX_ITERATIONS):
        residual = unbalanced(at, active)
        history.append((residual, damping))
        if residual < enough:
            break
        q, damping = _damped_step(model, config, at, mass, damping)
        better = _shorten(model, config, loads, at, q, mass)
        if better is None:
            break
        config, at = better
    return config, at, history


def unbalanced(at: Assembly, active: np.ndarray) -> float:
    """Largest force [N] or moment [N m] that is left at the coordinates that move in statics."""
    return float(np.abs(at.gradient[active]).max(initial=0.0))


def _shorten(
    model: Model, config: Configuration, loads: Loads, at: Assembly, q: np.ndarray, mass: sp.csr_array
) -> tuple[Configuration, Assembly] | None:
    """The first of q, q/2, q/4 ... that lowers the energy or the residual; None at rounding level."""
    active = static_coordinates(model)
    for _ in range(MAX_HALVINGS):
        trial = move_whole(model.tree, config, q, mass)
        new = assemble(model, trial, loads)
        if new.energy < at.energy or unbalanced(new, active) < unbalanced(at, active):
            return trial, new
        q = 0.5 * q
    return None


def _damped_step(
    model: Model, config: Configuration, at: Assembly, mass: sp.csr_array, damping: float
) -> tuple[np.ndarray, float]:
    """Solve (K + damping M) q = -gradient with the least damping that makes the matrix positive definite."""
    active = static_coordinates(model)
    stiffness, inertia = restrict(at.tangent, active), restrict(mass, active)
    damping = 0.0 if damping < LEAST_DAMPING else damping / DAMPING_STEP
    while damping < MOST_DAMPING:
        factor = positive_factor(sp.csr_array(stiffness + damping * inertia))
        if factor is not None:
            q = spread(-factor.solve(at.gradient[active]), active)
            rigid, rest = split_rigid(model.tree, config, q, mass)
            if max(np.abs(rigid[3:]).max(), np.abs(rest).max()) < LONGEST_STEP:
                return q, damping
        damping = max(DAMPING_STEP * damping, LEAST_DAMPING)
    raise NumericalError(
        "no step towards rest: the tangent stays indefinite however much it is damped",
        where=f"structure {model.structure.title!r}",
        hint="a motion without mass that something pushes over? give its frame a mass and an inertia",
    )


def restrict(K: sp.csr_array, active: Bool[np.ndarray, " coordinate"]) -> sp.csr_array:
    """Rows and columns of the coordinates that move; the matrix itself where all do."""
    return K if bool(np.all(active)) else sp.csr_array(K[active][:, active])


def spread(q: Float[np.ndarray, " active"], active: Bool[np.ndarray, " coordinate"]) -> np.ndarray:
    """The increment of all coordinates, zero where they are held."""
    full = np.zeros(len(active))
    full[active] = q
    return full
