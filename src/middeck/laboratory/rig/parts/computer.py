"""The digital side of a rig: the sums of gyro samples, and the compensator, as one sampled system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.laboratory.rig.parts.sensors import Sensor, is_summed
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record


@record
class Computer:
    """From what the converters give to measured outputs and the compensator's commands, once a tick.

    ``step`` takes (states, readings) to (states of the next tick, measured outputs, commands). The states are
    one sum for each gyro, then the compensator's.
    """

    step: Float[np.ndarray, "row column"]
    states: int
    outputs: int
    commands: int


def build_computer(sensors: Sequence[Sensor], law: SampledStateSpace) -> Computer:
    """The computer of a rig with ``sensors``, from all of whose outputs ``law`` goes to all inputs.

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
