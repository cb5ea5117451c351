"""Slip torque and slip angle of joints, from records at several drives.

Friction at a joint is a torque that goes with the measured angle beside that of the motor: feedback of the
output (Adams and Allemang 2000, Mech. Syst. Signal Process. 14, 637-656). Behind the torque that is left of
the command the article is linear, whatever the drive. So slip torque T and slip angle a of each joint are
those with which all experiments have one response, line by line, by weighted least squares:

    Y = H (U - T s(theta; a)),   s = +-1 where the joint slips.

H is eliminated by an orthogonal projection on each line (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, DataError, FitError
from middeck.identification.friction.slider import JointAngles, joint_angles
from middeck.identification.model.refused_data import check_record
from middeck.signals.ports import port_indices
from middeck.signals.record import Record
from middeck.values import record as frozen

# Slip angles that are tried first, as shares of the rms angle.
FIRST = (0.003, 0.01, 0.03, 0.1, 0.3)
STEPS, SMALL, HALVINGS = 12, 0.05, 6
# Step of the logarithm of a slip angle for its derivative: friction bends at every turn of the motion.
NUDGE = 0.02
# Share of an output's power below which a variance is zero.
ROUNDING = 1e-24
# Step [s] for the derivative by the delay, and the deviation [s] that holds a given delay.
LATER_S, TOLD_S = 2e-4, 1e-9
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
        delay_s, band_hz: Delay from command to reading [s], given or found; and given band.
        before, after: Variance of the experiments' differences from one linear response, relative to that of
            the noise: without friction in the model, and with it. One means noise alone.
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
    record: Record,
    joints: Sequence[tuple[str, str]],
    *,
    band_hz: tuple[float, float],
    delay_s: float | None = None,
) -> JointFriction:
    """Friction at ``joints`` = (motor, angle), whose torque and angle are along one axis.

    Args:
        record: Whole periods, two or more, of more experiments than inputs; drives of several sizes tell
            friction from the article best, and every joint should slip in all of them.
        band_hz: The excited band.
        delay_s: Delay [s] from command to reading, with half a sample of hold; found by default.

    Raises `ConfigError` for unknown channels or none; `DataError` for a record that is not periodic, of one
    period, or of no more experiments than inputs; `FitError` where no friction makes the experiments agree.
    """
    problem = _problem(record, joints, band_hz, delay_s)
    count = len(joints)
    before = problem.cost(np.concatenate([np.zeros(count), np.zeros(count), [problem.late]]))
    starts = [_with_torque(problem, np.log(share * problem.rms)) for share in FIRST]
    x, std = min(starts, key=lambda start: start[1])[0], np.full(2 * count + 1, np.inf)
    for _ in range(STEPS):
        r, J = _slopes(problem, x)
        _, R = np.linalg.qr(J)
        step = -np.linalg.solve(R, np.linalg.solve(R.T, J.T @ r))
        std = np.linalg.norm(np.linalg.inv(R), axis=1)
        x, moved = _moved(
            problem, x, step * min(1.0, LARGEST / np.max(np.abs(step[count : 2 * count]))), float(r @ r)
        )
        if np.max(np.abs(moved) / std) < SMALL:
            break
    after = problem.cost(x)
    std = std * np.sqrt(max(after, 1.0))
    _check(joints, x, std, before, after)
    slip_angle = np.exp(x[count : 2 * count])
    return JointFriction(
        inputs=tuple(motor for motor, _ in joints),
        outputs=tuple(angle for _, angle in joints),
        slip_torque=x[:count],
        slip_angle=slip_angle,
        slip_torque_std=std[:count],
        slip_angle_std=slip_angle * std[count : 2 * count],
        delay_s=float(x[-1]),
        band_hz=band_hz,
        before=before,
        after=after,
    )


@frozen(kw_only=True)
class _Problem:
    """All experiments at the lines of the band, divided by the noise.

    The unknowns x are slip torques, logarithms of slip angles, and the delay.

    Attributes:
        U, Y: Spectra at each line; Y also over the noise of each output.
        weight: One over the noise of each experiment.
        angles: Angles of the joints, and ``rms`` of each.
        line, motor: Lines of the band, and the input of each joint.
        late: The given delay [s] (``told``), otherwise the first one tried.
    """

    U: Complex[np.ndarray, "line experiment input"]
    Y: Complex[np.ndarray, "line experiment output"]
    weight: Float[np.ndarray, " experiment"]
    angles: JointAngles
    rms: Float[np.ndarray, " joint"]
    line: tuple[int, ...]
    motor: tuple[int, ...]
    late: float
    told: bool

    def torques(self, x: np.ndarray) -> Complex[np.ndarray, "line experiment joint"]:
        """Friction over slip torque, weighted as the inputs."""
        found = self.angles.torques(np.exp(x[len(self.rms) : -1]), float(x[-1]))
        return np.fft.rfft(found, axis=0)[list(self.line)] * self.weight[:, None]

    def left(self, torque: np.ndarray, friction: np.ndarray) -> Float[np.ndarray, " number"]:
        """The residual that no response explains, in deviations of the noise."""
        U = self.U.copy()
        U[..., list(self.motor)] -= torque * friction
        Q, _ = np.linalg.qr(U)
        r = self.Y - Q @ (np.conj(np.swapaxes(Q, 1, 2)) @ self.Y)
        return np.sqrt(2.0) * r.reshape(-1).view(float)

    def cost(self, x: np.ndarray) -> float:
        """Mean square of the residual for each degree of freedom."""
        lines, experiments, inputs = self.U.shape
        r = self.left(x[: len(self.rms)], self.torques(x))
        return float(r @ r) / (2 * lines * (experiments - inputs) * self.Y.shape[2])


def _problem(
    record: Record, joints: Sequence[tuple[str, str]], band_hz: tuple[float, float], delay_s: float | None
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
        raise ConfigError(
            f"no line between {band_hz[0]:g} and {band_hz[1]:g} Hz",
            where="friction",
            hint="a band within that of the record",
        )
    Y = np.fft.rfft(record.y, axis=2)[:, :, line]
    U = np.fft.rfft(record.u.mean(axis=1), axis=1)[:, line]
    noise = Y.var(axis=1, ddof=1).mean(axis=1) / periods
    if not np.all(noise > ROUNDING * np.mean(np.abs(Y) ** 2, axis=(1, 2))):
        raise DataError("an output repeats without any noise", where="friction", hint="add a little of it")
    weight = 1.0 / np.sqrt(np.mean(noise / noise.mean(axis=0), axis=1))
    per_output = np.sqrt(np.mean(noise * weight[:, None] ** 2, axis=0))
    return _Problem(
        U=np.moveaxis(U * weight[:, None, None], 1, 0),
        Y=np.moveaxis(Y.mean(axis=1) * weight[:, None, None] / per_output, 1, 0),
        weight=weight,
        angles=joint_angles(record, angle, band_hz[1]),
        rms=np.std(record.y[..., angle], axis=(0, 1, 2)),
        line=tuple(line.tolist()),
        motor=tuple(motor),
        late=0.5 / record.sample_hz if delay_s is None else delay_s,
        told=delay_s is not None,
    )


def _with_torque(problem: _Problem, gives: np.ndarray) -> tuple[np.ndarray, float]:
    """The slip torques that fit best to slip angles, to first order, and the cost."""
    none = np.zeros(len(gives))
    x = np.concatenate([none, gives, [problem.late]])
    friction = problem.torques(x)
    r = problem.left(none, friction)
    x[: len(gives)] = np.linalg.lstsq(_by_torque(problem, none, friction, r), -r, rcond=None)[0]
    again = problem.left(x[: len(gives)], friction)
    return x, float(again @ again)


def _by_torque(problem: _Problem, torque: np.ndarray, friction: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Slopes by each slip torque; smooth, so that a difference does."""
    size = np.sqrt(np.mean(np.abs(problem.U[..., list(problem.motor)]) ** 2, axis=(0, 1)))
    steps = 1e-5 * size / np.sqrt(np.mean(np.abs(friction) ** 2, axis=(0, 1)))
    ways = np.diag(steps)
    by_step = [problem.left(torque + way, friction) - r for way in ways]
    return np.stack(by_step, axis=1) / steps


