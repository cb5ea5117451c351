"""The digital side of a rig: the compensator by its ports, and the sums of gyro samples beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.law.compensator import Compensator, locate_ports
from middeck.errors import ConfigError
from middeck.laboratory.rig.parts.sensors import Sensor, is_summed
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace, same_period
from middeck.values import record


@record
class Computer:
    """From converter readings to measured outputs and the compensator's commands, once a tick.

    ``step`` takes (states, readings) to (states of the next tick, measured outputs, commands). The states are
    one sum for each gyro, then the compensator's.
    """

    step: Float[np.ndarray, "row column"]
    states: int
    outputs: int
    commands: int


def build_computer(sensors: Sequence[Sensor], law: SampledStateSpace) -> Computer:
    """The computer of a rig with ``sensors``; ``law`` goes from all its outputs to all inputs.

    A gyro's samples r are added up by the trapezoidal rule, which turns no phase.
    """
    outputs, inputs = len(sensors), len(law.D)
    sums = integrators(sensors, law.period_s)
    A = np.asarray(sla.block_diag(sums.A, law.A))
    A[len(sums.A) :, : len(sums.A)] = law.B @ sums.C
    B = np.vstack([sums.B, law.B @ sums.D])
    measured = np.hstack([sums.C, np.zeros((outputs, len(law.A))), sums.D])
    command = np.hstack([law.D @ sums.C, law.C, law.D @ sums.D])
    return Computer(np.vstack([np.hstack([A, B]), measured, command]), len(A), outputs, inputs)


def integrators(sensors: Sequence[Sensor], period_s: float) -> SampledStateSpace:
    """Readings to measured outputs: y = s + T/2 r with s[k+1] = s + T r for a gyro at an angle, y = r
    for the others.

    >>> from middeck.laboratory.rig.parts.sensors import Encoder, Gyro
    >>> integrators([Encoder(0.1), Gyro()], 0.5).D.tolist()
    [[1.0, 0.0], [0.0, 0.25]]
    """
    summed = np.array([is_summed(s) for s in sensors], dtype=bool)
    select = np.eye(len(sensors))[summed]
    n = len(select)
    D = np.diag(np.where(summed, 0.5 * period_s, 1.0))
    return SampledStateSpace(np.eye(n), period_s * select, select.T, D, period_s=period_s)


def place_law(
    law: Compensator | None, inputs: Sequence[Port], outputs: Sequence[Port], period_s: float
) -> SampledStateSpace:
    """``law`` from all outputs to all inputs of a rig of this period; None commands nothing.

    A compensator finds its ports by name and leaves other inputs at rest. Raises `ConfigError` for ports that
    the rig lacks or has in another unit, another period, or a compensator that is not sampled.

    >>> y, u = Port("y", "rad"), Port("u", "N m")
    >>> lag = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[-2.0]], period_s=0.1)
    >>> place_law(Compensator(lag, (y,), (u,)), (Port("v", "N m"), u), (y,), 0.1).D.tolist()
    [[0.0], [-2.0]]
    """
    if law is None:
        p, m = len(outputs), len(inputs)
        return SampledStateSpace(
            np.zeros((0, 0)), np.zeros((0, p)), np.zeros((m, 0)), np.zeros((m, p)), period_s=period_s
        )
    rows, columns = locate_ports(law, inputs, outputs, "rig")
    into, out = np.eye(len(outputs))[columns], np.eye(len(inputs))[:, rows]
    s = law.sampled
    if not same_period(s.period_s, period_s):
        raise ConfigError(
            f"the compensator is sampled at {s.period_s} s, the rig at {period_s} s",
            hint="emulate(compensator, period_s) of the continuous design has the rig's period",
        )
    return SampledStateSpace(s.A, s.B @ into, out @ s.C, out @ s.D @ into, period_s=period_s)
