"""Margins of a sampled loop at its own rate: of L(exp(j w T)), hold and true delay included."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.control.analysis import (
    AllowedShift,
    DiskMargin,
    Margins,
    find_allowed_shifts,
    measure_disk_margin,
    measure_margins,
)
from middeck.control.analysis.loop import At
from middeck.control.kinds import require_sampled
from middeck.control.partition import partition_modes
from middeck.control.sampled_compensator import SampledCompensator
from middeck.systems.delayed_plant import DelayedPlant
from middeck.systems.delayed_sampling import sample_delayed
from middeck.systems.plant import Plant, subsystem
from middeck.systems.statespace import SampledStateSpace


def sample_controlled(plant: Plant | DelayedPlant, compensator: SampledCompensator) -> SampledStateSpace:
    """What the law sees: from its outputs, held, to its inputs, sampled, each path late by its true delay.

    Beside ``compensator.system`` this is what `middeck.control.analysis` takes for a sampled loop. Raises
    `ConfigError` where the plant lacks a port of the law.
    """
    require_sampled(compensator)
    inside = plant.plant if isinstance(plant, DelayedPlant) else plant
    u, y = (tuple(p.name for p in side) for side in (compensator.outputs, compensator.inputs))
    rows, columns = inside.output_indices(y), inside.input_indices(u)
    late = (
        plant.delay_s[np.ix_(rows, columns)]
        if isinstance(plant, DelayedPlant)
        else np.zeros((len(y), len(u)))
    )
    return sample_delayed(subsystem(partition_modes(inside).active, u, y), compensator.period_s, late)


def measure_sampled_margins(
    plant: Plant | DelayedPlant, compensator: SampledCompensator, *, at: At = "inputs"
) -> Margins:
    """Gain, phase, delay and disk margins of each loop at the sampled rate, the others closed.

    A gain is margin for the loop as it runs: what the hold and the delays cost is in it already. Raises
    `ConfigError` where the plant lacks a port of the law.
    """
    found = measure_margins(sample_controlled(plant, compensator), compensator.system, at=at)
    u, y = (tuple(p.name for p in side) for side in (compensator.outputs, compensator.inputs))
    names = {"inputs": u, "outputs": y, "both": (*u, *y)}[at]
    loops = tuple(dataclasses.replace(m, channel=n) for m, n in zip(found.loops, names, strict=True))
    return dataclasses.replace(found, loops=loops)


def measure_sampled_disk(
    plant: Plant | DelayedPlant, compensator: SampledCompensator, *, at: At = "both"
) -> DiskMargin:
    """The disk margin of all channels at once at the sampled rate (`measure_disk_margin`).

    Raises `ConfigError` where the plant lacks a port of the law.
    """
    return measure_disk_margin(sample_controlled(plant, compensator), compensator.system, at=at)


def find_sampled_shifts(
    plant: Plant | DelayedPlant,
    compensator: SampledCompensator,
    *,
    modes: Sequence[str] | None = None,
    most: float = 0.2,
    step: float = 0.0025,
) -> tuple[AllowedShift, ...]:
    """The first shift to instability of each mode alone under a sampled law (`find_allowed_shifts`).

    The shifted plant is sampled anew each time, hold and true delay exact: modes beyond half the rate count
    too. Raises `ConfigError` as that does, and where the plant lacks a port of the law.
    """
    return find_allowed_shifts(
        plant,
        compensator.system,
        modes=modes,
        most=most,
        step=step,
        finish=lambda shifted: sample_controlled(shifted, compensator),
    )
