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

from middeck.identification.terms import Layout, columns, fractions, slopes, unpack
from middeck.values import record

# The cost of a step that cannot be evaluated (coinciding poles, overflow); the solver then shortens it.
REJECTED = np.inf
MOST_STEPS = 200
# A step that promises less than this share of the cost ends the search: 1e-10 of the cost moves each
# unknown by about 1e-5 of its own standard deviation when the residual is noise.
SMALLEST_GAIN = 1e-10


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
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        point = unpack(layout, theta)
        parts = fractions(layout, point.poles, data.s)
        X0 = columns(layout, point, parts)
    if not np.isfinite(X0).all():
        return None
    cost, found = 0.0, []
    gradient, gram = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    for o in range(layout.outputs):
        late = (np.exp(-data.s * point.delay_s[o])[:, None] * data.weight[o])[None]
        Q, R = scipy.linalg.qr(_real(X0 * late).T, mode="economic", check_finite=False)
        if np.abs(np.diag(R)).min() <= 1e-13 * np.abs(np.diag(R)).max():
            return None
        target = _real((data.weight[o] * data.H[o])[None])[0]
        on_columns = Q.T @ target
        x = scipy.linalg.solve_triangular(R, on_columns)
        residual = target - Q @ on_columns
        G = slopes(layout, point, parts, x, o) * late
        if layout.with_delay:
            G = np.concatenate([G, _by_delay(layout, o, data.s, x, X0 * late)])
        J = _real(G)
        projected = J @ Q
        cost += 0.5 * float(residual @ residual)
        gradient -= J @ residual
        gram += J @ J.T - projected @ projected.T
        found.append(x)
    if not np.isfinite(cost):
        return None
    return Step(cost, gradient, gram, np.array(found).reshape(layout.outputs, layout.columns))


def logarithmic(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Step | None:
    """Half the sum of |weight log(H / E)|^2: log magnitude and phase; theta ends in the linear unknowns."""
    linear = theta[len(theta) - layout.outputs * layout.columns :].reshape(layout.outputs, layout.columns)
    shared = len(theta) - linear.size
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        point = unpack(layout, theta[:shared])
        parts = fractions(layout, point.poles, data.s)
        X0 = columns(layout, point, parts)
    cost, gradient, gram = 0.0, np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    for o in range(layout.outputs):
        X = X0 * np.exp(-data.s * point.delay_s[o])[None, :, None]
        E = np.tensordot(linear[o], X, axes=1)
        if not np.isfinite(E).all() or not E.all():
            return None
        G = slopes(layout, point, parts, linear[o], o) * np.exp(-data.s * point.delay_s[o])[None, :, None]
        if layout.with_delay:
            G = np.concatenate([G, _by_delay(layout, o, data.s, linear[o], X)])
        J = _real(np.concatenate([G, X]) * (data.weight[o] / E)[None])
        residual = _real((data.weight[o] * np.log(data.H[o] / E))[None])[0]
        own = np.r_[0:shared, shared + o * layout.columns : shared + (o + 1) * layout.columns]
        cost += 0.5 * float(residual @ residual)
        gradient[own] -= J @ residual
        gram[np.ix_(own, own)] += J @ J.T
    return Step(cost, gradient, gram, linear) if np.isfinite(cost) else None


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
        move = _solve(step.gram + damping * np.diag(scale), -step.gradient)
        promised = float(-move @ step.gradient - 0.5 * move @ step.gram @ move)
        if promised <= SMALLEST_GAIN * step.cost:
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


def _by_delay(layout: Layout, output: int, s: np.ndarray, x: np.ndarray, X: np.ndarray) -> np.ndarray:
    G = np.zeros((layout.outputs, *X.shape[1:]), dtype=complex)
    G[output] = -s[:, None] * np.tensordot(x, X, axes=1)
    return G


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
    X = columns(layout, point, fractions(layout, point.poles, data.s))
    late = np.exp(-data.s * point.delay_s[:, None])[:, :, None]
    return data.H - np.tensordot(linear, X, axes=1) * late
