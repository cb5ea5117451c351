"""Sensitivity-weighted LQG: extra cost and process noise for uncertain modes (Grocott 1994).

The cost includes the sensitivity of z to each uncertain parameter, E[sum h_i^2 z_i' W^2 z_i] with z_i = dz/d
alpha_i. The sensitivities obey x_i' = A x_i + A_i x; taken quasi-statically, x_i = -A^-1 A_i x, they need no
states, and the problem stays an LQG of the plant's order. The filter is dual, with additional process noise
A_i A^-1 B1 w.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import LawForm
from middeck.control.h2.nominal_law import solve_lqg
from middeck.control.law.uncertainty import Uncertainty
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.control.riccati.continuous import RiccatiSolution
from middeck.control.robust.problem.directions import Directions, stiffness_directions
from middeck.control.robust.problem.several_plants import (
    Attempt,
    Problem,
    RobustCompensator,
    models_of,
    pose_problem,
    report_law,
)
from middeck.control.robust.search.smooth_maximum import evaluate_models
from middeck.errors import ConfigError, NumericalError
from middeck.systems.plants.plant import Plant
from middeck.values import record

RUNGS = (0.0, *(0.1 * 2.0**k for k in range(20)))
"""Strengths tried: zero, then doubled from a tenth of the half-widths."""
FINER = 7
"""Strengths tried between the neighbours of the best rung: steps of a fifth."""


@record(kw_only=True)
class SensitivityWeightedCompensator(RobustCompensator):
    """An LQG compensator of a cost with sensitivities.

    Attributes:
        strength: Factor on the half-widths.
        regulator, estimator: The two Riccati solutions.
    """

    strength: float
    regulator: RiccatiSolution
    estimator: RiccatiSolution


def design_sensitivity_weighted(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    *,
    uncertainty: Uncertainty,
    shaping: Shaping | None = None,
    strength: float | None = None,
) -> SensitivityWeightedCompensator:
    """The LQG compensator, of the plant's order, for cost and noise extended by the modes' uncertainty.

    Args:
        plant, weights, authority, uncertainty, shaping: As for `design_multimodel`; only
            ``uncertainty.shifts`` enter the cost, and only with the weights of z.
        strength: Factor on the half-widths in the cost. None: chosen, in steps of a fifth, for the least mean
            of the plain costs at the ends of the box, all of which are then stable.

    Raises `NumericalError` where no strength holds all models; `ConfigError`, `NotStabilisableError` as
    `design_multimodel`.
    """
    if strength is not None and not (np.isfinite(strength) and strength >= 0.0):
        raise ConfigError(f"strength = {strength}", hint="zero or more")
    problem = pose_problem(plant, weights, authority, uncertainty, None, LawForm(), shaping)
    directions = stiffness_directions(plant, problem.nominal, uncertainty)
    models = models_of(problem, 1.0, 1.0)
    tried: list[Attempt] = []
    level = _best_strength(models, directions, tried) if strength is None else strength
    return _result(problem, models, directions, level, tuple(tried))


def _best_strength(models: Sequence[GeneralizedPlant], directions: Directions, tried: list[Attempt]) -> float:
    """Best strength on a coarse ladder, then between its neighbours; an unstable model costs ``inf``."""

    def mean_cost(strength: float) -> float:
        law = _solve(models[0], directions, strength)[0]
        found = evaluate_models(models, law)
        cost = np.inf if found is None else float(np.mean([each.cost for each in found]))
        tried.append(Attempt(size=strength, cost=cost))
        return cost

    costs = [mean_cost(strength) for strength in RUNGS]
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        raise NumericalError(
            f"sensitivity weighting stabilises the models at no strength up to {RUNGS[-1]:g}",
            hint="a lower authority, a smaller uncertainty, or design_multimodel",
            history=tuple(tried),
        )
    if not best:
        return 0.0
    ends = RUNGS[max(best - 1, 1)], RUNGS[min(best + 1, len(RUNGS) - 1)]
    for strength in np.geomspace(*ends, FINER + 2)[1:-1]:
        mean_cost(float(strength))
    return min(tried, key=lambda stage: stage.cost).size


def _solve(
    model: GeneralizedPlant, directions: Directions, strength: float
) -> tuple[Law, RiccatiSolution, RiccatiSolution, float]:
    """The compensator, both Riccati solutions, and the weighted cost."""
    return solve_lqg(_weighted(model, directions, strength))


def _weighted(model: GeneralizedPlant, directions: Directions, strength: float) -> GeneralizedPlant:
    """The model with outputs -C1 A^-1 A_i x h_i and noise inputs -A_i A^-1 B1 w_i h_i beside its own."""
    outputs, noises = [model.C1], [model.B1]
    inverse = np.linalg.pinv(model.A)
    for change in _changes(directions, len(model.A)) if strength else []:
        outputs.append(strength * (model.C1 @ inverse @ change))
        noises.append(strength * (change @ inverse @ model.B1))
    extra_e, extra_w = len(model.C1) * (len(outputs) - 1), model.B1.shape[1] * (len(noises) - 1)
    return dataclasses.replace(
        model,
        C1=np.vstack(outputs),
        D12=np.vstack([model.D12, np.zeros((extra_e, model.D12.shape[1]))]),
        B1=np.hstack(noises),
        D21=np.hstack([model.D21, np.zeros((len(model.D21), extra_w))]),
    )


def _changes(directions: Directions, states: int) -> list[np.ndarray]:
    """h_i A_i of each shift: change of A by its half-width, all modes of a group together."""
    found: list[np.ndarray] = []
    for group in sorted(set(directions.group)):
        mine = np.array([g == group for g in directions.group])
        half = (directions.high - directions.low)[mine] / 2.0
        change = np.zeros((states, states))
        known = len(directions.into)
        change[:known, :known] = directions.into[:, mine] @ (half[:, None] * directions.out[mine])
        found.append(change)
    return found


def _result(
    problem: Problem,
    models: Sequence[GeneralizedPlant],
    directions: Directions,
    strength: float,
    tried: tuple[Attempt, ...],
) -> SensitivityWeightedCompensator:
    law, regulator, estimator, cost = _solve(models[0], directions, strength)
    return SensitivityWeightedCompensator(
        **report_law(problem, law),
        cost=cost,
        costs=np.array([evaluate_cost(model, law).cost for model in models]),
        gradient=max(regulator.residual, estimator.residual),
        history=tried,
        strength=strength,
        regulator=regulator,
        estimator=estimator,
    )
