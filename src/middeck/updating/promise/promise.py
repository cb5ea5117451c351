"""Predictions of compensators where they cannot be tested: distributions over drawn plants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator, driven_ports, measured_ports
from middeck.control.law.delay_order import approximation_order
from middeck.control.lqg.design import LQGCompensator, design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import ConfigError
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.updating.orbit.predicted_frequencies import Prediction, predict_modes
from middeck.updating.promise.blocks_of_draws import (
    Measured,
    Site,
    blocks,
    join_blocks,
    measure_block,
    seen_by,
)
from middeck.updating.promise.draws import DrawnPlants, draw_plants
from middeck.updating.promise.left_out_modes import LeftOut, find_left_out
from middeck.updating.promise.performance_bound import RobustBound, bound_worst
from middeck.updating.promise.plan import Ladder, Plan, close_inner, group_loop, plant_of, weights_of
from middeck.updating.promise.refined_slips import with_refined
from middeck.updating.promise.robustness_sweep import Swept, SweptPlants, sweep_plants, try_sweep
from middeck.updating.promise.slip_run import join_slips
from middeck.updating.promise.slip_time import SlipTime
from middeck.updating.promise.stability_probability import (
    Outlook,
    highest_promised,
    look_ahead,
    with_friction,
)
from middeck.updating.promise.weak_cable import lost_to_cable, may_have_cable
from middeck.updating.refinement.refine import Refined
from middeck.values import record


@record(kw_only=True)
class Promise:
    """The promise for every compensator in one environment.

    Attributes:
        modes: Frequencies, with their intervals.
        plants: The drawn plants, inner loops closed and delays in.
        outlooks: Outlooks in the order of the plan: compensators given, then those of the ladder.
        rest_rms: Rms of the performance without any compensator, by draw.
        bound: Bound of each compensator, by name, over the first ``plan.bounded`` draws, without friction and
            over all frequencies.
        highest: The last of the ladder that is promised stable with every one before it; None for none.
        swept: Plants of the sweep of the plan, around the most probable one.
        sweeps: Result of each compensator on them, by name.
        slip_time: Times of the simulation of joint friction; None where the plan states none.
        lost_to_cable: Compensators that a weak cable would make unstable; None where the article does not
            float, or the plan states a cable.
        left_out: Compensators for which the plants have too few modes.
    """

    modes: Prediction
    plants: tuple[Plant, ...]
    outlooks: tuple[Outlook, ...]
    rest_rms: Float[np.ndarray, " draw"]
    bound: Mapping[str, RobustBound]
    highest: str | None
    swept: SweptPlants
    sweeps: Mapping[str, Swept]
    slip_time: SlipTime | None = None
    lost_to_cable: tuple[str, ...] | None = None
    left_out: LeftOut | None = None


def design_ladder(modes: Modes, plan: Plan) -> dict[str, LQGCompensator]:
    """The ladder's compensators by name: LQG on an article of these modes, its delays approximated."""
    if plan.ladder is None:
        return {}
    whole = close_inner(plan, plant_of(plan, modes))
    delayed = delay_plant(whole, plan.loop.delay_s) if plan.loop.delay_s else whole
    return design_on(group_loop(plan, delayed, plan.ladder.drives, plan.ladder.reads), plan.ladder, plan)


def design_on(delayed: Plant, ladder: Ladder, plan: Plan) -> dict[str, LQGCompensator]:
    """The compensators of ``ladder`` by name, designed on a plant grouped for them, with its delays."""
    model = approximate_delays(delayed, approximation_order(delayed))
    weights = weights_of(plan, driven_ports(model), measured_ports(model))
    kalman = design_filter(model, weights)
    return {
        f"LQG {np.log10(level):g}": design_lqg(model, weights, float(level), kalman=kalman)
        for level in ladder.authority
    }


