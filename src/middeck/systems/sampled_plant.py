"""A plant as a computer sees it: held inputs, sampled outputs, delays exact, ports by name."""

from __future__ import annotations

import numpy as np

from middeck.signals.ports import Port
from middeck.systems.delayed_plant import DelayedPlant
from middeck.systems.delayed_sampling import is_sum, sample_delayed
from middeck.systems.plant import Plant, name_states
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record


@record
class SampledPlant:
    """A plant as a computer sees it: inputs held, outputs sampled, delays exact.

    Parameters
    ----------
    system:
        From held inputs to sampled outputs; states as in `sample_delayed`.
    inputs, outputs, w, u, z, y, state_names:
        As in `Plant`.
    """

    system: SampledStateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    w: tuple[str, ...]
    u: tuple[str, ...]
    z: tuple[str, ...]
    y: tuple[str, ...]
    state_names: tuple[str, ...]


def build_sampled_plant(plant: Plant | DelayedPlant, period_s: float) -> SampledPlant:
    """The plant from inputs held over ``period_s`` to outputs sampled at its ends: exact, delays included.

    Raises `ConfigError` for a period that is not positive.

    >>> from middeck.systems.delayed_plant import delay_inputs
    >>> from middeck.systems.statespace import StateSpace
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> late = delay_inputs(Plant(lag, (Port("force", "N"),), (Port("way", "m"),)), 0.015)
    >>> build_sampled_plant(late, 0.01).state_names
    ('state 0', 'delay', 'delay')
    """
    inside = plant.plant if isinstance(plant, DelayedPlant) else plant
    late = plant.delay_s if isinstance(plant, DelayedPlant) else np.zeros(inside.system.D.shape)
    system = sample_delayed(inside.system, period_s, late)
    modes = name_states(inside) * (1 if is_sum(late / period_s) else len(inside.inputs))
    names = (*modes, *("delay",) * (len(system.A) - len(modes)))
    groups = inside.w, inside.u, inside.z, inside.y
    return SampledPlant(system, inside.inputs, inside.outputs, *groups, names)
