"""Blended cost of several models: their mean, or a smooth maximum with its dual weights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.h2.closed_cost import Law, LawCost, evaluate_cost
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import Free, arrange, pack, scale_states, unpack
from middeck.control.robust.search.law_scaling import even_scale, parameter_scale
from middeck.control.robust.search.quasi_newton import PATIENCE, Descent, descend

Stations = list[tuple[list[int], list[int], int]]


def blend(costs: Float[np.ndarray, " model"], power: float) -> tuple[float, Float[np.ndarray, " model"]]:
    """(mean J^p)^(1/p) and its derivative by each J: the mean for p = 1, the maximum as p grows.

    The maximum J lies between it and N^(1/p) times it. The derivatives are the weights of a mean whose
    minimum is the same law: of a minimax design the dual weights.

    >>> blend(np.array([1.0, 3.0]), 1.0)[0]
    2.0
    """
    largest = float(costs.max())
    value = largest * float(((costs / largest) ** power).sum() / len(costs)) ** (1.0 / power)
    return value, (costs / value) ** (power - 1.0) / len(costs)


def evaluate_models(models: Sequence[GeneralizedPlant], law: Law) -> list[LawCost] | None:
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
    models: Sequence[GeneralizedPlant],
    stations: Stations,
    *,
    power: float,
    tolerance: float,
    steps: int = 2000,
    to_the_end: bool = False,
) -> tuple[Law, Descent] | None:
    """Descend from ``law`` in scaled coordinates; None where it does not stabilise all models.

    It ends when ten steps gain less than ``tolerance`` of the cost, ``to_the_end`` as many as free entries.
    """
    integrals = len(models[0].integrals)
    arranged, free = arrange(law, stations, integrals)
    start = evaluate_models(models, arranged)
    if start is None:
        return None
    states = even_scale(start, integrals)
    even = scale_states(arranged, states)
    scale = parameter_scale(even, free, start, states, models)

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        return _blended(models, unpack(x * scale, even, free), free, power, scale)

    x = pack(even, free) / scale
    patience = max(PATIENCE, len(x)) if to_the_end else PATIENCE
    descent = descend(objective, x, tolerance=tolerance, steps=steps, patience=patience)
    return unpack(descent.x * scale, even, free), descent


def _blended(
    models: Sequence[GeneralizedPlant], law: Law, free: Free, power: float, scale: np.ndarray
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
