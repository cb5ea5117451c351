"""Closed loops of plant and compensator, as systems or as frequency responses line by line."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator, idle_compensator, locate_ports, require_loop
from middeck.control.law.partition import set_inert_aside
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.plants.response import FrequencyResponse
from middeck.systems.poles.stability import growth_rates, none_grows
from middeck.systems.poles.verdict import warn_if_open
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record(kw_only=True)
class ClosedLoop:
    """Closed loop from w to z; an unstable loop is an outcome, not an error.

    Attributes:
        system: States: the plant's, then the compensator's.
        inputs, outputs: The plant's groups w and z.
        state_names: Mode or part of each plant state; the remaining states are the compensator's.
        poles: Eigenvalues [rad/s].
        stable: No pole grows (`middeck.systems.poles.stability`); a free body that merely drifts counts as
            stable, a loop that rounding leaves undecided does not.
        inert: Uncontrollable and unobservable modes of the plant, which ``system`` leaves out.
    """

    system: StateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    state_names: tuple[str, ...]
    poles: Complex[np.ndarray, " state"]
    stable: bool
    inert: tuple[str, ...]


@named_kinds
def close_loop(plant: Plant, compensator: Compensator) -> ClosedLoop:
    """Closed loop, joined by port names; the compensator's output is added at the plant's input.

    Raises `ConfigError` where the plant lacks a port of the compensator, or has it in another unit, or where
    the loop through the direct terms has no solution. Warns (`UserWarning`) where rounding leaves its
    stability open, which `decide_stability` refuses.
    """
    require_loop(plant, compensator)
    part = set_inert_aside(plant)
    active, law = part.active, compensator.system
    w, z = active.input_indices(active.w), active.output_indices(active.z)
    u, y = locate_ports(compensator, active.inputs, active.outputs)
    joined = feedback(active.system, law, u, y).select(w, z)
    values = growth_rates(joined)
    stable = not warn_if_open(joined, active.system, law, stacklevel=4) and none_grows(values)
    return ClosedLoop(
        system=joined,
        inputs=tuple(active.inputs[i] for i in w),
        outputs=tuple(active.outputs[i] for i in z),
        state_names=name_states(active),
        poles=values,
        stable=stable,
        inert=part.inert,
    )


@named_kinds
def leave_open(plant: Plant) -> ClosedLoop:
    """The plant from w to z without a compensator."""
    return close_loop(plant, idle_compensator(plant))


def predict_closed_loop_response(
    plant: FrequencyResponse, compensator: FrequencyResponse
) -> FrequencyResponse:
    """Closed-loop response from all plant inputs to all plant outputs, line by line, delay exact.

    With G_u, G_y the columns and rows the compensator drives and reads, T = G + G_u (I - K G_yu)^-1 K G_y;
    for one input and output T = G / (1 - G K). Says nothing about stability. Raises `ConfigError` where the
    lines differ, a port does not exist, or its units differ.
    """
    if not np.array_equal(plant.frequency_hz, compensator.frequency_hz):
        raise ConfigError(
            "plant and compensator have different frequency lines", hint="evaluate both on one grid"
        )
    held, period = plant.hold_s, compensator.hold_s
    if held is not None and period is not None and held != period:
        raise ConfigError(
            f"the plant's response has a hold of {held:g} s, the compensator's period is {period:g} s",
            hint="sample_plant(plant, period_s) for a sampled compensator, both continuous otherwise",
        )
    u, y = locate_ports(compensator, plant.inputs, plant.outputs)
    G, K = plant.H, compensator.H
    return_difference = np.eye(len(u)) - K @ G[:, y][:, :, u]
    T = G + G[:, :, u] @ np.linalg.solve(return_difference, K @ G[:, y])
    return FrequencyResponse(frequency_hz=plant.frequency_hz, H=T, inputs=plant.inputs, outputs=plant.outputs)
