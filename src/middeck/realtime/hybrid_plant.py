"""The continuous part of a hybrid simulation, exactly sampled: plant, filters, delays, and noise in filters.

Between two ticks of the computer there are one or more internal steps, in which joints rub. Commands are held
over a tick and act late, also by a part of a tick; what is read without a filter may wait, so that all
sensors are equally late. Nothing here is approximated but the joints' torques, see
`middeck.joints.simulation`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.joints.simulation import JointElements, check_collocated
from middeck.realtime.filtered_plant import filter_outputs, sample_noise
from middeck.realtime.sensors import Sensor
from middeck.systems.plant import Plant
from middeck.systems.sampling import WHOLE
from middeck.systems.statespace import StateSpace
from middeck.values import record


@record(kw_only=True)
class HybridPlant:
    """One tick of the continuous part, in internal steps.

    Parameters
    ----------
    step:
        States after each internal step; below them the angles of the joints there, their torques left out.
    drive:
        What two commands in a row add to that: the one issued ``late`` + 1 ticks ago, then the next.
    push:
        States after a step of a unit torque held at each joint.
    angle:
        Angle of each joint per state.
    read:
        What is sampled at a tick, per state.
    late:
        Whole ticks before a command begins to act.
    noise:
        White normal numbers to what they add at a tick: to the filters' states, and to samples that wait.
    """

    step: Float[np.ndarray, "internal row state"]
    drive: Float[np.ndarray, "internal row window"]
    push: Float[np.ndarray, "internal state joint"]
    angle: Float[np.ndarray, "joint state"]
    read: Float[np.ndarray, "output state"]
    late: int
    noise: Float[np.ndarray, "state white"]


@record(kw_only=True)
class Wiring:
    """What stands between a computer and a plant, and when.

    Parameters
    ----------
    inputs, sensors:
        The plant's inputs that motors drive, and its outputs with what reads each.
    joints:
        Friction and gaps.
    period_s, steps:
        A tick, and internal steps in it.
    command_delay_s:
        By how much commands act late.
    wait_s:
        How long ago each sample was taken.
    """

    inputs: tuple[str, ...]
    sensors: tuple[tuple[str, Sensor], ...]
    joints: tuple[JointElements, ...]
    period_s: float
    steps: int
    command_delay_s: float
    wait_s: Float[np.ndarray, " output"]


def build_hybrid_plant(plant: Plant, wiring: Wiring) -> HybridPlant:
    """``plant`` from held commands to samples, as ``wiring`` has them.

    Raises `ConfigError` for unknown ports, an output that answers at once, or a joint that is none.
    """
    joints, period_s, steps = wiring.joints, wiring.period_s, wiring.steps
    filtered = filter_outputs(plant, wiring.inputs, wiring.sensors, joints)
    clock = _Clock(period_s, steps, wiring.command_delay_s / period_s)
    states, m = len(filtered.system.A), len(wiring.inputs)
    chains = [_split_wait(w / period_s) for w in wiring.wait_s]
    size = states + sum(length for length, _ in chains)
    angle = _joint_angles(plant, joints, size)
    hold = _Hold(filtered.system)
    step, drive, push = [], [], []
    for j in range(steps):
        A, B, P = _one_step(hold, filtered.system.C, m, clock, j, chains)
        step.append(np.vstack([A, angle @ A]))
        drive.append(np.vstack([B, angle @ B]))
        push.append(P)
    check_collocated(angle @ push[0], np.zeros((len(joints), len(joints))), joints)
    heads = states + np.cumsum([0, *(length for length, _ in chains)])
    looks = {
        o: instant * period_s
        for o, (length, instant) in enumerate(chains)
        if length and np.any(filtered.noise[:, o])
    }
    root = sample_noise(filtered, period_s, looks)
    noise = np.zeros((size, len(root)))
    noise[[*filtered.moved, *heads[list(looks)]]] = root
    return HybridPlant(
        step=np.array(step),
        drive=np.array(drive),
        push=np.array(push),
        angle=angle,
        read=_read_rows(filtered.system, chains, size),
        late=clock.late,
        noise=noise,
    )


class _Clock:
    """Ticks, internal steps, and when in a tick a command takes over from the one before."""

    def __init__(self, period_s: float, steps: int, delay: float) -> None:
        nearest = round(delay)
        delay = nearest if abs(delay - nearest) < WHOLE else delay
        self.late = int(np.floor(delay))
        self.takes_over = (delay - self.late) * period_s
        self.length = period_s / steps
        self.period_s, self.steps = period_s, steps

    def hold(self, hold: _Hold, begin: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Gains of the old and the new command over ``duration`` from ``begin`` within the tick."""
        early = min(max(self.takes_over - begin, 0.0), duration)
        rest = duration - early
        old = hold.transition(rest) @ hold.gain(early)
        return old, hold.gain(rest)


