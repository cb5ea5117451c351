"""Sampled plants: held inputs, sampled outputs, exact delays, ports by name."""

import dataclasses
import functools
import warnings

import numpy as np

from middeck.arguments import named_kinds
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.poles.stability import growth_rates
from middeck.systems.sampling.delayed_sampling import is_sum, sample_delayed, tidy_samples

KEPT = 8
"""Sampled plants that are known: compensators are judged one after the other on the same few."""
TURNS = 4.0
"""How often the slowest mode turns within a period that is doubted: slow laws let a fast one turn twice."""
AT_REST = 1e-6
"""Poles below this, relative to the largest, are those of a free body."""


@named_kinds
def sample_plant(plant: Plant, period_s: float) -> Plant:
    """The plant from inputs held over ``period_s`` to outputs sampled at its ends: exact, delays included.

    States as in `sample_delayed`; those beyond the plant's own are named "delay". Raises `ConfigError` for a
    period that is not positive, and for a plant that is sampled already. Warns (`UserWarning`) of a period
    that looks like a rate: every mode turns, or decays, several times within it, and at its number in Hz
    would be below half the rate.

    >>> from middeck.systems.plants.plant_from_matrices import make_plant
    >>> sample_plant(make_plant([[-1.0]], [[1.0]], [[1.0]], delay_s=0.015), 0.01).state_names
    ('state 0', 'delay', 'delay')
    """
    sampled = _sample(plant, float(period_s))
    warnings_on_period(plant, period_s)
    return sampled


def warnings_on_period(plant: Plant, period_s: float) -> None:
    """Warn (`UserWarning`) of a period that looks like a rate in Hz."""
    if period_s**2 <= 2.0 * TURNS:  # no mode can be both too fast and too slow
        return
    hz = np.abs(growth_rates(remove_delays(plant).system)) / (2.0 * np.pi)
    moving = hz[hz > AT_REST * hz.max(initial=0.0)]
    if moving.size and 2.0 * moving.max() < period_s and (turns := moving.min() * period_s) > TURNS:
        warnings.warn(
            f"within a period of {period_s:g} s even the slowest mode ({moving.min():.3g} Hz) turns, or "
            f"decays, {turns:.3g} times: if {period_s:g} Hz is the rate, the period is its inverse",
            UserWarning,
            stacklevel=4,
        )


@functools.lru_cache(maxsize=KEPT)
def _sample(plant: Plant, period_s: float) -> Plant:
    system = sample_delayed(remove_delays(plant).system, period_s, plant.delay_s)
    modes = name_states(plant) * (1 if is_sum(tidy_samples(plant.delay_s / period_s)) else len(plant.inputs))
    names = (*modes, *("delay",) * (len(system.A) - len(modes)))
    return dataclasses.replace(remove_delays(plant), dynamics=system, state_names=names)
