"""Slip torque and slip angle of joints, from records at several drives.

Friction at a joint is a torque that goes with the measured angle beside that of the motor: feedback of the
output (Adams and Allemang 2000, Mech. Syst. Signal Process. 14, 637-656). Behind the torque that is left of
the command the article is linear, whatever the drive. So slip torque T and slip angle a of each joint are those
with which all experiments have one response, line by line, by weighted least squares:

    Y = H (U - T s(theta; a)),   s = +-1 where the joint slips.

H is eliminated by an orthogonal projection on each line (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, DataError, FitError
from middeck.identification.friction.slider import joint_angles, slider_torque
from middeck.identification.model.checks import check_record
from middeck.signals.ports import port_indices
from middeck.signals.record import Record
from middeck.values import record as frozen

# Slip angles that are tried first, as shares of the rms angle.
FIRST = (0.003, 0.01, 0.03, 0.1, 0.3)
STEPS, SMALL, HALVINGS = 12, 0.05, 6
# Of the logarithm of a slip angle, for its derivative: friction bends at every turn of the motion.
NUDGE = 0.02
# No step moves the logarithm of a slip angle by more.
LARGEST = 1.0


@frozen(kw_only=True)
class JointFriction:
    """Friction of joints, one a row.

    Attributes:
        inputs, outputs: Names of each joint's motor and of the angle that is read there.
        slip_torque, slip_angle: Torque [N m] at which it slips, and how far [rad] it gives way before, in
            units of the record's own motors and sensors; along a slide [N] and [m].
        slip_torque_std, slip_angle_std: Standard deviations of both.
        delay_s, band_hz: As they were told.
        before, after: What all experiments differ by from one linear response, as a variance over that of
            the noise: without friction, and with it. One is noise alone.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    slip_torque: Float[np.ndarray, " joint"]
    slip_angle: Float[np.ndarray, " joint"]
    slip_torque_std: Float[np.ndarray, " joint"]
    slip_angle_std: Float[np.ndarray, " joint"]
    delay_s: float
    band_hz: tuple[float, float]
    before: float
    after: float

    @property
    def stiffness(self) -> Float[np.ndarray, " joint"]:
        """Stiffness of each joint while it sticks [N m/rad]."""
        return self.slip_torque / self.slip_angle


def find_friction(
    record: Record, joints: Sequence[tuple[str, str]], *, delay_s: float, band_hz: tuple[float, float]
) -> JointFriction:
    """Friction at ``joints`` = (motor, angle), whose torque and angle are along one axis.

    Args:
        record: Whole periods, two or more, of more experiments than inputs; drives of several sizes tell
            friction from the article best, and every joint should slip in all of them.
        delay_s: From command to reading, half a sample of hold included; a tenth of what the angle takes to
            turn round is near enough.
        band_hz: The excited band.

    Raises `ConfigError` for unknown channels or none; `DataError` for a record that is not periodic, of one
    period, or of no more experiments than inputs; `FitError` where no friction makes the experiments agree.
    """
    problem = _problem(record, joints, delay_s, band_hz)
    none = np.zeros(len(joints))
    before = problem.cost(none, np.ones(len(joints)))
    rms = np.sqrt(np.mean(problem.angle**2, axis=(0, 1)))
    starts = [_with_torque(problem, np.log(share * rms)) for share in FIRST]
    x = min(starts, key=lambda start: start[1])[0]
    for _ in range(STEPS):
        r, J = _slopes(problem, x)
        _, R = np.linalg.qr(J)
        step = -np.linalg.solve(R, np.linalg.solve(R.T, J.T @ r))
        std = np.linalg.norm(np.linalg.inv(R), axis=1)
        x, moved = _moved(problem, x, step * min(1.0, LARGEST / np.max(np.abs(step[len(joints) :]))), r @ r)
        if np.max(np.abs(moved) / std) < SMALL:
            break
    torque, gives = np.split(x, 2)
    after = problem.cost(torque, np.exp(gives))
    std = std * np.sqrt(max(after, 1.0))
    _check(joints, torque, std[: len(joints)], before, after)
    return JointFriction(
        inputs=tuple(motor for motor, _ in joints),
        outputs=tuple(angle for _, angle in joints),
        slip_torque=torque,
        slip_angle=np.exp(gives),
        slip_torque_std=std[: len(joints)],
        slip_angle_std=np.exp(gives) * std[len(joints) :],
        delay_s=delay_s,
        band_hz=band_hz,
        before=before,
        after=after,
    )


@frozen(kw_only=True)
class _Problem:
    """All experiments at the lines of the band, divided by the noise.

    Attributes:
        U, Y: Of each line; Y also by the noise of each output.
        weight: One over the noise of each experiment.
        angle: Of the joints, a period.
        line, motor: Lines of the band, and the input of each joint.
    """

    U: Complex[np.ndarray, "line experiment input"]
    Y: Complex[np.ndarray, "line experiment output"]
    weight: Float[np.ndarray, " experiment"]
    angle: Float[np.ndarray, "sample experiment joint"]
    line: tuple[int, ...]
    motor: tuple[int, ...]

    def torques(self, slip_angle: np.ndarray) -> Complex[np.ndarray, "line experiment joint"]:
        """Friction over slip torque, weighted as the inputs."""
        samples, experiments, joints = self.angle.shape
        flat = self.angle.reshape(samples, -1)
        found = slider_torque(flat, np.tile(slip_angle, experiments)).reshape(self.angle.shape)
        return np.fft.rfft(found, axis=0)[list(self.line)] * self.weight[:, None]

    def left(self, torque: np.ndarray, friction: np.ndarray) -> Float[np.ndarray, " number"]:
        """What no response explains, in deviations of the noise."""
        U = self.U.copy()
        U[..., list(self.motor)] -= torque * friction
        Q, _ = np.linalg.qr(U)
        r = self.Y - Q @ (np.conj(np.swapaxes(Q, 1, 2)) @ self.Y)
        return np.sqrt(2.0) * r.reshape(-1).view(float)

    def cost(self, torque: np.ndarray, slip_angle: np.ndarray) -> float:
        """Mean square of what is left for each degree of freedom."""
        lines, experiments, inputs = self.U.shape
        r = self.left(torque, self.torques(slip_angle))
        return float(r @ r) / (2 * lines * (experiments - inputs) * self.Y.shape[2])


