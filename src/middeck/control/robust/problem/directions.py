"""Uncertain modes as feedback of unknown gain: A + sum of B0_i delta_i C0_i.

A mode's frequency moves by its stiffness, omega^2 (1 + delta), which enters where the mode is pushed: B0 is
that direction of its two states and C0 reads q, so that C0 B0 = 0. A shift that keeps the damping ratio
(`shift_modes`) moves 2 zeta omega as well, by as much as the frequency: the same B0, and a C0 that reads q'.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from middeck.control.law.partition import partition_modes, set_inert_aside
from middeck.control.law.uncertainty import Uncertainty, finished_plants, without_delays
from middeck.errors import ConfigError
from middeck.systems.plants.mode_blocks import unmix_states
from middeck.systems.plants.mode_shift import mode_coordinates, mode_states
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.poles.modal_states import MIXED
from middeck.systems.state_space.statespace import poles
from middeck.values import record

BESIDE = (0.77, 1.31)
"""Relative frequencies beside each pole at which two plants are compared: near modes, but not on them."""
MISSED, ROUNDING = 1e-6, 1e-9
"""Parts of what a shift changes, and of the response, by which they may differ."""


@record(kw_only=True)
class Directions:
    """Input column and output row of each uncertain parameter.

    Attributes:
        into, out: B0 and C0 on the states of the finished plant, without its inert modes.
        low, high: Bounds of each delta: (1 -+ half-width)^2 - 1 of a stiffness, -+ half-width of a damping.
        group: Index of the shift in `Uncertainty` of each.
        stiff: Whether each is a stiffness; otherwise a damping.
    """

    into: Float[np.ndarray, "state delta"]
    out: Float[np.ndarray, "delta state"]
    low: Float[np.ndarray, " delta"]
    high: Float[np.ndarray, " delta"]
    group: tuple[int, ...]
    stiff: Bool[np.ndarray, " delta"]


def shift_directions(plant: Plant, finished: Plant, uncertainty: Uncertainty) -> Directions:
    """Directions of stiffnesses, then of the dampings tied to them, each free within its bounds.

    Raises `ConfigError` as `stiffness_directions`, and where a shift changes more of the plant: outputs that
    read the acceleration of an uncertain mode.
    """
    found = stiffness_directions(plant, finished, uncertainty, damped=True)
    for end in (-1.0, 1.0):
        _require_whole(plant, finished, uncertainty, found, end)
    return found


def stiffness_directions(
    plant: Plant, finished: Plant, uncertainty: Uncertainty, *, damped: bool = False
) -> Directions:
    """Stiffness directions of the modes in ``uncertainty.shifts``, and if ``damped`` those of their dampings;
    ``finished`` is the nominal plant controlled.

    Raises `ConfigError` where a mode has not its two states in both, or nothing but these is uncertain.
    """
    if not uncertainty.shifts:
        raise ConfigError("no mode is uncertain: this method needs shifts", hint="Uncertainty(shifts=...)")
    # Plant and finished plant may be computed in other units.
    bare, part = remove_delays(set_inert_aside(plant).active), partition_modes(finished)
    active = part.active
    if unmix_states(active)[1] > MIXED:
        raise ConfigError(
            "the plant's states are mixed: those that bear a mode's name are not its coordinates",
            hint="part_modes(plant) gives each mode states of its own",
        )
    before, after = name_states(bare), name_states(active)
    rows: list[tuple[np.ndarray, np.ndarray, float, float, int]] = []
    dampings: list[tuple[np.ndarray, np.ndarray, float, float, int]] = []
    for group, shift in enumerate(uncertainty.shifts):
        h = shift.half_width
        for mode in shift.modes:
            at = mode_coordinates(bare.system.A, bare.system.B, mode_states(before, mode), mode)
            into, q, rate = (np.zeros(len(after)) for _ in range(3))
            index = mode_states(after, mode)
            into[index], q[index], rate[index] = at.push, at.position, at.rate
            rows.append((into, -(at.omega**2) * q, (1.0 - h) ** 2 - 1.0, (1.0 + h) ** 2 - 1.0, group))
            if damped and at.zeta:
                dampings.append((into, -2.0 * at.zeta * at.omega * rate, -h, h, group))
    columns, out, low, high, group = zip(*rows, *dampings, strict=True)
    stiff = np.arange(len(group)) < len(rows)
    unit = np.ones(len(after)) if part.unit is None else part.unit
    return Directions(
        into=np.array(columns).T / unit[:, None],
        out=np.array(out) * unit,
        low=np.array(low),
        high=np.array(high),
        group=group,
        stiff=stiff,
    )


def _require_whole(
    plant: Plant, finished: Plant, uncertainty: Uncertainty, found: Directions, end: float
) -> None:
    """Check that the directions reproduce the plant at an end of the box."""
    box = Uncertainty(shifts=uncertainty.shifts, finish=uncertainty.finish)
    there = finished_plants(plant, box, np.full((1, len(box.shifts)), end))[0]
    meant, nominal = (partition_modes(without_delays(p)).active for p in (there, finished))
    delta = found.low if end < 0.0 else found.high
    A = nominal.system.A + found.into @ (delta[:, None] * found.out)
    made = dataclasses.replace(nominal, dynamics=dataclasses.replace(nominal.system, A=A))
    f = np.outer(BESIDE, np.abs(poles(nominal.system)) / (2.0 * np.pi)).ravel()
    columns = nominal.input_indices((*nominal.w, *nominal.u))
    for port in (*nominal.z, *nominal.y):
        have, want, before = (
            evaluate_plant(p, f[f > 0.0]).H[:, p.output_indices((port,))[0]][:, columns]
            for p in (made, meant, nominal)
        )
        moved, size = np.abs(want - before).max(), np.abs(want).max()
        if np.abs(have - want).max() > MISSED * moved + ROUNDING * size:
            modes = ", ".join(mode for shift in uncertainty.shifts for mode in shift.modes)
            raise ConfigError(
                f"a shift of {modes} changes {port} by more than stiffness and damping: no bound holds",
                hint="an angle or a rate instead of an acceleration, or design_multimodel",
            )
