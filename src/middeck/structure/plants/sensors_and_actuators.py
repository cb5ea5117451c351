"""Rows of named actuators and sensors in the coordinates, at rest.

Sensor and actuator axes turn with their bodies, but for that of a displacement, which is a line in W: n . dx
of its point. An accelerometer reads n . (a - g) along an axis n that is
fixed to its frame; about rest, with the small rotation theta of the frame,

    n . a - (theta x n) . g = n . a - theta . (n x g) :

in 0-g acceleration only, in 1-g also g times tilt.

Both are analytic: an equilibrium at complex positions gives complex rows.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Inexact

from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.structure.elements.frames import PosePoints, pose_jacobian
from middeck.structure.model.article import Actuator, ActuatorKind, JointState, Sensor, SensorKind
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.values import record

RATE = "_rate"
NEARLY = 0.8  # ratio of equal letters from which another name may be meant: ports are alike


@record
class InputRows:
    """Generalised force per unit input, one row an input, and the ports."""

    force: Inexact[np.ndarray, "input coordinate"]
    ports: tuple[Port, ...]


@record
class ReadingRows:
    """Reading per unit coordinate, per unit rate and per unit acceleration of it, and the ports."""

    position: Inexact[np.ndarray, "output coordinate"]
    rate: Inexact[np.ndarray, "output coordinate"]
    acceleration: Inexact[np.ndarray, "output coordinate"]
    ports: tuple[Port, ...]


def input_rows(equilibrium: Equilibrium, names: Sequence[str]) -> InputRows:
    """Rows of the actuators ``names``: torques [N m] and forces [N], the latter also along a slide.

    Raises `ConfigError` for an unknown name or a torque at an axis that does not move.
    """
    known = {a.name: a for a in equilibrium.model.structure.actuators}
    for name in names:
        if name not in known:
            raise ConfigError(f"no actuator {name!r}", hint=one_of(known, "[[actuator]]", name))
    chosen = [known[name] for name in names]
    moves = _motions(equilibrium, chosen)
    rows = np.zeros((len(chosen), equilibrium.model.tree.size), moves.dtype)
    for i, actuator in enumerate(chosen):
        if actuator.axis is None:
            _check_moves(equilibrium, actuator)
            rows[i] = _joint_row(equilibrium, actuator.frame)
        else:
            part = slice(0, 3) if actuator.kind is ActuatorKind.FORCE else slice(3, 6)
            rows[i] = _world_axis(equilibrium, actuator.frame, actuator.axis) @ moves[i, part]
    forces = (a.kind is ActuatorKind.FORCE or _slides(equilibrium, a) for a in chosen)
    ports = tuple(Port(a.name, "N" if force else "N m") for a, force in zip(chosen, forces, strict=True))
    return InputRows(rows, ports)


def output_rows(equilibrium: Equilibrium, names: Sequence[str]) -> ReadingRows:
    """Rows of the sensors ``names``: angles [rad], travels and displacements [m], accelerations; and rates of
    all but these, ``<name>_rate``.

    Raises `ConfigError` for an unknown name; an accelerometer has no rate.
    """
    chosen = [_find_sensor(equilibrium, name) for name in names]
    moves = _motions(equilibrium, [sensor for sensor, _ in chosen])
    position, rate, acceleration = np.zeros((3, len(names), equilibrium.model.tree.size), moves.dtype)
    units: list[str] = []
    for i, (sensor, is_rate) in enumerate(chosen):
        if sensor.axis is None:
            row = _joint_row(equilibrium, sensor.frame)
        elif sensor.kind is SensorKind.ACCELEROMETER:
            n = _world_axis(equilibrium, sensor.frame, sensor.axis)
            acceleration[i] = n @ moves[i, :3]
            row = -np.cross(n, equilibrium.environment.gravity) @ moves[i, 3:]
        elif sensor.kind is SensorKind.DISPLACEMENT:
            row = sensor.axis @ moves[i, :3]
        else:
            row = _world_axis(equilibrium, sensor.axis_frame or sensor.frame, sensor.axis) @ moves[i, 3:]
        (rate if is_rate else position)[i] = row
        units.append(_unit(equilibrium, sensor) + ("/s" if is_rate else ""))
    ports = tuple(Port(n, unit) for n, unit in zip(names, units, strict=True))
    return ReadingRows(position, rate, acceleration, ports)


def _unit(equilibrium: Equilibrium, sensor: Sensor) -> str:
    if sensor.kind is SensorKind.ACCELEROMETER:
        return "m/s^2"
    straight = sensor.kind is SensorKind.DISPLACEMENT or _slides(equilibrium, sensor)
    return "m" if straight else "rad"


def _slides(equilibrium: Equilibrium, port: Actuator | Sensor) -> bool:
    """Whether the port is that of a joint which slides."""
    return port.axis is None and any(
        j.slides for j in equilibrium.model.structure.joints if j.name == port.frame
    )


def one_of(known: Collection[str], table: str, name: str) -> str:
    """Advice where ``name`` is not ``known``: one like it and all, or the ``table`` that defines one.

    All stand there too: what is most like an axis that is not there is another axis.
    """
    close = difflib.get_close_matches(name, [one for both in known for one in both.split(", ")], 1, NEARLY)
    likely = f"did you mean {close[0]!r}? " if close else ""
    return f"{likely}one of {', '.join(known)}" if known else f"add {table} to the article, which has none"


def _find_sensor(equilibrium: Equilibrium, output: str) -> tuple[Sensor, bool]:
    """Sensor of an output and whether its rate is meant; a sensor may itself be called ``turn_rate``."""
    sensors = {s.name: s for s in equilibrium.model.structure.sensors}
    if output in sensors:
        return sensors[output], False
    sensor = sensors.get(output.removesuffix(RATE)) if output.endswith(RATE) else None
    if sensor is None:
        known = [n if s.kind is SensorKind.ACCELEROMETER else f"{n}, {n}{RATE}" for n, s in sensors.items()]
        raise ConfigError(
            f"no sensor {output.removesuffix(RATE)!r}", hint=one_of(known, "[[sensor]]", output)
        )
    if sensor.kind is SensorKind.ACCELEROMETER:
        raise ConfigError(f"accelerometer {sensor.name!r} has no rate", hint=f"take {sensor.name} itself")
    return sensor, True


def _motions(
    equilibrium: Equilibrium, ports: Sequence[Actuator | Sensor]
) -> Inexact[np.ndarray, "port 6 coordinate"]:
    """Translation and world rotation of every port's point, per coordinate."""
    model = equilibrium.model
    if not ports:
        return np.zeros((0, 6, model.tree.size))
    frames = np.array([model.frames.index(p.frame) for p in ports], dtype=int)
    points = PosePoints(frames, np.array([p.offset for p in ports]))
    J = pose_jacobian(model.tree, points, equilibrium.poses)
    return J.toarray().reshape(len(ports), 6, model.tree.size)


def _world_axis(equilibrium: Equilibrium, frame: str, axis: np.ndarray) -> Inexact[np.ndarray, "3"]:
    return np.asarray(equilibrium.poses.R[equilibrium.model.frames.index(frame)] @ axis)


def _joint_row(equilibrium: Equilibrium, joint: str) -> Inexact[np.ndarray, " coordinate"]:
    model = equilibrium.model
    row = np.zeros(model.tree.size)
    row[6 * model.tree.roots + [j.name for j in model.structure.joints].index(joint)] = 1.0
    return row


def _check_moves(equilibrium: Equilibrium, actuator: Actuator) -> None:
    joint = next(j for j in equilibrium.model.structure.joints if j.name == actuator.frame)
    if joint.state in (JointState.LOCKED, JointState.DRIVEN):
        moves = "shifts" if joint.slides else "turns"
        raise ConfigError(
            f"actuator {actuator.name!r} {moves} axis {joint.name!r}, which is {joint.state.value}",
            hint="set the axis free or sprung, or leave this input out",
        )
