"""Effect of modes beyond those of the promised plants, on the most probable article by the model alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from middeck.control.qualification import decibels
from middeck.control.robust.verification.monte_carlo import noise_on, uncontrolled_rms
from middeck.structure.modes.solve import Modes
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.updating.promise.blocks_of_draws import Site
from middeck.updating.promise.plan import Plan, close_inner, group_loop, plant_of, weights_of
from middeck.updating.promise.stability_probability import Outlook
from middeck.values import record

TIMES = 3
"""So many times the modes of the promised plants are tried."""


@record
class LeftOut:
    """Compensators for which the plants of the promise have too few modes.

    Attributes:
        modes: Number of modes tried in place of the plan's.
        shift_db: Shift of their decibels, by name, where it exceeds the standard deviation of the draws;
            infinite where the loop is then unstable.
    """

    modes: int
    shift_db: Mapping[str, float]


def find_left_out(site: Site, outlooks: Sequence[Outlook]) -> LeftOut:
    """The effect of further modes on every compensator that is stable without them."""
    plan, modes = site.plan, site.predicted.modes
    more = min(TIMES * plan.modes, len(modes.omega))
    plants = [_plant(dataclasses.replace(plan, modes=count), modes) for count in (plan.modes, more)]
    shift: dict[str, float] = {}
    for outlook in outlooks:
        law, drawn = site.laws[outlook.name], outlook.db[np.isfinite(outlook.db)]
        drives, reads = ([port.name for port in side] for side in (law.outputs, law.inputs))
        seen, weights = (
            [group_loop(plan, plant, drives, reads) for plant in plants],
            weights_of(plan, law.outputs, law.inputs),
        )
        (stable, _), rms, _ = noise_on(seen, law, weights, plan.band_hz)
        if not stable or not len(drawn):
            continue
        alone = uncontrolled_rms(seen, weights, plan.band_hz)
        few, many = (decibels(*both) for both in zip(rms.tolist(), alone.tolist(), strict=True))
        if abs(many - few) > np.std(drawn):
            shift[outlook.name] = many - few
    return LeftOut(more, shift)


def _plant(plan: Plan, modes: Modes) -> Plant:
    plant = close_inner(plan, plant_of(plan, modes))
    return delay_plant(plant, plan.loop.delay_s) if plan.loop.delay_s else plant
