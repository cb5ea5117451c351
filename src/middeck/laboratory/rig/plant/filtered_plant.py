"""A plant behind its sensors' filters, and the filtered white noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.control.shaping.leads_and_notches import roll_off
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements, add_viscous
from middeck.laboratory.rig.parts.sensors import Gyro, Sampler, Sensor, is_summed
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace, gain_system, series


def sensor_filter(sensor: Sensor) -> StateSpace:
    """From the quantity read (for a gyro the rate) to the sampled one; states of the lag, then the filter."""
    gain = gain_system(np.array([[1.0 if isinstance(sensor, Sampler) else sensor.gain]]))
    if not isinstance(sensor, Gyro):
        return gain
    return series(gain, series(low_pass(sensor.bandwidth_hz, 1), low_pass(sensor.anti_alias_hz, 2)))


def low_pass(frequency_hz: float, order: int) -> StateSpace:
    """Butterworth's filter of this order, or nothing for an infinite frequency."""
    return gain_system(np.ones((1, 1))) if math.isinf(frequency_hz) else roll_off(frequency_hz, order)


class FilteredPlant(NamedTuple):
    """From the torques of the motors, then of the joints, to sampled outputs; and the noise in the filters.

    ``noise`` is the root of its intensity on the states, one column for each sensor; ``moved`` are the states
    of the filters behind it.
    """

    system: StateSpace
    noise: np.ndarray
    moved: list[int]


def filter_outputs(
    plant: Plant,
    inputs: Sequence[str],
    sensors: Sequence[tuple[str, Sensor]],
    joints: Sequence[JointElements],
) -> FilteredPlant:
    """``plant`` with the torques of motors and joints as inputs and the samples of ``sensors`` as outputs."""
    columns = plant.input_indices([*inputs, *(j.torque for j in joints)])
    rows = plant.output_indices([name for name, _ in sensors])
    system = add_viscous(plant, joints).select(columns, rows)
    filters = [sensor_filter(sensor) for _, sensor in sensors]
    n, extra = len(system.A), sum(len(f.A) for f in filters)
    A, C = np.zeros((n + extra, n + extra)), np.zeros((len(filters), n + extra))
    B, D = np.zeros((n + extra, system.B.shape[1])), np.zeros(system.D.shape)
    moved: list[int] = []
    A[:n, :n], B[:n] = system.A, system.B
    noise = np.zeros((n + extra, len(filters)))
    first = n
    for o, ((name, sensor), f) in enumerate(zip(sensors, filters, strict=True)):
        c, d, jump = _reading(system, o, is_summed(sensor))
        if np.any(jump) and np.any(f.D):
            raise ConfigError(
                f"output {name!r} answers a command at once: its rate is infinite",
                where="sensors",
                hint="a gyro with a finite bandwidth_hz or anti_alias_hz, or no direct term (static=False)",
            )
        last = first + len(f.A)
        # Behind a filter a jump of the angle is a jump of its states: they are counted from there.
        A[first:last, :n], A[first:last, first:last] = f.B @ c[None], f.A
        B[first:last] = f.B @ d[None] + f.A @ f.B @ jump[None]
        C[o, :n], C[o, first:last] = f.D[0, 0] * c, f.C[0]
        D[o] = f.D[0, 0] * d + f.C[0] @ f.B * jump
        if isinstance(sensor, Gyro) and sensor.noise > 0.0:
            into = low_pass(sensor.anti_alias_hz, 2).B[:, 0]
            noise[last - len(into) : last, o] = sensor.noise * into
            moved += range(last - len(into), last)
        first = last
    return FilteredPlant(StateSpace(A, B, C, D), noise, moved)


def _reading(system: StateSpace, output: int, rate: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of states, inputs and rates of inputs that a sensor reads: the output c x + d u, or its rate."""
    c, d = system.C[output], system.D[output]
    if not rate:
        return c, d, 0.0 * d
    at_once = c @ system.B
    # Rounding of an angle's rows is no response.
    rounding = 1e-12 * (np.abs(c) @ np.abs(system.B))
    return c @ system.A, np.where(np.abs(at_once) > rounding, at_once, 0.0), d


def sample_noise(
    filtered: FilteredPlant, period_s: float, looks: Mapping[int, float]
) -> Float[np.ndarray, "row white"]:
    """Square root of the covariance of white noise filtered over a tick.

    Of the filters' states at its end, and below them of the outputs that are sampled within it: ``looks`` has
    the instant [s] of each. Sample and state share the noise until then. Filters share none: what the states
    leave open of a sample is its own.
    """
    moved = filtered.moved
    A, G = filtered.system.A[np.ix_(moved, moved)], filtered.noise[moved]
    root = np.zeros((len(moved) + len(looks),) * 2)
    states = np.linalg.cholesky(spread_noise(A, G @ G.T, period_s).covariance)
    root[: len(moved), : len(moved)] = states
    for row, (output, at_s) in enumerate(looks.items(), len(moved)):
        seen = filtered.system.C[output, moved]
        covariance = spread_noise(A, G @ G.T, at_s).covariance @ seen
        crossed = np.asarray(sla.expm(A * (period_s - at_s))) @ covariance
        shared = np.linalg.solve(states, crossed)
        root[row, : len(moved)] = shared
        root[row, row] = np.sqrt(max(seen @ covariance - shared @ shared, 0.0))
    return root
