"""The digital side of a hybrid simulation: adding up of gyro samples, and the law, as one sampled system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.realtime.law import check_law
from middeck.realtime.sensors import Gyro, Sensor
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record


@record
class Computer:
    """From what the converters give to measured outputs and the law's commands, once a tick.

    ``step`` takes (states, readings) to (states of the next tick, measured outputs, commands). The states are
    one sum for each gyro, then the law's.
    """

    step: Float[np.ndarray, "row column"]
    states: int
    outputs: int
    commands: int


def build_computer(
    sensors: Sequence[Sensor], law: SampledStateSpace | None, inputs: int, period_s: float
) -> Computer:
    """The computer of a rig with ``sensors`` and ``inputs`` motors; without a law it commands nothing.

    A gyro's samples r are added up by the trapezoidal rule, which turns no phase. Raises `ConfigError` for a
    law of other sizes or another period.
    """
    outputs = len(sensors)
    law = _no_law(inputs, outputs, period_s) if law is None else law
    check_law(law, inputs, outputs, period_s)
    sums = integrators(sensors, period_s)
    A = np.asarray(sla.block_diag(sums.A, law.A))
    A[len(sums.A) :, : len(sums.A)] = law.B @ sums.C
    B = np.vstack([sums.B, law.B @ sums.D])
    measured = np.hstack([sums.C, np.zeros((outputs, len(law.A))), sums.D])
    command = np.hstack([law.D @ sums.C, law.C, law.D @ sums.D])
    return Computer(np.vstack([np.hstack([A, B]), measured, command]), len(A), outputs, inputs)


def integrators(sensors: Sequence[Sensor], period_s: float) -> SampledStateSpace:
    """Readings to measured outputs: y = s + T/2 r with s[k+1] = s + T r for a gyro, y = r for the others.

    >>> from middeck.realtime.sensors import Encoder
    >>> integrators([Encoder(0.1), Gyro()], 0.5).D.tolist()
    [[1.0, 0.0], [0.0, 0.25]]
    """
    gyro = np.array([isinstance(s, Gyro) for s in sensors], dtype=bool)
    select = np.eye(len(sensors))[gyro]
    n = len(select)
    D = np.diag(np.where(gyro, 0.5 * period_s, 1.0))
    return SampledStateSpace(np.eye(n), period_s * select, select.T, D, period_s=period_s)


def _no_law(inputs: int, outputs: int, period_s: float) -> SampledStateSpace:
    return SampledStateSpace(
        np.zeros((0, 0)),
        np.zeros((0, outputs)),
        np.zeros((inputs, 0)),
        np.zeros((inputs, outputs)),
        period_s=period_s,
    )
