"""One compensator for several plants: problem at each size and authority, and the result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.h2.generalized_plant import GeneralizedPlant, generalize
from middeck.control.h2.law_form import LawForm
from middeck.control.law.compensator import Compensator, driven_ports, measured_ports
from middeck.control.law.partition import partition_modes, pose_states
from middeck.control.law.stabilisability import require_reachable
from middeck.control.law.uncertainty import Uncertainty, end_positions, finished_plants, without_delays
from middeck.control.lqg.design_model import append_integrals
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.errors import ConfigError
from middeck.systems.plants.mode_blocks import unmix_states
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.state_space.statespace import StateSpace, series
from middeck.values import record

Plants = Sequence[Plant]


@record(kw_only=True)
class Problem:
    """Data of a design; ``plants_at`` gives the plants at a size of the perturbation from 0 to 1, nominal
    first, the same at every size where ``growing`` is False."""

    nominal: Plant
    plants_at: Callable[[float], tuple[Plant, ...]]
    growing: bool
    weights: LQGWeights
    authority: float
    form: LawForm
    shaping: Shaping


def pose_problem(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    uncertainty: Uncertainty | Plants,
    positions: Float[np.ndarray, "model parameter"] | None,
    form: LawForm,
    shaping: Shaping | None = None,
) -> Problem:
    """The problem from the arguments of a design; checks them and names unstabilisable modes."""
    shaping = shaping or Shaping()
    if shaping.integral and (form.stations or form.before or form.after):
        raise ConfigError(
            "integral action cannot be combined with stations or fixed filters",
            hint="a form of an order alone, or a filter at a port of the plant",
        )
    if isinstance(uncertainty, Uncertainty):
        places = _nominal_first(
            end_positions(uncertainty) if positions is None else np.atleast_2d(np.asarray(positions, float))
        )

        def grown(size: float) -> tuple[Plant, ...]:
            there = finished_plants(plant, uncertainty, size * places if size else places[:1])
            return tuple(without_delays(each) for each in there)

        problem = Problem(
            nominal=grown(0.0)[0],
            plants_at=grown,
            growing=True,
            weights=weights,
            authority=authority,
            form=form,
            shaping=shaping,
        )
    else:
        if positions is not None:
            raise ConfigError(
                "positions= needs an Uncertainty, but plants were given one by one",
                hint="leave positions= out, or give an Uncertainty in place of the plants",
            )
        given = tuple(without_delays(p) for p in (plant, *uncertainty))
        _same_groups(given)
        problem = Problem(
            nominal=given[0],
            plants_at=lambda _: given,
            growing=False,
            weights=weights,
            authority=authority,
            form=form,
            shaping=shaping,
        )
    for each in problem.plants_at(1.0):
        _require_stabilisable(each, shaping)
    _require_a_cost(weights, shaping)
    return problem


def models_of(problem: Problem, ratio: float, size: float) -> tuple[GeneralizedPlant, ...]:
    """The models at a ratio of the authority and a size of the perturbation."""
    s = problem.form
    return tuple(
        generalize(
            _unmixed(p),
            problem.weights,
            problem.authority * ratio,
            shaping=problem.shaping,
            before=s.before,
            after=s.after,
        )
        for p in problem.plants_at(size)
    )


def _unmixed(plant: Plant) -> Plant:
    posed, condition = unmix_states(partition_modes(plant).active)
    return posed if condition > 1.0 else plant


def true_costs(problem: Problem, law: Law) -> Float[np.ndarray, " model"]:
    """E[z' W^2 z + rho u' R u], shaped, of each plant at full size under the compensator with its filters."""
    whole = whole_law(law, problem.form)
    closed = Law(whole.A, whole.B, whole.C)
    return np.array(
        [
            evaluate_cost(model, closed).cost
            for model in models_of(dataclasses.replace(problem, form=LawForm()), 1.0, 1.0)
        ]
    )


def whole_law(law: Law, form: LawForm) -> StateSpace:
    """The compensator with its fixed filters."""
    system = StateSpace(law.A, law.B, law.C, np.zeros((len(law.C), law.B.shape[1])))
    filtered = system if form.before is None else series(form.before, system)
    return filtered if form.after is None else series(filtered, form.after)


def report_law(problem: Problem, law: Law) -> dict[str, Any]:
    """Fields on problem and compensator that the results of all robust designs share."""
    part = partition_modes(problem.nominal)
    return {
        "dynamics": whole_law(law, problem.form),
        "inputs": measured_ports(part.active),
        "outputs": driven_ports(part.active),
        "authority": problem.authority,
        "order": len(law.A) - len(problem.shaping.integral),
        "inert": part.inert,
    }


def law_of(compensator: Compensator) -> Law:
    """The matrices of a strictly proper compensator; raises `ConfigError` for another."""
    system = compensator.system
    if np.any(system.D):
        raise ConfigError("start= is not strictly proper", hint="a compensator with D = 0: add a roll-off")
    return Law(system.A, system.B, system.C)


def _nominal_first(positions: np.ndarray) -> Float[np.ndarray, "model parameter"]:
    others = positions[np.any(positions != 0.0, axis=1)]
    return np.vstack([np.zeros((1, positions.shape[1])), others])


def _same_groups(plants: tuple[Plant, ...]) -> None:
    first = plants[0]
    for i, plant in enumerate(plants[1:]):
        for group in ("u", "y", "z"):
            if getattr(plant, group) != getattr(first, group):
                raise ConfigError(
                    f"plant {i + 1} has {getattr(plant, group)} as its group {group}, the nominal one "
                    f"{getattr(first, group)}",
                    hint="one compensator needs the same ports, in the same order, on every plant",
                )


def _require_a_cost(weights: LQGWeights, shaping: Shaping) -> None:
    """Refuse zero noise or zero output weights: the optimal compensator would be zero."""
    if not np.any(weights.process):
        raise ConfigError(
            "the process intensity is zero: nothing disturbs the plant",
            hint="a positive intensity on an input of w",
        )
    if not np.any(weights.output) and not shaping.integral:
        raise ConfigError(
            "all output weights are zero: the cost has no output", hint="a positive weight on an output of z"
        )


def _require_stabilisable(plant: Plant, shaping: Shaping) -> None:
    active = pose_states(partition_modes(plant).active)
    s, names = active.system, name_states(active)
    u, y = active.input_indices(active.u), active.output_indices(active.y)
    asked = [name for name, _ in shaping.integral if name in active.y]
    longer = append_integrals(
        s.A, s.B[:, u], s.C[y], s.D[np.ix_(y, u)], [active.y.index(name) for name in asked]
    )
    integrals = tuple(f"integral of {name}" for name in asked)
    require_reachable(*longer, (*names, *integrals), complaint="no control input in u reaches it")
    require_reachable(
        s.A.T,
        s.C[y].T,
        names,
        complaint="no measurement in y sees it",
        hint="measure it, or leave it out of the design if no input reaches it either",
    )


@record(kw_only=True)
class Attempt:
    """One stage of the search for a design.

    Attributes:
        size: Size of the perturbations from 0 (nominal model) to 1; for sensitivity weighting the strength
            tried.
        cost: Cost at the end of the stage.
    """

    size: float
    cost: float


@record(kw_only=True)
class RobustCompensator(Compensator):
    """A compensator made for more than one plant.

    Attributes:
        authority: 1/rho.
        order: Number of free states, without those of fixed filters and integrals.
        cost: Value minimised: the mean or the maximum over the models, a bound, or a weighted cost.
        costs: E[z' W^2 z + rho u' R u] on each design model, the nominal one first; ``inf`` where unstable.
            With a `Shaping`, of what its filters and integrals make of them.
        gradient: Norm of the gradient over the cost where the method descends, in coordinates of unit size;
            the largest relative residual where it solves Riccati equations.
        history: Stages of the search.
        inert: Uncontrollable and unobservable modes of the nominal plant.
    """

    authority: float
    order: int
    cost: float
    costs: Float[np.ndarray, " model"]
    gradient: float
    history: tuple[Attempt, ...]
    inert: tuple[str, ...]
