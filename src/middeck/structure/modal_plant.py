"""From modes to a plant: modal input and output matrices at the article's named actuators and sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.article import Damping, JointState, Sensor
from middeck.structure.frames import PosePoints, frame_poses, pose_jacobian
from middeck.structure.mesh import Model
from middeck.structure.modes import Modes
from middeck.systems.modal import ModalSystem
from middeck.systems.plant import Plant
from middeck.systems.ports import Port

RATE = "_rate"


def build_plant(
    modes: Modes,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int = 26,
    damping: Damping | None = None,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The lowest ``count`` modes between named actuators [N m] and sensors [rad, with suffix _rate rad/s].

    Sensor and actuator axes turn with their bodies: both are linearised at the equilibrium. ``damping``
    defaults to the article's. Raises `ConfigError` for an unknown port or a torque at a fixed axis.
    """
    damping = modes.equilibrium.model.structure.damping if damping is None else damping
    count = min(count, len(modes.omega))
    ratio = {"rigid": damping.rigid, "suspension": damping.suspension, "flexible": damping.flexible}
    shapes = modes.shapes[:, :count]
    columns = np.array([_actuator_column(modes, name) for name in inputs]).reshape(-1, len(shapes))
    readings = [_split_rate(modes, name) for name in outputs]
    rows = np.array([_sensor_row(modes, sensor) for sensor, _ in readings]).reshape(-1, len(shapes)) @ shapes
    rate = np.array([is_rate for _, is_rate in readings], dtype=bool)
    dynamics = ModalSystem(
        modes.omega[:count],
        np.array([ratio[k] for k in modes.kind[:count]]),
        shapes.T @ columns.T,
        np.where(rate[:, None], 0.0, rows),
        np.where(rate[:, None], rows, 0.0),
        modes.name[:count],
    )
    return Plant(
        dynamics,
        tuple(Port(n, "N m") for n in inputs),
        tuple(Port(n, "rad/s" if r else "rad") for n, r in zip(outputs, rate, strict=True)),
        tuple(w),
        tuple(u),
        tuple(z),
        tuple(y),
    )


def _split_rate(modes: Modes, output: str) -> tuple[str, bool]:
    """Sensor of an output and whether its rate is meant; a sensor may itself be called ``turn_rate``."""
    is_sensor = any(s.name == output for s in modes.equilibrium.model.structure.sensors)
    return (output, False) if is_sensor else (output.removesuffix(RATE), output.endswith(RATE))


def _actuator_column(modes: Modes, name: str) -> Float[np.ndarray, " coordinate"]:
    """Generalised force of a unit torque."""
    actuators = {a.name: a for a in modes.equilibrium.model.structure.actuators}
    if name not in actuators:
        raise ConfigError(f"no actuator {name!r}", hint=f"one of {', '.join(actuators)}")
    actuator = actuators[name]
    if actuator.axis is None:
        return _joint_row(modes, actuator.frame, f"actuator {name!r}")
    return _rotation_row(modes, actuator.frame, actuator.frame, actuator.axis)


def _sensor_row(modes: Modes, name: str) -> Float[np.ndarray, " coordinate"]:
    """Angle per unit coordinate."""
    sensors: dict[str, Sensor] = {s.name: s for s in modes.equilibrium.model.structure.sensors}
    if name not in sensors:
        known = ", ".join(f"{s}, {s}{RATE}" for s in sensors)
        raise ConfigError(f"no sensor {name!r}", hint=f"one of {known}")
    sensor = sensors[name]
    if sensor.axis is None:
        return _joint_row(modes, sensor.frame, "")
    return _rotation_row(modes, sensor.frame, sensor.axis_frame or sensor.frame, sensor.axis)


def _joint_row(modes: Modes, joint: str, torque_at: str) -> Float[np.ndarray, " coordinate"]:
    model = modes.equilibrium.model
    index = [j.name for j in model.structure.joints].index(joint)
    if torque_at and model.structure.joints[index].state in (JointState.LOCKED, JointState.DRIVEN):
        raise ConfigError(
            f"{torque_at} turns axis {joint!r}, which is {model.structure.joints[index].state.value}",
            hint="set the axis free or sprung, or leave this input out",
        )
    row = np.zeros(model.tree.size)
    row[6 * model.tree.roots + index] = 1.0
    return row


def _rotation_row(
    modes: Modes, frame: str, axis_frame: str, axis: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " coordinate"]:
    """World rotation of ``frame`` about an axis fixed to ``axis_frame``, per coordinate."""
    model: Model = modes.equilibrium.model
    poses = frame_poses(model.tree, modes.equilibrium.config)
    index = model.frames.index(frame)
    J = pose_jacobian(model.tree, PosePoints(np.array([index]), np.zeros((1, 3))), poses)
    world_axis = poses.R[model.frames.index(axis_frame)] @ axis
    return np.asarray(J.toarray()[3:].T @ world_axis)
