"""Newton's method with the internal forces as unknowns, damped where something grows."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.energy import assemble_carried
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.factorisation import factorise, positive_factor
from middeck.structure.assembly.linked import closed, static_freedom
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.strain import predict_forces
from middeck.structure.elements.frames import move_carried
from middeck.structure.rest.followed_branch import with_linear_springs
from middeck.structure.rest.imbalance import article_size, imbalance, imbalance_scale
from middeck.structure.rest.rest_criteria import (
    DAMPING_STEP,
    LEAST_DAMPING,
    LONGEST_STEP,
    MOST_DAMPING,
    ROUNDED,
    TOLERANCE,
    NewtonResult,
)
from middeck.structure.rest.rigid_and_deforming_steps import stride, unmoved

MIXED_ITERATIONS = 100
# Damping that is taken, over the least one that stops all growth; and how closely that one is found.
AHEAD, NEAR = 1.5, 1.3
# Deviation from a line, over the article's size, that is left as it is at an unstable rest state.
IN_LINE = 1e-9


def unfold(model: Model, loads: Loads, mass: sp.csr_array) -> NewtonResult | None:
    """Newton's method with the internal forces as unknowns; None where it does not converge.

    Stiff members resist the second-order terms of a step: a strut of 1e12 N/m that a turn of 0.1 strains by
    1e-3 m pulls with 1e9 N, so that a descent must take tiny steps. As an unknown, the force follows the
    step's first order, and only that enters the geometric stiffness (Magisano, Leonetti and Garcea 2017,
    Comput. Methods Appl. Mech. Eng. 313). Where a motion grows the step is damped, so that it leaves an
    unstable rest state; an article upright to rounding ends in that state, which is marked as unstable.
    """
    scale = imbalance_scale(model, loads)
    config, inner, damping, size_of = model.rest, None, 0.0, article_size(model)
    history: list[tuple[float, float, float]] = []
    for _ in range(MIXED_ITERATIONS):
        free = static_freedom(model, config)
        least = LEAST_DAMPING * free.matrix(mass)
        at = assemble_carried(model, config, loads, None, inner)
        residual = imbalance(at, free, scale)
        history.append((1.0, residual, damping))
        if not np.isfinite(residual):
            return None
        step = _unfolding_step(free.matrix(at.tangent), least, free.part(at.gradient), damping, size_of)
        if step is None:
            return None
        q, damping, upright = step
        q = free.spread(q)
        size = stride(model, q)
        enough = ROUNDED if size < unmoved(model, config) and (upright or damping == 0.0) else TOLERANCE
        if residual < enough and (upright or damping == 0.0):
            at = assemble_carried(model, config, loads)
            stable = positive_factor(sp.csr_array(free.matrix(at.tangent) + least)) is not None
            return NewtonResult(
                config=config,
                assembly=at,
                residual=residual,
                enough=enough,
                history=tuple(history),
                stable=stable,
            )
        q = q * min(1.0, LONGEST_STEP / max(size, LONGEST_STEP))
        inner = predict_forces(model, config, loads, q, at)
        moved = closed(model, move_carried(model.tree, config, q))
        if moved is None:
            return None
        config = moved
        inner = with_linear_springs(model, config, loads, inner)
    return None


class _Step(NamedTuple):
    """A step, its damping, and whether it leads to a rest state that is not stable."""

    q: np.ndarray
    damping: float
    upright: bool = False


def _unfolding_step(
    K: sp.csr_array, least: sp.csr_array, gradient: np.ndarray, damping: float, size: float
) -> _Step | None:
    """Newton's step or, where something grows, one with little more damping than makes K positive definite.

    Damping of `AHEAD` times the rate squared at which something grows lets it grow by 1 + 1/(`AHEAD` - 1)
    in a step: a column a millionth out of line is well bent after ten. What is in line to rounding stays.
    """
    factor = positive_factor(K) or positive_factor(sp.csr_array(K + least))
    if factor is not None:
        return _Step(-factor.solve(gradient), 0.0)
    newton = factorise(K)
    if newton is not None:
        q = -newton.solve(gradient)
        if np.abs(q).max() < IN_LINE * size:
            return _Step(q, damping, upright=True)
    low, high = LEAST_DAMPING, max(damping / AHEAD, 2.0 * LEAST_DAMPING)
    while positive_factor(_damped(K, least, high)) is None:
        low, high = high, DAMPING_STEP * high
        if high > MOST_DAMPING:
            return None
    while high > NEAR * low:
        middle = np.sqrt(low * high)
        if positive_factor(_damped(K, least, middle)) is None:
            low = middle
        else:
            high = middle
    factor = positive_factor(_damped(K, least, AHEAD * high))
    return factor and _Step(-factor.solve(gradient), AHEAD * high)


def _damped(K: sp.csr_array, least: sp.csr_array, damping: float) -> sp.csr_array:
    return sp.csr_array(K + damping / LEAST_DAMPING * least)
