"""A plant behind its sensors' filters, and the noise that white noise leaves in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.sampled.integrals import spread_noise
from middeck.errors import ConfigError
from middeck.joints.simulation import JointElements, add_viscous
from middeck.realtime.sensor_filters import anti_alias, sensor_filter
from middeck.realtime.sensors import Gyro, Sensor
from middeck.systems.modal import ModalSystem, modal_to_statespace
from middeck.systems.plant import Plant
from middeck.systems.statespace import StateSpace


class FilteredPlant(NamedTuple):
    """A plant behind its sensors' filters: torques of the motors, then of the joints; and noise in it."""

    system: StateSpace
    noise: np.ndarray  # root of the intensity of the noise on the states, a column for each
    moved: list[int]  # states of the filters behind it


def filter_outputs(
    plant: Plant,
    inputs: Sequence[str],
    sensors: Sequence[tuple[str, Sensor]],
    joints: Sequence[JointElements],
) -> FilteredPlant:
    """``plant`` with the torques of motors and joints as inputs and what ``sensors`` sample as outputs."""
    dynamics = add_viscous(plant, joints)
    system = modal_to_statespace(dynamics) if isinstance(dynamics, ModalSystem) else dynamics
    columns = [*plant.input_indices(inputs), *plant.input_indices([j.torque for j in joints])]
    B = system.B[:, columns]
    filters = [sensor_filter(sensor) for _, sensor in sensors]
    n, extra = len(system.A), sum(len(f.A) for f in filters)
    A, rows = np.zeros((n + extra, n + extra)), np.zeros((len(filters), n + extra))
    moved: list[int] = []
    A[:n, :n] = system.A
    noise = np.zeros((n + extra, len(filters)))
    first = n
    for o, ((name, sensor), f) in enumerate(zip(sensors, filters, strict=True)):
        c = _reading(plant, system, B, name, sensor)
        last = first + len(f.A)
        A[first:last, :n], A[first:last, first:last] = f.B @ c[None], f.A
        rows[o, :n], rows[o, first:last] = f.D[0, 0] * c, f.C[0]
        if isinstance(sensor, Gyro) and sensor.noise > 0.0:
            into = anti_alias(sensor.anti_alias_hz).B[:, 0]
            noise[last - len(into) : last, o] = sensor.noise * into
            moved += range(last - len(into), last)
        first = last
    padded = np.vstack([B, np.zeros((extra, B.shape[1]))])
    return FilteredPlant(StateSpace(A, padded, rows, np.zeros((len(rows), len(columns)))), noise, moved)


def _reading(plant: Plant, system: StateSpace, B: np.ndarray, name: str, sensor: Sensor) -> np.ndarray:
    """Row of the states that a sensor reads: the output, or for a gyro its rate."""
    row = plant.output_indices([name])[0]
    c = system.C[row]
    steps = np.any(system.D[row]) or (isinstance(sensor, Gyro) and np.any(_at_once(c, B)))
    if steps:
        raise ConfigError(
            f"output {name!r} answers a command at once",
            where="sensors",
            hint="angles of a plant without residual flexibility (static=False)",
        )
    return c @ system.A if isinstance(sensor, Gyro) else c


def _at_once(c: np.ndarray, B: np.ndarray) -> np.ndarray:
    """c B beyond rounding: what an angle's rate would jump by."""
    return np.abs(c @ B) > 1e-12 * (np.abs(c) @ np.abs(B))


def sample_noise(
    filtered: FilteredPlant, period_s: float, looks: Mapping[int, float]
) -> Float[np.ndarray, "row white"]:
    """Square root of the covariance that white noise leaves in a tick.

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