@named_kinds
def promise(
    refined: Refined, plan: Plan, measured: Mapping[str, Sequence[Measured]] | None = None
) -> dict[str, Promise]:
    """Every compensator of the plan and of its ladder, in every environment.

    ``measured`` are the blocks of every environment (`measure_block`) where they are known already. Raises
    `ConfigError` for ports that the article does not have, units whose noise the plan does not state, and so
    few modes that all of them are rigid, and as `draw_plants`.
    """
    sites = set_sites(refined, plan)
    known = measured or {
        name: [measure_block(site, k) for k in range(blocks(plan))] for name, site in sites.items()
    }
    return {name: _there(site, known[name]) for name, site in sites.items()}


def set_sites(refined: Refined, plan: Plan) -> dict[str, Site]:
    """The values that the draws share, by environment.

    Raises as `promise`, of whose draws none is built yet.
    """
    plan = with_refined(plan, refined)
    most_hz = plan.loop.most_cable_hz
    predicted = {
        name: predict_modes(refined, place, count=plan.modes, umbilical_hz=most_hz)
        for name, place in plan.environments.items()
    }
    for name, place in plan.environments.items():
        _require_flexible(predicted[name].modes, plan, place)
    first = next(iter(predicted.values()))
    laws = _together(plan.laws, design_ladder(first.modes, plan))
    return {
        name: _site(refined, plan, place, predicted[name], laws) for name, place in plan.environments.items()
    }


def _require_flexible(modes: Modes, plan: Plan, place: Environment) -> None:
    rigid = modes.kind.count("rigid")
    if plan.modes <= rigid:
        raise ConfigError(
            f"{plan.modes} modes kept in each plant, of which {rigid} are rigid in {place.title}",
            where="promise, modes",
            hint=f"{rigid + 1} to {len(modes.omega)}: how many of the lowest modes to keep, not which",
        )


def _site(
    refined: Refined,
    plan: Plan,
    place: Environment,
    predicted: Prediction,
    laws: Mapping[str, Compensator],
) -> Site:
    drawing = draw_plants(
        refined,
        place,
        partial(plant_of, plan),
        draws=plan.draws,
        rng=np.random.default_rng(plan.seed),
        loop=plan.loop,
        finish=partial(close_inner, plan),
        mean=predicted,
    )
    return Site(plan=plan, title=place.title, predicted=predicted, drawing=drawing, laws=laws)


def _there(site: Site, parts: Sequence[Measured]) -> Promise:
    plan, laws, found = site.plan, site.laws, join_blocks(site, parts)
    drawn, alone = found.drawn, found.alone
    seen = {name: seen_by(law, drawn, plan) for name, law in laws.items()}
    outlooks = tuple(
        look_ahead(name, law, seen[name][0], found.noise[name], alone) for name, law in laws.items()
    )
    slip_time = None
    if site.run is not None:
        slipped, slip_time = join_slips([part.slipped for part in parts]), site.run.time
        rest, slips = slipped[None], site.run.slips
        outlooks = tuple(with_friction(o, slipped[o.name], rest, slips, drawn) for o in outlooks)
        alone = alone * 10.0 ** (rest.db / 20.0)
    swept = sweep_plants(site.predicted, plan)
    best = highest_promised(outlooks[len(plan.laws) :], plan.probability)
    return Promise(
        modes=site.predicted.below(plan.modes),
        plants=drawn.plants,
        outlooks=outlooks,
        rest_rms=alone,
        bound={name: _bound(law, *seen[name], plan.bounded) for name, law in laws.items()},
        highest=None if best is None else best.name,
        swept=swept,
        sweeps={name: try_sweep(swept, law, plan) for name, law in laws.items()},
        slip_time=slip_time,
        lost_to_cable=lost_to_cable(site) if may_have_cable(site) else None,
        left_out=find_left_out(site, outlooks),
    )


def _together(
    given: Mapping[str, Compensator], ladder: Mapping[str, LQGCompensator]
) -> dict[str, Compensator]:
    twice = sorted(set(given) & set(ladder))
    if twice:
        raise ConfigError(
            f"a given compensator and one of the ladder are both called {twice[0]!r}",
            where="promise",
            hint="another name",
        )
    return {**given, **ladder}


def _bound(law: Compensator, seen: DrawnPlants, weights: LQGWeights, bounded: int) -> RobustBound:
    return bound_worst(seen.plants[:bounded], law, weights)
