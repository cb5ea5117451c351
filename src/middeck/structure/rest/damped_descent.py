"""Damped descent of the potential energy, by steps that lower it."""

import numpy as np
import scipy.sparse as sp

from middeck.errors import NumericalError
from middeck.structure.assembly.energy import Assembly, assemble_carried
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.factorisation import positive_factor
from middeck.structure.assembly.linked import closed, static_freedom
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration
from middeck.structure.rest.imbalance import imbalance
from middeck.structure.rest.rest_criteria import (
    DAMPING_STEP,
    LEAST_DAMPING,
    LONGEST_STEP,
    MOST_DAMPING,
    ROUNDED,
)
from middeck.structure.rest.rigid_and_deforming_steps import deformation, move_whole, stride, unmoved

MAX_ITERATIONS = 200
MAX_HALVINGS = 30
# Halvings of a step after which, twice, a descent creeps.
SHORT = 3


def descend(
    model: Model,
    config: Configuration,
    loads: Loads,
    mass: sp.csr_array,
    scale: np.ndarray,
    enough: float,
    most: int | None = None,
) -> tuple[Configuration, Assembly, list[tuple[float, float]], float]:
    """End of the descent, (residual, damping) of every iteration, and the residual that counts as rest.

    ``mass`` need not be exact. A descent of at ``most`` so many iterations ends where it begins to creep.
    """
    at = assemble_carried(model, config, loads)
    damping, crept = 0.0, 0
    history: list[tuple[float, float]] = []
    for _ in range(MAX_ITERATIONS if most is None else min(most, MAX_ITERATIONS)):
        residual = imbalance(at, static_freedom(model, config), scale)
        history.append((residual, damping))
        if residual < enough:
            break
        q, damping = _damped_step(model, config, at, mass, damping)
        better = _shorten(model, loads, mass, config, q, scale=scale, energy=at.energy, residual=residual)
        if better is None:
            if damping == 0.0 and stride(model, q) < unmoved(model, config):
                enough = max(enough, ROUNDED)
            break
        config, at, halvings = better
        crept += halvings >= SHORT
        if most is not None and crept > 1:
            break
    return config, at, history, enough


def _shorten(
    model: Model,
    loads: Loads,
    mass: sp.csr_array,
    config: Configuration,
    q: np.ndarray,
    *,
    scale: np.ndarray,
    energy: float,
    residual: float,
) -> tuple[Configuration, Assembly, int] | None:
    """The first of q, q/2, q/4 ... below ``energy`` or ``residual``, and the halvings. None at rounding
    level."""
    for halvings in range(MAX_HALVINGS):
        trial = closed(model, move_whole(model, config, q, mass))
        if trial is not None:
            new = assemble_carried(model, trial, loads)
            if new.energy < energy or imbalance(new, static_freedom(model, trial), scale) < residual:
                return trial, new, halvings
        q = 0.5 * q
    return None


def _damped_step(
    model: Model, config: Configuration, at: Assembly, mass: sp.csr_array, damping: float
) -> tuple[np.ndarray, float]:
    """Solve (K + damping M) q = -gradient with the least damping that makes the matrix positive definite."""
    free = static_freedom(model, config)
    stiffness, inertia = free.matrix(at.tangent), free.matrix(mass)
    damping = 0.0 if damping < LEAST_DAMPING else damping / DAMPING_STEP
    while damping < MOST_DAMPING:
        damped = stiffness if damping == 0.0 else sp.csr_array(stiffness + damping * inertia)
        factor = positive_factor(damped)
        if factor is not None:
            q = free.spread(-factor.solve(free.part(at.gradient)))
            if deformation(model, config, q, mass) < LONGEST_STEP:
                return q, damping
        damping = max(DAMPING_STEP * damping, LEAST_DAMPING)
    raise NumericalError(
        "no step towards equilibrium: the tangent stays indefinite at any damping",
        where=f"structure {model.structure.title!r}",
        hint="a load beyond buckling? apply less of it; a motion without mass that something pushes over? "
        "give its frame a mass and an inertia",
    )