def _problem(
    record: Record, joints: Sequence[tuple[str, str]], delay_s: float, band_hz: tuple[float, float]
) -> _Problem:
    check_record(record)
    if not joints:
        raise ConfigError("no joint", where="friction", hint="a motor and an angle of each joint")
    motor = port_indices(record.inputs, [m for m, _ in joints], "input")
    angle = port_indices(record.outputs, [a for _, a in joints], "output")
    experiments, periods, samples, _ = record.y.shape
    if not record.periodic or periods < 2:
        raise DataError(
            "friction is found in whole periods, two or more: what differs between them is the noise",
            where="friction",
            hint="a repeated excitation, its periods cut",
        )
    if experiments <= len(record.inputs):
        raise DataError(
            f"{experiments} experiments for {len(record.inputs)} inputs: any friction fits them",
            where="friction",
            hint="one more experiment at least, best at a third of the drive",
        )
    hz = np.fft.rfftfreq(samples, 1.0 / record.sample_hz)
    line = np.flatnonzero((hz >= band_hz[0] * (1.0 - 1e-9)) & (hz <= band_hz[1] * (1.0 + 1e-9)) & (hz > 0.0))
    if not len(line):
        raise ConfigError(f"no line between {band_hz[0]:g} and {band_hz[1]:g} Hz", where="friction")
    Y = np.fft.rfft(record.y, axis=2)[:, :, line]
    U = np.fft.rfft(record.u.mean(axis=1), axis=1)[:, line]
    noise = Y.var(axis=1, ddof=1).mean(axis=1) / periods
    if not np.all(noise > 0.0):
        raise DataError("an output repeats without any noise", where="friction", hint="add a little of it")
    weight = 1.0 / np.sqrt(np.mean(noise / noise.mean(axis=0), axis=1))
    per_output = np.sqrt(np.mean(noise * weight[:, None] ** 2, axis=0))
    return _Problem(
        U=np.moveaxis(U * weight[:, None, None], 1, 0),
        Y=np.moveaxis(Y.mean(axis=1) * weight[:, None, None] / per_output, 1, 0),
        weight=weight,
        angle=joint_angles(record, angle, delay_s, band_hz[1]),
        line=tuple(line.tolist()),
        motor=tuple(motor),
    )


def _with_torque(problem: _Problem, gives: np.ndarray) -> tuple[np.ndarray, float]:
    """The slip torques that fit best to slip angles, to first order, and the cost."""
    none, friction = np.zeros(len(gives)), problem.torques(np.exp(gives))
    r = problem.left(none, friction)
    J = _by_torque(problem, none, friction, r)
    torque = np.linalg.lstsq(J, -r, rcond=None)[0]
    again = problem.left(torque, friction)
    return np.concatenate([torque, gives]), float(again @ again)


def _by_torque(problem: _Problem, torque: np.ndarray, friction: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Slopes by each slip torque; smooth, so that a difference does."""
    size = np.sqrt(np.mean(np.abs(problem.U[..., list(problem.motor)]) ** 2, axis=(0, 1)))
    steps = 1e-5 * size / np.sqrt(np.mean(np.abs(friction) ** 2, axis=(0, 1)))
    return np.stack(
        [(problem.left(torque + step * e, friction) - r) / step for step, e in zip(steps, np.eye(len(steps)), strict=True)],
        axis=1,
    )


def _slopes(problem: _Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is left and its slopes by slip torques and logarithms of slip angles."""
    torque, gives = np.split(x, 2)
    friction, nudged = problem.torques(np.exp(gives)), problem.torques(np.exp(gives + NUDGE))
    r = problem.left(torque, friction)
    by_angle = []
    for joint in range(len(torque)):
        one = friction.copy()
        one[..., joint] = nudged[..., joint]
        by_angle.append((problem.left(torque, one) - r) / NUDGE)
    return r, np.hstack([_by_torque(problem, torque, friction, r), np.stack(by_angle, axis=1)])


def _moved(
    problem: _Problem, x: np.ndarray, step: np.ndarray, cost: float
) -> tuple[np.ndarray, np.ndarray]:
    """A step that does not raise the cost, and how far it went."""
    for _ in range(HALVINGS):
        torque, gives = np.split(x + step, 2)
        r = problem.left(torque, problem.torques(np.exp(gives)))
        if r @ r <= cost:
            return x + step, step
        step = 0.5 * step
    return x, np.zeros_like(step)


def _check(
    joints: Sequence[tuple[str, str]], torque: np.ndarray, std: np.ndarray, before: float, after: float
) -> None:
    for (motor, _), value, deviation in zip(joints, torque, std, strict=True):
        if value < -3.0 * deviation:
            raise FitError(
                f"a slip torque of {value:.3g} N m +- {deviation:.2g} at {motor!r}: friction does not drive",
                where="friction",
                hint="do torque and angle point the same way, and is the delay right?",
            )
    if not after <= before:
        raise FitError("no friction makes the experiments agree", where="friction", hint="another law?")
