"""The costs of several models made one: their mean, or a smooth maximum with its dual weights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.robust.closed_cost import Law, LawCost, evaluate_cost
from middeck.control.robust.descent import Descent, descend
from middeck.control.robust.design_model import DesignModel
from middeck.control.robust.structure import Free, arrange, pack, scale_states, unpack

Stations = list[tuple[list[int], list[int], int]]


def blend(costs: Float[np.ndarray, " model"], power: float) -> tuple[float, Float[np.ndarray, " model"]]:
    """(mean J^p)^(1/p) and its derivative by each J: the mean for p = 1, the maximum as p grows.

    The maximum J lies between it and N^(1/p) times it. The derivatives are the weights of a mean whose
    minimum is the same law: of a minimax design the dual weights.

    >>> blend(np.array([1.0, 3.0]), 1.0)[0]
    2.0
    """
    largest = float(costs.max())
    value = largest * float(np.mean((costs / largest) ** power)) ** (1.0 / power)
    return value, (costs / value) ** (power - 1.0) / len(costs)


def evaluate_models(models: Sequence[DesignModel], law: Law) -> list[LawCost] | None:
    """Cost and gradient of each; None as soon as one is unstable."""
    found: list[LawCost] = []
    for model in models:
        cost = evaluate_cost(model, law)
        if not np.isfinite(cost.cost):
            return None
        found.append(cost)
    return found


def improve(
    law: Law,
    models: Sequence[DesignModel],
    stations: Stations,
    *,
    power: float,
    tolerance: float,
    steps: int = 2000,
) -> tuple[Law, Descent] | None:
    """Descend from ``law``, its coordinates evened out first; None where it does not stabilise all models."""
    arranged, free = arrange(law, stations)
    start = evaluate_models(models, arranged)
    if start is None:
        return None
    even = scale_states(arranged, _even_scale(start))
    scale = _parameter_scale(even, free, start, _even_scale(start), models)

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        return _blended(models, unpack(x * scale, even, free), free, power, scale)

    descent = descend(objective, pack(even, free) / scale, tolerance=tolerance, steps=steps)
    return unpack(descent.x * scale, even, free), descent


def _blended(
    models: Sequence[DesignModel], law: Law, free: Free, power: float, scale: np.ndarray
) -> tuple[float, np.ndarray]:
    found = evaluate_models(models, law)
    if found is None:
        return np.inf, np.zeros(len(scale))
    value, weights = blend(np.array([each.cost for each in found]), power)
    return value, scale * sum(
        (w * gradient_row(each, free) for w, each in zip(weights, found, strict=True)), np.zeros(len(scale))
    )


def gradient_row(cost: LawCost, free: Free) -> Float[np.ndarray, " parameter"]:
    """The gradient with respect to the free entries, in the order of `pack`."""
    assert cost.A is not None
    assert cost.B is not None
    assert cost.C is not None
    return np.concatenate([cost.A[free.A], cost.B[free.B], cost.C[free.C]])


def _even_scale(costs: Sequence[LawCost]) -> Float[np.ndarray, " law"]:
    """States as large as they are worth: the diagonal of what balancing would do to all."""
    X, P = _diagonals(costs)
    return (X / P) ** 0.25


def _diagonals(costs: Sequence[LawCost]) -> tuple[np.ndarray, np.ndarray]:
    diagonals: list[np.ndarray] = []
    for name in ("covariance", "worth"):
        mean = np.mean([np.diag(getattr(cost, name)) for cost in costs], axis=0)
        # A state that nothing drives or that nothing reads keeps a size: 1e-6 of the largest in amplitude.
        diagonals.append(np.maximum(mean, max(1e-12 * float(mean.max(initial=0.0)), 1e-300)))
    return diagonals[0], diagonals[1]


def _parameter_scale(
    law: Law, free: Free, costs: Sequence[LawCost], even: np.ndarray, models: Sequence[DesignModel]
) -> Float[np.ndarray, " parameter"]:
    """How far each entry may go for about the same change of the cost.

    An entry A_ij makes x_j drive x_i: its second derivative is about P_ii X_jj times how long x_j lasts, and
    for B and C the noise of a measurement and the price of an input are added.
    """
    covariance, worth = _diagonals(costs)
    X, P = covariance / even**2, worth * even**2
    values = np.abs(np.linalg.eigvals(law.A))
    lasting = 1.0 / max(float(np.median(values)), 1e-300)
    y = np.mean([np.asarray(c.measured) for c in costs], axis=0) * lasting
    u = np.mean([np.asarray(c.pushed) for c in costs], axis=0) * lasting
    noise = np.mean([np.sum(m.D21**2, axis=1) for m in models], axis=0)
    price = np.mean([np.sum(m.D12**2, axis=0) for m in models], axis=0)
    curvature = (
        np.outer(P, X * lasting)[free.A],
        np.outer(P, noise + y)[free.B],
        np.outer(price + u, X)[free.C],
    )
    return 1.0 / np.sqrt(np.maximum(np.concatenate(curvature), 1e-300))
