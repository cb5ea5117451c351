"""Simulation of a linear plant with friction, gaps and stops at its joints.

Between internal steps the linear part is exact under held torques. The torque of an element is held at its
mean over the joint's path in the step, solved together with the end angle. The work of a held torque, mean
torque times path, equals the work done on the element, so that only the excitation adds energy for any step:
the discrete gradient of Gonzalez 1996, J. Nonlinear Sci. 6, with dissipation. The rule is of second order in
time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.joints.balance import Balance
from middeck.joints.element import JointElement
from middeck.systems.modal import ModalSystem
from middeck.systems.plant import Plant
from middeck.systems.sampling import sample_dynamics
from middeck.systems.statespace import SampledStateSpace, StateSpace
from middeck.values import record


@record
class JointElements:
    """Elements side by side at one joint, named by its torque input and its angle output in a plant."""

    torque: str
    angle: str
    elements: tuple[JointElement, ...]


@record(kw_only=True)
class JointStepper:
    """A plant at a fixed internal step, ready to be stepped with the elements of its joints.

    Parameters
    ----------
    sampled:
        From held commands to outputs, their delay included.
    push:
        State after a step of a unit torque held at each joint, without delay.
    angle:
        Angle of each joint per state.
    direct:
        Direct response of the outputs to a torque at each joint (accelerations).
    joints:
        Elements of each joint.
    """

    sampled: SampledStateSpace
    push: Float[np.ndarray, "state joint"]
    angle: Float[np.ndarray, "joint state"]
    direct: Float[np.ndarray, "output joint"]
    joints: tuple[JointElements, ...]


@record
class JointStates:
    """State of a simulation: that of `JointStepper.sampled`, and that of every element in order."""

    x: Float[np.ndarray, " state"]
    elements: Float[np.ndarray, " element"]


def build_joint_stepper(
    plant: Plant, joints: Sequence[JointElements], *, step_s: float, delay_s: float = 0.0
) -> JointStepper:
    """The plant with ``joints``, commands delayed by ``delay_s``; viscous damping becomes part of the plant.

    Raises `ConfigError` for a port that the plant lacks, two entries for one joint, a joint whose angle
    answers a torque at once, or a torque and an angle that are not of one joint.
    """
    for names in ([j.torque for j in joints], [j.angle for j in joints]):
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ConfigError(f"two entries for joint {twice[0]!r}", hint="put its elements in one tuple")
    damped = add_viscous(plant, joints)
    sampled = sample_dynamics(damped, step_s, delay_s)
    pushed = sample_dynamics(damped, step_s)
    states = len(pushed.A)
    columns = plant.input_indices([j.torque for j in joints])
    rows = plant.output_indices([j.angle for j in joints])
    push = np.zeros((len(sampled.A), len(joints)))
    push[:states] = pushed.B[:, columns]
    # Not the sampled C: a delayed feedthrough, which no joint has, would sit there.
    angle = np.zeros((len(joints), len(sampled.A)))
    angle[:, :states] = pushed.C[rows]
    direct = pushed.D[:, columns]
    check_collocated(angle @ push, direct[rows], joints)
    return JointStepper(sampled=sampled, push=push, angle=angle, direct=direct, joints=tuple(joints))


def start_at_rest(stepper: JointStepper) -> JointStates:
    """Everything at zero: at rest, the friction relaxed."""
    count = sum(len(j.elements) for j in stepper.joints)
    return JointStates(np.zeros(len(stepper.sampled.A)), np.zeros(count))


def simulate_joints(
    stepper: JointStepper, u: Float[np.ndarray, "step input"], start: JointStates | None = None
) -> tuple[Float[np.ndarray, "step output"], JointStates]:
    """Outputs at the beginning of every internal step and where it ends; from rest if ``start`` is None.

    Raises `NumericalError` where the state overflows: the plant itself is unstable.

    >>> from middeck.joints.friction import Friction
    >>> from middeck.signals.ports import Port
    >>> wheel = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    >>> plant = Plant(dynamics=wheel, inputs=(Port("t", "N m"),), outputs=(Port("a", "rad"),))
    >>> stuck = JointElements("t", "a", (Friction(slip_torque=2.0, stiffness=1e4, viscous=10.0),))
    >>> y, _ = simulate_joints(build_joint_stepper(plant, [stuck], step_s=0.01), np.ones((2000, 1)))
    >>> bool(np.isclose(y[-1, 0], 1e-4, rtol=1e-6))   # held by the presliding spring
    True
    """
    start = start_at_rest(stepper) if start is None else start
    u = np.asarray(u, dtype=float)
    A, push, rows = (np.ascontiguousarray(m) for m in (stepper.sampled.A, stepper.push, stepper.angle))
    elements = [j.elements for j in stepper.joints]
    balance = Balance(elements, (rows @ push).tolist())
    inner = _by_joint(stepper, start.elements)
    drive = u @ stepper.sampled.B.T
    states = np.empty((len(u) + 1, len(A)))
    states[0] = start.x
    torque = [0.0] * len(elements)
    at_once = bool(np.any(stepper.direct))
    answers = np.zeros((len(u), len(stepper.direct)))
    begin: list[float] = (rows @ states[0]).tolist()
    for k in range(len(u)):
        x = states[k + 1]
        np.dot(A, states[k], out=x)
        x += drive[k]
        if elements:
            if at_once:
                answers[k] = stepper.direct @ _torques(elements, begin, inner)
            free: list[float] = (rows @ x).tolist()
            torque = balance.solve(inner, begin, free, torque)
            x -= push @ np.array(torque)
            begin = (rows @ x).tolist()
            inner = [_settle(parts, a, s) for parts, a, s in zip(elements, begin, inner, strict=True)]
    if not np.all(np.isfinite(states[-1])):
        raise NumericalError("the simulated state overflows", hint="is the plant itself unstable?")
    y = states[:-1] @ stepper.sampled.C.T + u @ stepper.sampled.D.T - answers
    return y, JointStates(states[-1].copy(), np.array([s for row in inner for s in row]))


def add_viscous(plant: Plant, joints: Sequence[JointElements]) -> StateSpace | ModalSystem:
    """The plant with each joint's viscous torque on the rate of its angle fed back, exactly."""
    damping = np.array([sum(e.viscous for e in j.elements) for j in joints])
    if not np.any(damping):
        return plant.rational
    system = plant.system
    columns = plant.input_indices([j.torque for j in joints])
    rates = system.C[plant.output_indices([j.angle for j in joints])] @ system.A
    drag = damping[:, None] * rates
    A, C = system.A - system.B[:, columns] @ drag, system.C - system.D[:, columns] @ drag
    return StateSpace(A, system.B, C, system.D)


