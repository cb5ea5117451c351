"""Every compensator of a promise on the refined article with its flexible modes shifted."""

from __future__ import annotations

from functools import partial

import numpy as np
from jaxtyping import Bool

from middeck.control.law.compensator import Compensator
from middeck.control.robust.verification.monte_carlo import which_decay
from middeck.structure.modes.results.dispersed_modes import dispersed_modes
from middeck.systems.plants.dispersed_frequencies import DispersedModes, dispersed_factors
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.updating.orbit.predicted_frequencies import Prediction
from middeck.updating.promise.draws import mean_plant
from middeck.updating.promise.plan import Plan, close_inner, group_loop, plant_of, weights_of
from middeck.values import record


@record
class SweptPlants:
    """Plants with shifted modes, inner loops closed and the plan's delay in.

    Attributes:
        modes: The shifted modes.
        cases: Name of each plant, as ``"second bending x-y -20 %"``.
    """

    modes: DispersedModes
    cases: tuple[str, ...]
    plants: tuple[Plant, ...]


@record
class Swept:
    """Stability of one compensator in each case of a sweep, joints linear."""

    cases: tuple[str, ...]
    stable: Bool[np.ndarray, " case"]

    @property
    def lost(self) -> tuple[str, ...]:
        """Names of the cases that are not stable."""
        return tuple(name for name, held in zip(self.cases, self.stable, strict=True) if not held)


def sweep_plants(predicted: Prediction, plan: Plan) -> SweptPlants:
    """The most probable plant, shifted as in each case (`dispersed_factors`) of the plan's sweep."""
    mean = mean_plant(predicted, partial(plant_of, plan))
    modes = dispersed_modes(predicted.modes, plan.modes)
    factors = dispersed_factors(modes, plan.sweep)
    plants = tuple(_shifted(mean, by, plan) for by in factors.values())
    return SweptPlants(modes, tuple(factors), plants)


def _shifted(mean: Plant, factors: dict[str, float], plan: Plan) -> Plant:
    plant = close_inner(plan, shift_modes(mean, factors))
    return delay_plant(plant, plan.loop.delay_s) if plan.loop.delay_s else plant


def try_sweep(swept: SweptPlants, law: Compensator, plan: Plan) -> Swept:
    """Stability of ``law`` in every case, delays exact."""
    u, y = (tuple(p.name for p in side) for side in (law.outputs, law.inputs))
    plants = [group_loop(plan, plant, u, y) for plant in swept.plants]
    return Swept(swept.cases, which_decay(plants, law, weights_of(plan, law.outputs, law.inputs)))
