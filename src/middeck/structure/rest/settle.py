"""Newton's method on the potential of a hanging structure, by damped descent under a growing load."""

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.environment_loads import Loads, scale_loads
from middeck.structure.assembly.mass import drawn_mass
from middeck.structure.assembly.mesh import Model
from middeck.structure.rest.damped_descent import descend
from middeck.structure.rest.followed_branch import displace, follow, prescribed_steps
from middeck.structure.rest.forces_as_unknowns import unfold
from middeck.structure.rest.imbalance import imbalance_scale
from middeck.structure.rest.rest_criteria import TOLERANCE, NewtonResult, is_stable

# Residual accepted at intermediate load steps.
ROUGH = 1e-4
LOAD_FACTORS = (0.25, 0.5, 0.75)
# Iterations after which a descent creeps.
SOON = 30


def settle(model: Model, loads: Loads) -> NewtonResult:
    """Equilibrium under gravity and preload: followed from the drawn state, or descended to.

    An article that the world holds, and any under applied loads, is followed from its drawn state as all that
    acts on it grows. One that hangs, and one whose branch ends or is not stable, descends at once or, should
    that fail, by steps of the load.

    The tangent is re-formed at every iteration. Damping (Levenberg 1944: a multiple of the mass) keeps each
    step downhill where the tangent is not positive definite; it is reduced after every success and the last
    step is a pure Newton step. Convergence is on the true residual alone; on the way a rough one will do.
    """
    mass = drawn_mass(model)
    moved = model.held is not None and bool(np.any(model.held.moved))
    pushed = bool(np.any(loads.push))
    held = model.held is not None or pushed or len(loads.ground.point) or not np.any(loads.gravity)
    followed = follow(model, loads, mass) if held else None
    # A moment has no potential to descend, nor a node that is being displaced.
    if followed is not None and (followed.stable or moved or np.any(loads.push[:, 3:])):
        return followed
    if moved:
        steps = prescribed_steps(model)
        return _by_steps(model, loads, mass, tuple((np.arange(1, steps) / steps).tolist()))
    fallen = _descend_by_turns(model, loads, mass)
    return fallen if followed is None or fallen.residual < fallen.enough else followed


def _descend_by_turns(model: Model, loads: Loads, mass: sp.csr_array) -> NewtonResult:
    soon = _by_steps(model, loads, mass, (), SOON)
    if soon.residual < soon.enough:
        return soon
    mixed = unfold(model, loads, mass)
    if mixed is not None:
        return mixed
    at_once = _by_steps(model, loads, mass, ())
    return at_once if at_once.residual < at_once.enough else _by_steps(model, loads, mass, LOAD_FACTORS)


def _by_steps(
    model: Model, loads: Loads, mass: sp.csr_array, factors: tuple[float, ...], most: int | None = None
) -> NewtonResult:
    scale = imbalance_scale(model, loads)
    config, before = model.rest, 0.0
    history: list[tuple[float, float, float]] = []
    for factor in factors:
        load = scale_loads(loads, factor)
        (config, _), before = displace(model, config, load, factor - before), factor
        config, _, steps, _ = descend(model, config, load, mass, scale, ROUGH)
        history += [(factor, residual, damping) for residual, damping in steps]
    config, _ = displace(model, config, loads, 1.0 - before)
    config, at, steps, enough = descend(model, config, loads, mass, scale, TOLERANCE, most)
    history += [(1.0, residual, damping) for residual, damping in steps]
    residual = history[-1][1]
    # Short of convergence stability is unknown: second-order strain of a step may act as tension.
    stable = residual < enough and is_stable(model, config, at, loads)
    return NewtonResult(
        config=config, assembly=at, residual=residual, enough=enough, history=tuple(history), stable=stable
    )
