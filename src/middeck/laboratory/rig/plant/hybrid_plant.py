"""The continuous part of a rig, exactly sampled: plant, filters, delays, and noise in filters.

Between two ticks of the computer there are one or more substeps, in which joints rub. Commands are held
over a tick and act after their delay, also of a part of a tick. A sample that has no filter waits until it is
as old as those of the slowest sensor. Only the joints' torques are approximated, see
`middeck.joints.attachment`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements, check_collocated
from middeck.laboratory.rig.parts.sensors import Sensor
from middeck.laboratory.rig.plant.filtered_plant import filter_outputs, sample_noise
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import WHOLE, hold_inputs, split_delay
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

Hold = Callable[[float], tuple[np.ndarray, np.ndarray]]
"""exp(A t) and its integral times B."""


@record(kw_only=True)
class HybridPlant:
    """One tick of the continuous part, in substeps.

    Attributes:
        step: States after each substep; below them the angles of the joints there, their torques left
            out.
        drive: What two commands in a row add to that: the one issued ``delay_ticks`` + 1 ticks ago, then the
            next.
        push: States after a step of a unit torque held at each joint.
        answer: Immediate response of samples in a step: to the joints' torques at its beginning, then at
            its end.
        angle: Angle of each joint per state.
        read: Sampled outputs at a tick, per state.
        delay_ticks: Ticks before the later of the two commands begins to act, at the tick's end at the
            latest.
        noise: White normal numbers to what they add at a tick: to the filters' states, and to samples that
            wait.
    """

    step: Float[np.ndarray, "substep row state"]
    drive: Float[np.ndarray, "substep row window"]
    push: Float[np.ndarray, "substep state joint"]
    answer: Float[np.ndarray, "substep state two_joint"]
    angle: Float[np.ndarray, "joint state"]
    read: Float[np.ndarray, "output state"]
    delay_ticks: int
    noise: Float[np.ndarray, "state white"]


@record(kw_only=True)
class Wiring:
    """Elements between a computer and a plant, and their times.

    Attributes:
        inputs, sensors: The plant's inputs that motors drive, and its outputs with what reads each.
        joints: Friction and gaps.
        period_s, substeps: A tick, and the number of substeps in it.
        command_delay_s: Delay of the commands.
        wait_s: Age of each sample [s].
    """

    inputs: tuple[str, ...]
    sensors: tuple[tuple[str, Sensor], ...]
    joints: tuple[JointElements, ...]
    period_s: float
    substeps: int
    command_delay_s: float
    wait_s: Float[np.ndarray, " output"]


def build_hybrid_plant(plant: Plant, wiring: Wiring) -> HybridPlant:
    """``plant`` from held commands to samples, wired by ``wiring``.

    Raises `ConfigError` for unknown ports, an output that responds within the tick of its command, or a joint
    whose ports are not its own.
    """
    joints, period_s, substeps, m = wiring.joints, wiring.period_s, wiring.substeps, len(wiring.inputs)
    filtered = filter_outputs(plant, wiring.inputs, wiring.sensors, joints)
    system, own = filtered.system, plant.system
    delay_ticks, takes_over = _split_command(wiring.command_delay_s / period_s)
    chains = [_chain(w / period_s, bool(np.any(d))) for w, d in zip(wiring.wait_s, system.D, strict=True)]
    for (name, _), (_, instant), d in zip(wiring.sensors, chains, system.D, strict=True):
        if instant == 1.0 and takes_over == 0.0 and np.any(d[:m]):
            raise ConfigError(
                f"algebraic loop: output {name!r} responds at once to a command computed from its own sample",
                where="sensors",
                hint="increase delay_s, or leave out the direct term: build_plant(..., static=False)",
            )
    heads = len(system.A) + np.cumsum([0, *(length for length, _ in chains)])
    size = int(heads[-1])
    rows = plant.output_indices([j.angle for j in joints])
    angle, read = np.zeros((len(joints), size)), np.zeros((len(chains), size))
    angle[:, : len(own.A)] = own.C[rows]
    for output, (length, _) in enumerate(chains):
        if length:
            read[output, heads[output + 1] - 1] = 1.0
        else:
            read[output, : len(system.A)] = system.C[output]
    hold = functools.cache(functools.partial(hold_inputs, system))
    tick = _Tick(system=system, hold=hold, m=m, period_s=period_s, substeps=substeps, takes_over=takes_over)
    parts = [_one_step(tick, j, chains, heads) for j in range(substeps)]
    step, drive, push, answer = (np.array(x) for x in zip(*parts, strict=True))
    commands = plant.input_indices([*wiring.inputs, *(j.torque for j in joints)])
    check_collocated(angle @ push[0], own.D[np.ix_(rows, commands)], joints)
    looks = {
        o: instant * period_s
        for o, (length, instant) in enumerate(chains)
        if length and np.any(filtered.noise[:, o])
    }
    root = sample_noise(filtered, period_s, looks)
    noise = np.zeros((size, len(root)))
    noise[[*filtered.moved, *heads[list(looks)]]] = root
    return HybridPlant(
        step=np.concatenate([step, angle @ step], axis=1),
        drive=np.concatenate([drive, angle @ drive], axis=1),
        push=push, answer=answer, angle=angle, read=read, delay_ticks=delay_ticks, noise=noise,
    )  # fmt: skip


def _split_command(ticks: float) -> tuple[int, float]:
    """`HybridPlant.delay_ticks`, and when in a tick [ticks] the later command takes over: after 0, up to 1.

    Without any delay it takes over at 0.
    """
    whole, part = split_delay(ticks)
    return (whole - 1, 1.0) if whole and not part else (whole, part)


def _chain(ticks: float, direct: bool) -> tuple[int, float]:
    """Length of the chain in which a sample waits, and when in a tick [ticks] it was taken.

    What answers a command ``direct`` is sampled at the end of a tick, where the command that acts is known.
    """
    whole, part = split_delay(ticks)
    length = max(whole + (part > 0.0), int(direct))
    return length, length - (whole + part)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tick:
    """A tick with its substeps, within which one command takes over from another."""

    system: StateSpace
    hold: Hold
    m: int
    period_s: float
    substeps: int
    takes_over: float

    def rows(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States, two commands in a row and joints' torques to the states at ``end`` [ticks]."""
        early = min(max(self.takes_over - begin, 0.0), end - begin)
        rest = (end - begin - early) * self.period_s
        transition, new = self.hold(rest)
        old = transition @ self.hold(early * self.period_s)[1]
        over, pushed = self.hold((end - begin) * self.period_s)
        return over, np.hstack([old[:, : self.m], new[:, : self.m]]), pushed[:, self.m :]

    def answers(self, output: int, instant: float) -> np.ndarray:
        """Immediate response of ``output`` to two commands in a row."""
        direct = self.system.D[output, : self.m]
        acts = instant > self.takes_over - WHOLE
        return np.concatenate([0.0 * direct, direct] if acts else [direct, 0.0 * direct])


