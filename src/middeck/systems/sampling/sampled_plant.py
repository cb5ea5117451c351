"""Sampled plants: held inputs, sampled outputs, exact delays, ports by name."""

import dataclasses
import functools

from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.sampling.delayed_sampling import is_sum, sample_delayed, tidy_samples

KEPT = 8
"""Sampled plants that are known: laws are judged one after the other on the same few."""


def sample_plant(plant: Plant, period_s: float) -> Plant:
    """The plant from inputs held over ``period_s`` to outputs sampled at its ends: exact, delays included.

    States as in `sample_delayed`; those beyond the plant's own are named "delay". Raises `ConfigError` for a
    period that is not positive, and for a plant that is sampled already.

    >>> from middeck.systems.plants.plant_from_matrices import make_plant
    >>> sample_plant(make_plant([[-1.0]], [[1.0]], [[1.0]], delay_s=0.015), 0.01).state_names
    ('state 0', 'delay', 'delay')
    """
    return _sample(plant, float(period_s))


@functools.lru_cache(maxsize=KEPT)
def _sample(plant: Plant, period_s: float) -> Plant:
    system = sample_delayed(remove_delays(plant).system, period_s, plant.delay_s)
    modes = name_states(plant) * (1 if is_sum(tidy_samples(plant.delay_s / period_s)) else len(plant.inputs))
    names = (*modes, *("delay",) * (len(system.A) - len(modes)))
    return dataclasses.replace(remove_delays(plant), dynamics=system, state_names=names)
