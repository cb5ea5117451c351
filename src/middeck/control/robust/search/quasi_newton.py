"""Quasi-Newton descent of a function that is infinite outside its domain.

BFGS with a weak Wolfe line search by doubling and bisection (Lewis and Overton 2013, Math. Programming 141,
algorithm 2.6): a trial outside the domain is only a step that was too long.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from middeck.values import record

Objective = Callable[[np.ndarray], tuple[float, np.ndarray]]
DECREASE, CURVATURE = 1e-4, 0.9
TRIALS = 50
PATIENCE = 10
"""Steps over which the decrease is watched, where a rough end will do."""


@record(kw_only=True)
class Descent:
    """End of a descent.

    Attributes:
        gradient: Norm of the gradient over the value, in the coordinates given.
        values: The function after each step.
    """

    x: Float[np.ndarray, " parameter"]
    value: float
    gradient: float
    values: tuple[float, ...]


def descend(
    objective: Objective,
    x: Float[np.ndarray, " parameter"],
    *,
    tolerance: float,
    steps: int = 2000,
    patience: int = PATIENCE,
) -> Descent:
    """Descend until ``patience`` steps gain less than ``tolerance`` of the value, or the line search finds
    nothing lower.

    BFGS knows the curvature of n parameters after n steps: near a saddle ten of them may gain next to
    nothing, and last digits decide which ten. ``x`` must lie in the domain; an infinite value there is
    returned unchanged.
    """
    value, gradient = objective(x)
    values = [value]
    inverse: np.ndarray | None = None
    for _ in range(steps if np.isfinite(value) else 0):
        direction = _direction(inverse, gradient)
        found = _search(objective, x, value, gradient, direction)
        if not found[1] < value:
            break
        step, change = found[0] - x, found[2] - gradient
        x, value, gradient = found
        inverse = _updated(inverse, step, change)
        values.append(value)
        if len(values) > patience and values[-1 - patience] - value < tolerance * abs(value):
            break
    relative = float(np.linalg.norm(gradient) / abs(value)) if np.isfinite(value) and value else np.inf
    return Descent(x=x, value=value, gradient=relative, values=tuple(values))


def _direction(inverse: np.ndarray | None, gradient: np.ndarray) -> np.ndarray:
    if inverse is None:  # a first step of a tenth in coordinates of unit size
        return -gradient * (0.1 / max(float(np.linalg.norm(gradient)), 1e-300))
    direction = -(inverse @ gradient)
    return direction if direction @ gradient < 0.0 else -gradient


def _search(
    objective: Objective, x: np.ndarray, value: float, gradient: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    slope = float(gradient @ direction)
    low, high, step = 0.0, np.inf, 1.0
    best = x, value, gradient
    for _ in range(TRIALS):
        trial = x + step * direction
        now, there = objective(trial)
        if not now <= value + DECREASE * step * slope:
            high = step
        else:
            best = trial, now, there
            if there @ direction >= CURVATURE * slope:
                return best
            low = step
        step = (low + high) / 2.0 if np.isfinite(high) else 2.0 * low
    return best


def _updated(inverse: np.ndarray | None, step: np.ndarray, change: np.ndarray) -> np.ndarray | None:
    """The BFGS update of the inverse Hessian; it starts at the size of the first curvature."""
    curvature = float(step @ change)
    if curvature <= 0.0:
        return inverse
    if inverse is None:
        inverse = np.eye(len(step)) * (curvature / float(change @ change))
    product = inverse @ change
    both = np.outer(product, step)
    return inverse + (
        np.outer(step, step) * ((curvature + float(change @ product)) / curvature**2)
        - (both + both.T) / curvature
    )