def _one_step(
    tick: _Tick, j: int, chains: Sequence[tuple[int, float]], heads: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`HybridPlant.step`, ``drive``, ``push`` and ``answer`` of substep ``j``, waiting samples last."""
    system, m, states, size = tick.system, tick.m, len(tick.system.A), int(heads[-1])
    joints = system.B.shape[1] - m
    A, B, P, answer = np.eye(size), *(np.zeros((size, k)) for k in (2 * m, joints, 2 * joints))
    begin = j / tick.substeps
    A[:states, :states], B[:states], P[:states] = tick.rows(begin, (j + 1) / tick.substeps)
    for output, ((length, instant), first) in enumerate(zip(chains, heads[:-1], strict=True)):
        if length and j == 0:
            A[first + 1 : first + length] = np.eye(size)[first : first + length - 1]
        # The last step of a tick also holds an instant at its end.
        taken = min(int(instant * tick.substeps), tick.substeps - 1)
        if length and j == taken:
            c = system.C[output]
            transition, window, pushed = tick.rows(begin, instant)
            A[first] = 0.0
            A[first, :states], P[first] = c @ transition, c @ pushed
            B[first] = c @ window + tick.answers(output, instant)
            share = instant * tick.substeps - j
            answer[first] = np.kron([1.0 - share, share], system.D[output, m:])
    return A, B, P, answer
