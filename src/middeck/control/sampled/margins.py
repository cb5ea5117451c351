"""Margins of a sampled loop at its own rate: of L(exp(j w T)), hold and true delay included."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from middeck.control.analysis import (
    AllowedShift,
    DiskMargin,
    Margins,
    find_allowed_shifts,
    measure_disk_margin,
    measure_margins,
)
from middeck.control.analysis.crossings import circle_crossings
from middeck.control.analysis.lines import place_lines, refine_lines
from middeck.control.analysis.loop import At, form_loop
from middeck.control.analysis.return_ratio import broken_ratio
from middeck.control.analysis.stability import decide_loop
from middeck.control.law.kinds import require_sampled
from middeck.control.law.partition import partition_modes
from middeck.control.law.sampled_compensator import SampledCompensator
from middeck.control.sampled.delay_margin import UnitGain, find_delay_limit
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
        limits = _delay_limits(plant, compensator, at) if found.stable else [0.0] * len(loops)
        loops = [
            dataclasses.replace(loop, delay_s=np.array([limit] if 0.0 < limit < np.inf else []))
            for loop, limit in zip(loops, limits, strict=True)
        ]
    return dataclasses.replace(found, loops=tuple(loops))


def _by_channel(inputs: Sequence[T], outputs: Sequence[T], at: At) -> list[T]:
    return [*(inputs if at != "outputs" else ()), *(outputs if at != "inputs" else ())]


def _delay_limits(plant: Plant | DelayedPlant, compensator: SampledCompensator, at: At) -> list[float]:
    """Of each channel alone; ``inf`` where there is none."""
    system, late = _controlled_path(plant, compensator)
    columns, rows = np.eye(late.shape[1])[:, None, :], np.eye(late.shape[0])[:, :, None]
    limits: list[float] = []
    ends: tuple[At, ...] = ("inputs", "outputs") if at == "both" else (at,)
    for end in ends:
        loop = form_loop(sample_delayed(system, compensator.period_s, late), compensator.system)
        lines = place_lines(loop, end, broken_ratio(loop, end))
        for i, later in enumerate(columns if end == "inputs" else rows):
            gain_at = functools.partial(_unit_gain, system, late, later, compensator, (end, i), lines)
            limits.append(find_delay_limit(gain_at, system, compensator.period_s))
    return limits


def _unit_gain(
    system: StateSpace,
    late: np.ndarray,
    later: np.ndarray,
    compensator: SampledCompensator,
    where: tuple[At, int],
    lines: np.ndarray,
    part: float,
) -> UnitGain:
    """The loop with one channel ``part`` of a period later; ``later`` is one where the channel is."""
    period = compensator.period_s
    loop = form_loop(sample_delayed(system, period, late + part * period * later), compensator.system)
    end, i = where
    ratio = broken_ratio(loop, end)

    def alone(s: np.ndarray) -> np.ndarray:
        return ratio(s)[:, [i]]

    omega, L = refine_lines(alone, lines)
    found = circle_crossings(alone, omega, L)
    order = np.argsort(found.omega, kind="stable")
    above = np.abs(L[:, 0]) > 1.0
    return UnitGain(
        decide_loop(loop).growing,
        found.omega[order] * period,
        np.mod(np.angle(found.L[order]) + np.pi, 2.0 * np.pi),
        (np.arange(len(order)) % 2 == 0) == bool(above[0]),
        bool(above[-1]),
    )


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