def check_collocated(compliance: np.ndarray, direct: np.ndarray, joints: Sequence[JointElements]) -> None:
    """Raise `ConfigError` unless each torque and angle are of one joint that does not answer at once."""
    for i, joint in enumerate(joints):
        if np.any(direct[i]):
            raise ConfigError(
                f"the angle {joint.angle!r} responds to a joint's torque without delay",
                where="JointElements",
                hint="leave out residual flexibility (static=False) in a plant with friction",
            )
        if not compliance[i, i] > 0.0:
            raise ConfigError(
                f"torque {joint.torque!r} does not turn the angle {joint.angle!r} as a joint's own would",
                where="JointElements",
                hint="name the joint's torque input and its relative angle, not a rate or an inertial angle",
            )
    if not np.allclose(compliance, compliance.T, rtol=0.0, atol=1e-6 * np.abs(compliance).max(initial=0.0)):
        raise ConfigError(
            "the plant is not reciprocal between its joints",
            where="JointElements",
            hint="torque and angle of each entry must be of one joint; leave control loops open",
        )


def _by_joint(stepper: JointStepper, flat: np.ndarray) -> list[list[float]]:
    values = iter(flat.tolist())
    return [[next(values) for _ in joint.elements] for joint in stepper.joints]


def _torques(
    elements: list[tuple[JointElement, ...]], angles: list[float], inner: list[list[float]]
) -> list[float]:
    """Torque of every joint at its present angle."""
    return [
        sum(part.resist(angle, state)[0] for part, state in zip(parts, states, strict=True))
        for parts, angle, states in zip(elements, angles, inner, strict=True)
    ]


def _settle(parts: tuple[JointElement, ...], angle: float, states: list[float]) -> list[float]:
    """The elements' states after their joint has moved to ``angle``."""
    return [part.resist(angle, state)[1] for part, state in zip(parts, states, strict=True)]
