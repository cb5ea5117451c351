"""Nonlinear least squares on a frequency response, by Levenberg-Marquardt with analytic derivatives.

Least squares (`weighted`): the output vectors and the direct term are linear, so they are solved for
exactly at each step and only theta is searched (variable projection, Golub and Pereyra 1973, with
Kaufman's (1975) derivative). The outputs share nothing but theta, so each is a small problem of its own.

Logarithmic (`logarithmic`): log magnitude and phase, the cost of the paper's fit; nothing is linear then and
all unknowns are searched together.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.identification.terms import Fractions, Layout, Point, columns, fractions, slopes, unpack
from middeck.values import record

# Linear unknowns are not solved for where one column is the rest up to this share: coinciding poles.
COINCIDENT = 1e-13
MOST_STEPS = 200
# A step that promises less ends the search. Weights are one over standard deviations, so that an unknown one
# deviation off costs 1/2 or more: 1e-3 is a twentieth of a deviation, for all unknowns together.
SMALLEST_GAIN = 1e-3


@record
class Data:
    """What is fitted: response and weights at s = j omega (weight = 1 / standard deviation)."""

    s: Complex[np.ndarray, " line"]
    H: Complex[np.ndarray, "output line input"]
    weight: Float[np.ndarray, "output line input"]


@record
class Step:
    """Cost, normal equations and linear unknowns at a theta."""

    cost: float
    gradient: Float[np.ndarray, " unknown"]
    gram: Float[np.ndarray, "unknown unknown"]
    linear: Float[np.ndarray, "output column"]


@record
class Refined:
    """End of a search: unknowns, the last normal equations and the cost of each accepted step."""

    theta: Float[np.ndarray, " unknown"]
    step: Step
    history: tuple[float, ...]
    converged: bool


def weighted(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Step | None:
    """Half the sum of |weight (H - E)|^2, the linear unknowns solved for; None where it has no value."""
    point, parts, X = _terms(layout, data, theta)
    if not np.isfinite(X).all():
        return None
    cost, found = 0.0, np.zeros((layout.outputs, layout.columns))
    gradient, gram = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    for o in range(layout.outputs):
        late = (np.exp(-data.s * point.delay_s[o])[:, None] * data.weight[o])[None]
        Q, R = np.linalg.qr(_real(X * late).T)
        if np.abs(np.diag(R)).min() <= COINCIDENT * np.abs(np.diag(R)).max():
            return None
        target = _real((data.weight[o] * data.H[o])[None])[0]
        on_columns = Q.T @ target
        found[o] = scipy.linalg.solve_triangular(R, on_columns)
        residual = target - Q @ on_columns
        G = _real(_slopes_late(layout, data, point, parts, found[o], X, late, o))
        J = G - (G @ Q) @ Q.T
        cost += 0.5 * float(residual @ residual)
        gradient -= J @ residual
        gram += J @ J.T
    return Step(cost, gradient, gram, found) if np.isfinite(cost) else None


def logarithmic(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Step | None:
    """Half the sum of |weight log(H / E)|^2: log magnitude and phase; theta ends in the linear unknowns."""
    linear = theta[len(theta) - layout.outputs * layout.columns :].reshape(layout.outputs, layout.columns)
    shared = len(theta) - linear.size
    point, parts, X = _terms(layout, data, theta[:shared])
    cost, gradient, gram = 0.0, np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    for o in range(layout.outputs):
        late = np.exp(-data.s * point.delay_s[o])[None, :, None]
        E = np.tensordot(linear[o], X * late, axes=1)
        if not np.isfinite(E).all() or not E.all():
            return None
        G = _slopes_late(layout, data, point, parts, linear[o], X, late, o)
        J = _real(np.concatenate([G, X * late]) * (data.weight[o] / E)[None])
        residual = _real((data.weight[o] * np.log(data.H[o] / E))[None])[0]
        own = np.r_[0:shared, shared + o * layout.columns : shared + (o + 1) * layout.columns]
        cost += 0.5 * float(residual @ residual)
        gradient[own] -= J @ residual
        gram[np.ix_(own, own)] += J @ J.T
    return Step(cost, gradient, gram, linear) if np.isfinite(cost) else None


def _terms(layout: Layout, data: Data, theta: np.ndarray) -> tuple[Point, Fractions, np.ndarray]:
    # A trial step may overflow: what it gives is then not finite, and the step is refused.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        point = unpack(layout, theta)
        parts = fractions(layout, point.poles, data.s)
        return point, parts, columns(layout, point, parts, data.s)


def _slopes_late(
    layout: Layout,
    data: Data,
    point: Point,
    parts: Fractions,
    linear: np.ndarray,
    X: np.ndarray,
    late: np.ndarray,
    output: int,
) -> Complex[np.ndarray, "unknown line input"]:
    """Slopes by theta of one output's response times ``late``, delays included."""
    G = slopes(layout, point, parts, linear) * late
    if not layout.with_delay:
        return G
    by_delay = np.zeros((layout.outputs, *G.shape[1:]), dtype=complex)
    by_delay[output] = -data.s[:, None] * np.tensordot(linear, X * late, axes=1)
    return np.concatenate([G, by_delay])


def search(
    evaluate: Callable[[np.ndarray], Step | None],
    theta: Float[np.ndarray, " unknown"],
    most_steps: int = MOST_STEPS,
) -> Refined | None:
    """Levenberg-Marquardt with Marquardt's scaling and Nielsen's (1999) damping; None if it cannot start."""
    step = evaluate(theta)
    if step is None:
        return None
    damping, growth = 1e-3, 2.0
    history = [step.cost]
    for _ in range(most_steps):
        scale = np.maximum(np.diag(step.gram), 1e-14 * np.diag(step.gram).max())
        try:
            move = _solve(step.gram + damping * np.diag(scale), -step.gradient)
        except np.linalg.LinAlgError:  # two modes have met; more damping tells them apart
            damping, growth = damping * growth, 2.0 * growth
            continue
        promised = float(-move @ step.gradient - 0.5 * move @ step.gram @ move)
        if promised <= SMALLEST_GAIN:
            return Refined(theta, step, tuple(history), True)
        trial = evaluate(theta + move)
        gain = -1.0 if trial is None else (step.cost - trial.cost) / promised
        if trial is not None and gain > 0.0:
            theta, step = theta + move, trial
            history.append(step.cost)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            growth = 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
    return Refined(theta, step, tuple(history), False)


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    # Scaled to a unit diagonal: frequencies, shapes and delays differ by many orders.
    size = 1.0 / np.sqrt(np.diag(matrix))
    return size * np.linalg.solve(matrix * size[:, None] * size, size * right)


def _real(G: Complex[np.ndarray, "row line input"]) -> Float[np.ndarray, "row number"]:
    """Real and imaginary parts side by side, without a copy."""
    return np.ascontiguousarray(G).reshape(len(G), -1).view(float)


def residual_of(
    layout: Layout,
    data: Data,
    theta: Float[np.ndarray, " unknown"],
    linear: Float[np.ndarray, "output column"],
) -> Complex[np.ndarray, "output line input"]:
    """H - E, unweighted."""
    point = unpack(layout, theta)
    X = columns(layout, point, fractions(layout, point.poles, data.s), data.s)
    late = np.exp(-data.s * point.delay_s[:, None])[:, :, None]
    return data.H - np.tensordot(linear, X, axes=1) * late
