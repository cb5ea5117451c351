"""A plant and a compensator, joined; and the same join made line by line on frequency responses."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.control.law.compensator import Compensator, idle_compensator
from middeck.control.law.kinds import require_continuous, require_rational
from middeck.control.law.partition import partition_modes
from middeck.errors import ConfigError
from middeck.signals.ports import Port, port_indices
from middeck.systems.plant import Plant, name_states
from middeck.systems.response import FrequencyResponse
from middeck.systems.stability import growth_rates, none_grows
from middeck.systems.statespace import StateSpace
from middeck.values import record


@record
class ClosedLoop:
    """From w to z with the compensator at work; unstable is an expected outcome, not an error.

    Parameters
    ----------
    system:
        States: the plant's, then the compensator's.
    inputs, outputs:
        The plant's groups w and z.
    state_names:
        What each plant state belongs to; the states beyond are the compensator's.
    poles:
        Eigenvalues [rad/s].
    stable:
        No pole grows (`middeck.systems.stability`); a free body that merely drifts counts as stable.
    inert:
        Modes of the plant that no port reaches or sees: in no transfer function, and not in ``system``.
    """

    system: StateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    state_names: tuple[str, ...]
    poles: Complex[np.ndarray, " state"]
    stable: bool
    inert: tuple[str, ...]


def close_loop(plant: Plant, compensator: Compensator) -> ClosedLoop:
    """Join them by port name; the compensator's output is added at the plant's input.

    Raises `ConfigError` where the plant lacks a port of the compensator or the loop through the direct
    terms has no solution.
    """
    require_continuous(compensator)
    part = partition_modes(plant)
    active, law = part.active, compensator.system
    system = active.system
    w, z = active.input_indices(active.w), active.output_indices(active.z)
    u = active.input_indices([p.name for p in compensator.outputs])
    y = active.output_indices([p.name for p in compensator.inputs])
    joined = _join(
        system.A, system.B[:, w], system.B[:, u], system.C[z], system.C[y], _direct(system.D, w, u, z, y), law
    )
    values = growth_rates(joined)
    return ClosedLoop(
        joined,
        tuple(active.inputs[i] for i in w),
        tuple(active.outputs[i] for i in z),
        name_states(active),
        values,
        none_grows(values),
        part.inert,
    )


def leave_open(plant: Plant) -> ClosedLoop:
    """The plant from w to z under no control but its own."""
    require_rational(plant)
    return close_loop(plant, idle_compensator(plant))


def _direct(D: np.ndarray, w: list[int], u: list[int], z: list[int], y: list[int]) -> tuple[np.ndarray, ...]:
    return D[np.ix_(z, w)], D[np.ix_(z, u)], D[np.ix_(y, w)], D[np.ix_(y, u)]


def _join(
    A: np.ndarray,
    Bw: np.ndarray,
    Bu: np.ndarray,
    Cz: np.ndarray,
    Cy: np.ndarray,
    direct: tuple[np.ndarray, ...],
    law: StateSpace,
) -> StateSpace:
    Dzw, Dzu, Dyw, Dyu = direct
    loop = np.eye(len(law.D)) - law.D @ Dyu
    # 1e-12: the algebraic loop would amplify rounding to a thousandth.
    if len(loop) and np.linalg.cond(loop) > 1e12:
        raise ConfigError("the loop through the direct terms has no solution", hint="add a delay or a lag")
    M = np.linalg.inv(loop)
    # u = Fp x + Fc xc + Fw w and y = Cy x + Dyu u + Dyw w, solved for u.
    Fp, Fc, Fw = M @ law.D @ Cy, M @ law.C, M @ law.D @ Dyw
    return StateSpace(
        np.block([[A + Bu @ Fp, Bu @ Fc], [law.B @ (Cy + Dyu @ Fp), law.A + law.B @ Dyu @ Fc]]),
        np.vstack([Bw + Bu @ Fw, law.B @ (Dyw + Dyu @ Fw)]),
        np.hstack([Cz + Dzu @ Fp, Dzu @ Fc]),
        Dzw + Dzu @ Fw,
    )


def predict_closed_loop_response(
    plant: FrequencyResponse, compensator: FrequencyResponse
) -> FrequencyResponse:
    """Closed-loop response from all plant inputs to all plant outputs, line by line, delay exact.

    With G_u, G_y the columns and rows the compensator drives and reads, T = G + G_u (I - K G_yu)^-1 K G_y;
    for one input and output T = G / (1 - G K). Says nothing about stability. Raises `ConfigError` where the
    lines differ or a port does not exist.
    """
    if not np.array_equal(plant.frequency_hz, compensator.frequency_hz):
        raise ConfigError(
            "plant and compensator are given on different lines", hint="evaluate both on one grid"
        )
    u = port_indices(plant.inputs, [p.name for p in compensator.outputs], "input")
    y = port_indices(plant.outputs, [p.name for p in compensator.inputs], "output")
    G, K = plant.H, compensator.H
    return_difference = np.eye(len(u)) - K @ G[:, y][:, :, u]
    T = G + G[:, :, u] @ np.linalg.solve(return_difference, K @ G[:, y])
    return FrequencyResponse(plant.frequency_hz, T, plant.inputs, plant.outputs)
