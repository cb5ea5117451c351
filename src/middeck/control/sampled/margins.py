"""Margins of a sampled loop at its own rate: of L(exp(j w T)), hold and true delay included."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from middeck.control.analysis import (
    AllowedShift,
    DiskMargin,
    LoopMargins,
    Margins,
    decide_stability,
    find_allowed_shifts,
    measure_disk_margin,
    measure_margins,
)
from middeck.control.analysis.loop import At
from middeck.control.kinds import require_sampled
from middeck.control.partition import partition_modes
from middeck.control.sampled.delay_margin import find_delay_limit
from middeck.control.sampled_compensator import SampledCompensator
from middeck.systems.delayed_plant import DelayedPlant
from middeck.systems.delayed_sampling import sample_delayed
from middeck.systems.plant import Plant, subsystem
from middeck.systems.statespace import SampledStateSpace, StateSpace

T = TypeVar("T")


def sample_controlled(plant: Plant | DelayedPlant, compensator: SampledCompensator) -> SampledStateSpace:
    """What the law sees: from its outputs, held, to its inputs, sampled, each path late by its true delay.

    Beside ``compensator.system`` this is what `middeck.control.analysis` takes for a sampled loop. Raises
    `ConfigError` where the plant lacks a port of the law.
    """
    require_sampled(compensator)
    system, late = _controlled_path(plant, compensator)
    return sample_delayed(system, compensator.period_s, late)


def _controlled_path(
    plant: Plant | DelayedPlant, compensator: SampledCompensator
) -> tuple[StateSpace, Float[np.ndarray, "y u"]]:
    """From the law's outputs to its inputs, and how late each of these paths is."""
    inside = plant.plant if isinstance(plant, DelayedPlant) else plant
    u, y = (tuple(p.name for p in side) for side in (compensator.outputs, compensator.inputs))
    rows, columns = inside.output_indices(y), inside.input_indices(u)
    late = (
        plant.delay_s[np.ix_(rows, columns)]
        if isinstance(plant, DelayedPlant)
        else np.zeros((len(y), len(u)))
    )
    return subsystem(partition_modes(inside).active, u, y), late


def measure_sampled_margins(
    plant: Plant | DelayedPlant, compensator: SampledCompensator, *, at: At = "inputs", delays: bool = True
) -> Margins:
    """Gain, phase, delay and disk margins of each loop at the sampled rate, the others closed.

    A gain is margin for the loop as it runs: what the hold and the delays cost is in it already. The delay is
    the least at which the loop, its plant sampled anew with that channel so much later, is unstable
    (`middeck.control.sampled.delay_margin`): most of the work, left out with ``delays=False``. Raises
    `ConfigError` where the plant lacks a port of the law.
    """
    found = measure_margins(sample_controlled(plant, compensator), compensator.system, at=at)
    u, y = (tuple(p.name for p in side) for side in (compensator.outputs, compensator.inputs))
    loops = [
        dataclasses.replace(loop, channel=name)
        for loop, name in zip(found.loops, _by_channel(u, y, at), strict=True)
    ]
    if delays:
        masks = _by_channel(list(np.eye(len(u))[:, None, :]), list(np.eye(len(y))[:, :, None]), at)
        loops = [
            dataclasses.replace(loop, delay_s=_delay_limits(plant, compensator, loop, mask))
            for loop, mask in zip(loops, masks, strict=True)
        ]
    return dataclasses.replace(found, loops=tuple(loops))


def _by_channel(inputs: Sequence[T], outputs: Sequence[T], at: At) -> list[T]:
    return [*(inputs if at != "outputs" else ()), *(outputs if at != "inputs" else ())]


def _delay_limits(
    plant: Plant | DelayedPlant,
    compensator: SampledCompensator,
    loop: LoopMargins,
    later: Float[np.ndarray, "y u"],
) -> Float[np.ndarray, " delay"]:
    """The first alone, if there is one; ``later`` is one where the channel is."""
    if loop.broken:
        return np.zeros(0)
    (system, late), period = _controlled_path(plant, compensator), compensator.period_s

    def stable_at(more_s: float) -> bool:
        return decide_stability(
            sample_delayed(system, period, late + more_s * later), compensator.system
        ).stable

    lag = np.mod(loop.phase_rad, 2.0 * np.pi) / (2.0 * np.pi * loop.phase_hz)
    first = find_delay_limit(stable_at, system, period, float(lag.min(initial=np.inf)))
    return np.array([first]) if np.isfinite(first) else np.zeros(0)


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