class _Hold:
    """exp(A t) and its integral times B (Van Loan 1978), each computed once."""

    def __init__(self, system: StateSpace) -> None:
        self.n, self.inputs = system.B.shape
        self.block = np.zeros((self.n + self.inputs, self.n + self.inputs))
        self.block[: self.n, : self.n], self.block[: self.n, self.n :] = system.A, system.B
        self.known: dict[float, np.ndarray] = {}

    def _at(self, duration: float) -> np.ndarray:
        if duration not in self.known:
            self.known[duration] = np.asarray(sla.expm(self.block * duration))
        return self.known[duration]

    def transition(self, duration: float) -> np.ndarray:
        return self._at(duration)[: self.n, : self.n]

    def gain(self, duration: float) -> np.ndarray:
        return self._at(duration)[: self.n, self.n :]


def _split_wait(ticks: float) -> tuple[int, float]:
    """Length of the chain in which a sample waits, and when in a tick [ticks] it was taken."""
    nearest = round(ticks)
    ticks = nearest if abs(ticks - nearest) < WHOLE else ticks
    length = int(np.ceil(ticks))
    return length, length - ticks


def _one_step(
    hold: _Hold, C: np.ndarray, m: int, clock: _Clock, j: int, chains: list[tuple[int, float]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, commands and joints' torques to the states after internal step ``j``, waiting samples last."""
    states = hold.n
    size = states + sum(length for length, _ in chains)
    begin = j * clock.length
    A = np.eye(size)
    B, P = np.zeros((size, 2 * m)), np.zeros((size, hold.inputs - m))

    def rows_after(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        old, new = clock.hold(hold, begin, duration)
        window = np.hstack([old[:, :m], new[:, :m]])
        return hold.transition(duration), window, hold.gain(duration)[:, m:]

    A[:states, :states], B[:states], P[:states] = rows_after(clock.length)
    first = states
    for output, (length, instant) in enumerate(chains):
        if length and j == 0:
            for age in range(length - 1, 0, -1):
                A[first + age] = 0.0
                A[first + age, first + age - 1] = 1.0
        # The last step of a tick also holds an instant that rounding has put at its end.
        taken = min(int(instant * clock.steps), clock.steps - 1)
        if length and j == taken:
            c = C[output]
            transition, window, pushed = rows_after(instant * clock.period_s - begin)
            A[first] = 0.0
            A[first, :states], B[first], P[first] = c @ transition, c @ window, c @ pushed
        first += length
    return A, B, P


def _read_rows(system: StateSpace, chains: list[tuple[int, float]], size: int) -> np.ndarray:
    read = np.zeros((len(chains), size))
    first = len(system.A)
    for output, (length, _) in enumerate(chains):
        if length:
            read[output, first + length - 1] = 1.0
        else:
            read[output, : len(system.A)] = system.C[output]
        first += length
    return read


def _joint_angles(plant: Plant, joints: Sequence[JointElements], states: int) -> np.ndarray:
    system = plant.system
    angle = np.zeros((len(joints), states))
    rows = plant.output_indices([j.angle for j in joints])
    angle[:, : len(system.A)] = system.C[rows]
    return angle
