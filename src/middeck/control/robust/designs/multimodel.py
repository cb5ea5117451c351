"""One compensator of any order for several plants: fixed-order H2 (MacMartin, Hall and Bernstein 1991).

The mean, or the maximum, over the models of E[z' W^2 z + rho u' R u] is minimised over the compensator's
matrices, with analytic gradients. The domain is the set of compensators that stabilise all models; the cost
grows without bound at its edge, so that a descent begun inside stays inside. How to begin inside is in
`middeck.control.robust.search.stabilising_continuation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.h2.law_form import LawForm
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import Uncertainty
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.control.robust.problem.several_plants import (
    Problem,
    RobustCompensator,
    law_of,
    pose_problem,
    report_law,
    true_costs,
)
from middeck.control.robust.search.smooth_maximum import blend
from middeck.control.robust.search.stabilising_continuation import Arrival, approach, carry_on
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.values import record

Over = Literal["mean", "maximum"]
POWERS: dict[str, tuple[float, ...]] = {"mean": (1.0,), "maximum": (4.0, 16.0, 64.0)}
"""Successive exponents of the blend; the last one's value is within the 64th root of N of the maximum."""


@record(kw_only=True)
class MultiModelCompensator(RobustCompensator):
    """A multi-model compensator with the weight (dual variable) of each model.

    Attributes:
        multipliers: Weight of each model's cost in the mean whose minimum this is; they add up to one. Equal
            for the mean; the dual weights of the maximum.
    """

    multipliers: Float[np.ndarray, " model"]


@named_kinds
def design_multimodel(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    *,
    uncertainty: Uncertainty | Sequence[Plant],
    positions: Float[np.ndarray, "model parameter"] | None = None,
    over: Over = "mean",
    form: LawForm | None = None,
    shaping: Shaping | None = None,
    start: Compensator | None = None,
    tolerance: float = 1e-9,
) -> MultiModelCompensator:
    """The compensator of a given form with the least mean or maximum of the costs of several plants.

    Args:
        plant: The nominal plant, before ``uncertainty.finish``.
        weights, authority: As for `design_lqg`; rho = 1/authority.
        uncertainty: A box, or a list of the other plants, which may differ in number of states but not in
            ports.
        positions: Positions of the models in the box (`end_positions` unless given; also `corner_positions`).
        over: ``"mean"`` or ``"maximum"``.
        form: Order, stations and fixed filters; as many states as the nominal model unless given.
        shaping: Filters at ports, integral action and correlated noise, as for `design_lqg`. Integrals come
            as last states, beside those of ``form``; they go with no stations and no fixed filters.
        start: A compensator to begin with, e.g. of a lower authority: strictly proper, of ``form`` without
            its filters, integrals last; found if not given.
        tolerance: The descent ends when as many steps as the compensator has free entries gain less than this
            fraction of the cost.

    Raises `NotStabilisableError` naming the modes of a plant that nothing can hold; `NumericalError` where no
    compensator of that form was found that stabilises all models; how far it came is in its data;
    `ConfigError` for weights, ports, modes or forms that do not fit.
    """
    if over not in POWERS:
        raise ConfigError(f"over is {over!r}", hint="mean or maximum")
    form = form or LawForm()
    problem = pose_problem(plant, weights, authority, uncertainty, positions, form, shaping)
    powers = POWERS[over]
    arrival = approach(problem, None if start is None else law_of(start), powers[0])
    for power in powers:
        arrival = carry_on(problem, arrival, power, tolerance)
    return _result(problem, arrival, over)


def _result(problem: Problem, arrival: Arrival, over: Over) -> MultiModelCompensator:
    costs = true_costs(problem, arrival.law)
    multipliers = blend(costs, POWERS[over][-1])[1]
    return MultiModelCompensator(
        **report_law(problem, arrival.law),
        cost=float(costs.mean() if over == "mean" else costs.max()),
        costs=costs,
        gradient=arrival.gradient,
        history=arrival.history,
        multipliers=multipliers / multipliers.sum(),
    )
