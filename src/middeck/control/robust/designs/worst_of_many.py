"""Minimax compensator for many plants by exchange: the worst plants are added to the models.

The exchange method of semi-infinite programming (Hettich and Kortanek 1993, SIAM Review 35): a minimax
compensator for few plants, the worst of all plants under it, a minimax compensator for these too. It ends
when no plant costs more than the worst of the design's own, which is then the minimax compensator for all.
"""

from collections.abc import Sequence

import numpy as np

from middeck.control.h2.closed_cost import evaluate_cost, spectral_abscissa
from middeck.control.h2.generalized_plant import GeneralizedPlant, generalize
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import without_delays
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.designs.multimodel import MultiModelCompensator, design_multimodel
from middeck.control.robust.problem.several_plants import law_of
from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant

ADDED, ROUNDS = 6, 30
WITHIN = 1.01
"""Cost relative to that of the worst model up to which a plant is not added."""


def design_for_worst(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    *,
    candidates: Sequence[Plant],
    tolerance: float = 1e-5,
) -> tuple[MultiModelCompensator, tuple[int, ...]]:
    """The minimax compensator over ``plant`` and thousands of ``candidates``, and the indices of its models.

    Other arguments are as in `design_multimodel` with ``over="maximum"``. No candidate costs more than 1 %
    above the compensator's ``cost``.

    Raises `NumericalError` where some candidate is still worse after thirty rounds, or as
    `design_multimodel`.
    """
    models = [generalize(without_delays(each), weights, authority) for each in candidates]
    chosen: list[int] = []
    start: Compensator | None = None
    law: Compensator | None = None
    worse: list[int] = []
    for _ in range(ROUNDS):
        law = design_multimodel(
            plant, weights, authority, uncertainty=[candidates[i] for i in chosen], over="maximum",
            start=start, tolerance=tolerance,
        )  # fmt: skip
        worse, stable = _worse_than(WITHIN * law.cost, models, law)
        if not worse:
            return law, tuple(chosen)
        chosen += worse[:ADDED]
        start = law if stable else None
    raise NumericalError(
        f"after {ROUNDS} rounds {len(worse)} plants still cost more than the worst of the models",
        hint="a smaller uncertainty or a lower authority",
        law=law,
    )


def _worse_than(
    limit: float, models: Sequence[GeneralizedPlant], compensator: Compensator
) -> tuple[list[int], bool]:
    """Unstable plants, fastest growth first; if none, those of cost above ``limit``, and True."""
    law = law_of(compensator)
    costs = np.array([evaluate_cost(model, law).cost for model in models])
    unstable = [int(i) for i in np.flatnonzero(~np.isfinite(costs))]
    if unstable:
        return sorted(unstable, key=lambda i: -spectral_abscissa(models[i], law)), False
    return [int(i) for i in np.argsort(-costs) if costs[i] > limit], True