def _slopes(problem: _Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The residual, and its derivatives by the unknowns; none by a delay that is given."""
    count = len(problem.rms)
    torque, friction = x[:count], problem.torques(x)
    r = problem.left(torque, friction)
    # The friction of a joint depends on its own slip angle alone: all are nudged at once.
    nudged = problem.torques(x + np.repeat([0.0, NUDGE, 0.0], [count, count, 1]))
    columns = [_by_torque(problem, torque, friction, r)]
    for joint in range(count):
        one = np.where(np.arange(count) == joint, nudged, friction)
        columns.append((problem.left(torque, one) - r)[:, None] / NUDGE)
    late = problem.torques(x + np.append(np.zeros(2 * count), LATER_S))
    by_delay = (problem.left(torque, late) - r)[:, None] / LATER_S
    if problem.told:
        # A row of its own holds it where it is given.
        r, columns = np.append(r, 0.0), [np.vstack([c, np.zeros((1, c.shape[1]))]) for c in columns]
        by_delay = np.append(np.zeros(len(by_delay)), 1.0 / TOLD_S)[:, None]
    return r, np.hstack([*columns, by_delay])


def _moved(problem: _Problem, x: np.ndarray, step: np.ndarray, cost: float) -> tuple[np.ndarray, np.ndarray]:
    """A step that does not raise the cost, and how far it went."""
    for _ in range(HALVINGS):
        r = problem.left((x + step)[: len(problem.rms)], problem.torques(x + step))
        if r @ r <= cost:
            return x + step, step
        step = 0.5 * step
    return x, np.zeros_like(step)


def _check(
    joints: Sequence[tuple[str, str]], x: np.ndarray, std: np.ndarray, before: float, after: float
) -> None:
    for k, (motor, _) in enumerate(joints):
        if x[k] < -3.0 * std[k]:
            raise FitError(
                f"a slip torque of {x[k]:.3g} N m +- {std[k]:.2g} at {motor!r}: friction does not drive",
                where="friction",
                hint="do torque and angle point the same way?",
            )
    if not after <= before:
        raise FitError(
            "no friction makes the experiments agree",
            where="friction",
            hint="another kind of friction, or other joints?",
        )
