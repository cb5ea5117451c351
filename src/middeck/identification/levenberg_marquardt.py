"""Nonlinear least squares by Levenberg-Marquardt, for any cost that gives its normal equations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import lapack

from middeck.values import record

MOST_STEPS = 200
# A step that promises less ends the search. Weights are one over standard deviations, so that an unknown one
# deviation off costs 1/2 or more: 1e-3 is a twentieth of a deviation, for all unknowns together.
SMALLEST_GAIN = 1e-3
# Most that an eigenvalue of theta's Gram matrix, scaled to a unit diagonal, may round below zero. The data
# say nothing of so weak a direction: its deviation is ten thousand times that of unknowns that go alone.
WEAKEST = 1e-8
# First damping, and its first growth.
DAMPING, GROWTH = 1e-3, 2.0


@record(kw_only=True)
class Step:
    """Cost, normal equations and linear unknowns (the transients' last) at a theta; H - E if at hand."""

    cost: float
    gradient: Float[np.ndarray, " unknown"]
    gram: Float[np.ndarray, "unknown unknown"]
    linear: Float[np.ndarray, "output column"]
    residual: Complex[np.ndarray, "output line experiment"] | None = None


@record
class LeastSquaresResult:
    """End of a search: unknowns, the last normal equations and the cost of each accepted step."""

    theta: Float[np.ndarray, " unknown"]
    step: Step
    history: tuple[float, ...]
    converged: bool


def is_positive(gram: Float[np.ndarray, "unknown unknown"]) -> bool:
    """Whether the matrix is positive definite up to rounding."""
    if not np.isfinite(gram).all():
        return False
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    try:
        np.linalg.cholesky(gram / size[:, None] / size + WEAKEST * np.eye(len(gram)))
    except np.linalg.LinAlgError:
        return False
    return True


def search(
    evaluate: Callable[[np.ndarray, float], Step | None],
    theta: Float[np.ndarray, " unknown"],
    most_steps: int = MOST_STEPS,
    *,
    exactly: Callable[[np.ndarray, float], Step | None] | None = None,
) -> LeastSquaresResult | None:
    """Levenberg-Marquardt with Marquardt's scaling and Nielsen's (1999) damping; None if it cannot start.

    ``evaluate`` may give None too for a cost that is not below its second argument.

    Rounding of a Gram matrix may promise little, or nothing, where there is much to gain. Before a search
    ends, theta is evaluated again ``exactly``; and what a matrix promises that has lost its sign is no end.
    """
    step = evaluate(theta, np.inf)
    if step is None:
        return None
    damping, growth, again = DAMPING, GROWTH, exactly
    history = [step.cost]
    for _ in range(most_steps):
        scale = np.maximum(np.diag(step.gram), 1e-14 * np.diag(step.gram).max())
        move = _move(step.gram + damping * np.diag(scale), -step.gradient)
        promised = -1.0 if move is None else float(-move @ step.gradient - 0.5 * move @ step.gram @ move)
        if not promised > SMALLEST_GAIN:
            if again is not None:
                step, again = again(theta, np.inf) or step, None
                damping, growth = min(damping, DAMPING), GROWTH
                continue
            if promised >= 0.0:
                return LeastSquaresResult(theta, step, tuple(history), is_positive(step.gram))
        trial = evaluate(theta + move, step.cost) if move is not None and promised > 0.0 else None
        gain = -1.0 if trial is None else (step.cost - trial.cost) / promised
        if trial is not None and gain > 0.0:
            theta, step, again = theta + move, trial, exactly
            history.append(step.cost)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            growth = GROWTH
        else:
            damping, growth = damping * growth, 2.0 * growth
    return LeastSquaresResult(theta, step, tuple(history), False)


def _move(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """The step; None where the matrix is not positive definite, so that a step would not lead downhill."""
    # Scaled to a unit diagonal: frequencies, shapes and delays differ by many orders.
    square = np.diag(matrix)
    if not (np.isfinite(matrix).all() and (square > 0.0).all()):
        return None
    size = 1.0 / np.sqrt(square)
    factor, failed = cast("Any", lapack).dpotrf(matrix * size[:, None] * size, clean=False)
    return None if failed else size * cast("Any", lapack).dpotrs(factor, size * right)[0]
