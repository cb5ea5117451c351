"""Hybrid simulation: an exactly sampled plant, and once a tick what is not linear.

A converter rounds, a motor saturates, a rotor fills up, a joint sticks: all of it happens at ticks or at
joints, on a few channels, between which everything is one matrix. So a tick is two products with matrices and
some twenty operations on short arrays. The record leaves in blocks, and memory does not grow with its length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError, NumericalError
from middeck.realtime.computer import Computer
from middeck.realtime.hybrid_plant import HybridPlant
from middeck.realtime.motors import EXACT, MotorBank
from middeck.systems.joint_simulation import JointElements, balance_torques
from middeck.values import record

Array = np.ndarray


@record
class Readout:
    """What converters and encoders make of the sampled outputs, one entry each.

    ``step`` is one count (`EXACT` for none), ``range`` the largest reading; ``noise_rms`` is white and added
    before them. ``bias`` and ``walk`` (per tick) are standard deviations of an error and of its random walk;
    ``gyro`` tells the outputs that have one.
    """

    step: Float[np.ndarray, " output"]
    range: Float[np.ndarray, " output"]
    noise_rms: Float[np.ndarray, " output"]
    bias: Float[np.ndarray, " output"]
    walk: Float[np.ndarray, " output"]
    gyro: np.ndarray


@record
class HybridState:
    """Where a simulation stands.

    Parameters
    ----------
    x, computer:
        States of the continuous part and of the computer.
    issued:
        Torques issued in the last ticks, the latest last.
    momentum:
        Of each rotor, in units of a torque over one tick; minus what it has given.
    joints:
        State of every joint element in order.
    bias:
        Error of each reading now.
    trim:
        What the computer takes for it and subtracts.
    """

    x: Float[np.ndarray, " state"]
    computer: Float[np.ndarray, " computer"]
    issued: Float[np.ndarray, "tick input"]
    momentum: Float[np.ndarray, " input"]
    joints: Float[np.ndarray, " element"]
    bias: Float[np.ndarray, " output"]
    trim: Float[np.ndarray, " output"]


class HybridBlock(NamedTuple):
    """Some ticks of a hybrid simulation.

    ``measured`` are the outputs as the computer has them and ``readings`` what it made them from; ``control``
    is what the law adds, ``torque`` what the motors give for law and excitation together, ``momentum`` that
    of their rotors, and ``state`` where the block ends.
    """

    measured: Float[np.ndarray, "sample output"]
    readings: Float[np.ndarray, "sample output"]
    control: Float[np.ndarray, "sample input"]
    torque: Float[np.ndarray, "sample input"]
    momentum: Float[np.ndarray, "sample input"]
    state: HybridState


@record
class HybridSystem:
    """Everything that a hybrid simulation needs; `middeck.realtime.hardware_rig` builds one."""

    plant: HybridPlant
    computer: Computer
    motors: MotorBank
    readout: Readout
    joints: tuple[JointElements, ...]


def start_hybrid(system: HybridSystem, bias: Float[np.ndarray, " output"]) -> HybridState:
    """Everything at rest and at zero, but for the error of the readings."""
    m, plant = system.computer.commands, system.plant
    return HybridState(
        x=np.zeros(plant.angle.shape[1]),
        computer=np.zeros(system.computer.states),
        issued=np.zeros((plant.late + 1, m)),
        momentum=np.zeros(m),
        joints=np.zeros(sum(len(j.elements) for j in system.joints)),
        bias=bias,
        trim=np.zeros(system.computer.outputs),
    )


def simulate_hybrid(
    system: HybridSystem,
    excitation: Iterable[Float[np.ndarray, "sample input"]],
    rng: np.random.Generator,
    start: HybridState,
) -> Iterator[HybridBlock]:
    """Run ``excitation``, block by block as it comes; each block goes on where the last one ended.

    In each tick the outputs are sampled, the computer answers, and law and excitation together are issued to
    the motors; the numbers do not depend on where the blocks are cut. Raises `ConfigError` for an excitation
    of other channels and `NumericalError` where the state overflows.
    """
    for block in excitation:
        e = np.ascontiguousarray(block, dtype=float)
        if e.ndim != 2 or e.shape[1] != system.computer.commands:
            raise ConfigError(
                f"an excitation of shape {e.shape} for {system.computer.commands} motors",
                hint="samples in rows, one column for each motor",
            )
        if not np.isfinite(e).all():
            raise DataError(
                "a sample of the excitation is no finite number", hint="leave it out or record again"
            )
        done = _run_block(system, e, rng, start)
        start = done.state
        if not np.isfinite(start.x).all():
            raise NumericalError(
                "the simulated state overflows", hint="is the loop unstable? give motors a torque_limit"
            )
        yield done


def _run_block(system: HybridSystem, e: Array, rng: np.random.Generator, start: HybridState) -> HybridBlock:
    computer = system.computer
    noise, offset, bias = _draw(system, len(e), rng, start.bias)
    issued = np.vstack([start.issued, np.empty_like(e)])
    rows = np.empty((len(e), len(computer.step)))
    readings = np.empty((len(e), computer.outputs))
    momentum = np.empty_like(e)
    tick = _Tick(system, start)
    window = _pairs(issued)
    limit, read, move = tick.limit, tick.read, tick.move
    step, digital = computer.step, tick.digital
    states, answer = computer.states, computer.states + computer.outputs
    new = issued[len(start.issued) :]
    for k, row in enumerate(rows):
        read(offset[k], readings[k])
        np.dot(step, digital, out=row)
        digital[:states] = row[:states]
        limit(row[answer:], e[k], new[k], momentum[k])
        move(window[k], noise[k])
    end = HybridState(
        tick.x, digital[:states], issued[len(e) :], tick.momentum, tick.joint_states(), bias, start.trim
    )
    measured, control = rows[:, states:answer], rows[:, answer:]
    return HybridBlock(measured, readings, control, new, momentum, end)


def _draw(
    system: HybridSystem, count: int, rng: np.random.Generator, bias: Array
) -> tuple[Array, Array, Array]:
    """Noise on the states and offsets of the readings at each tick, and the bias after them.

    One stream of numbers, tick by tick: cutting it elsewhere changes nothing.
    """
    readout, outputs = system.readout, system.computer.outputs
    white = system.plant.noise.shape[1]
    drawn = rng.standard_normal((count, white + 2 * outputs))
    noise = drawn[:, :white] @ system.plant.noise.T
    walked = bias + np.cumsum(drawn[:, white : white + outputs] * readout.walk, axis=0)
    biased = np.vstack([bias, walked])
    return noise, biased[:-1] + drawn[:, white + outputs :] * readout.noise_rms, biased[-1]


def _pairs(issued: Array) -> Array:
    """Two rows in a row, each pair as one, without copying."""
    count, m = issued.shape
    row, item = issued.strides
    return np.lib.stride_tricks.as_strided(issued, (count - 1, 2 * m), (row, item), writeable=False)


class _Tick:
    """Buffers and matrices of one block; its methods are the three parts of a tick."""

    def __init__(self, system: HybridSystem, start: HybridState) -> None:
        plant, motors, readout = system.plant, system.motors, system.readout
        self.x = start.x.copy()
        self.digital = np.concatenate([start.computer, np.zeros(system.computer.outputs)])
        self.reading = self.digital[system.computer.states :]
        self.trim = start.trim if np.any(start.trim) else None
        self.momentum = start.momentum.copy()
        self.previous = start.issued[-1].copy()
        self.motors = motors
        self.per_step = 1.0 / motors.step
        self.converts = bool(np.any(motors.step > EXACT))
        self.slews, self.turns = (
            bool(np.isfinite(motors.slew).any()),
            bool(np.isfinite(motors.momentum).any()),
        )
        self.low, self.high = np.empty_like(self.momentum), np.empty_like(self.momentum)
        self.counts = bool(np.any(readout.step > EXACT))
        self.count, self.per_count = readout.step, 1.0 / readout.step
        self.range = readout.range if np.isfinite(readout.range).any() else None
        self.steps = [np.ascontiguousarray(a) for a in plant.step]
        self.drives = [np.ascontiguousarray(b) for b in plant.drive]
        self.first = np.vstack([self.steps[0], plant.read])
        self.ahead = np.empty(len(self.first))
        self.noisy = plant.noise.shape[1] > 0
        self.elements = [j.elements for j in system.joints]
        values = iter(start.joints.tolist())
        self.inner = [[next(values) for _ in parts] for parts in self.elements]
        self.push = list(plant.push)
        self.compliance: list[list[list[float]]] = [(plant.angle @ p).tolist() for p in plant.push]
        self.angles: list[float] = (plant.angle @ self.x).tolist()
        self.torque = [0.0] * len(self.elements)

    def joint_states(self) -> Array:
        return np.array([s for row in self.inner for s in row], dtype=float)

    def read(self, offset: Array, reading: Array) -> None:
        """What the sensors give now, also into ``reading``; and the states after the first internal step."""
        np.dot(self.first, self.x, out=self.ahead)
        now = self.reading
        np.add(self.ahead[len(self.steps[0]) :], offset, out=now)
        if self.range is not None:
            np.minimum(now, self.range, out=now)
            np.maximum(now, -self.range, out=now)
        if self.counts:
            np.multiply(now, self.per_count, out=now)
            np.rint(now, out=now)
            np.multiply(now, self.count, out=now)
        reading[:] = now
        if self.trim is not None:
            np.subtract(now, self.trim, out=now)

    def limit(self, law: Array, excitation: Array, torque: Array, momentum: Array) -> None:
        """What the motors give for law and excitation together, and what that leaves in their rotors."""
        motors, low, high = self.motors, self.low, self.high
        np.add(law, excitation, out=torque)
        if self.converts:
            np.multiply(torque, self.per_step, out=torque)
            np.rint(torque, out=torque)
            np.multiply(torque, motors.step, out=torque)
        if self.slews:
            np.subtract(self.previous, motors.slew, out=low)
            np.add(self.previous, motors.slew, out=high)
            np.maximum(torque, low, out=torque)
            np.minimum(torque, high, out=torque)
        np.maximum(torque, motors.lower, out=torque)
        np.minimum(torque, motors.upper, out=torque)
        if self.turns:
            np.subtract(self.momentum, motors.momentum, out=low)
            np.add(self.momentum, motors.momentum, out=high)
            np.maximum(torque, low, out=torque)
            np.minimum(torque, high, out=torque)
        np.subtract(self.momentum, torque, out=self.momentum)
        momentum[:] = self.momentum
        self.previous[:] = torque

    def move(self, window: Array, noise: Array) -> None:
        """The continuous part to the next tick."""
        ahead = self.ahead[: len(self.steps[0])]
        for j, drive in enumerate(self.drives):
            if j:
                ahead = np.dot(self.steps[j], self.x)
            after = np.dot(drive, window)
            np.add(after, ahead, out=after)
            self.x = after[: len(self.x)]
            if self.elements:
                self._rub(j, after[len(self.x) :].tolist())
        if self.noisy:
            np.add(self.x, noise, out=self.x)

    def _rub(self, j: int, free: list[float]) -> None:
        """Torques of the joints, held over this step, and where their angles end."""
        compliance = self.compliance[j]
        self.torque = balance_torques(self.elements, self.inner, self.angles, free, compliance, self.torque)
        self.x -= np.dot(self.push[j], self.torque)
        # Few joints: plain numbers are faster than arrays.
        for joint, (end, row) in enumerate(zip(free, compliance, strict=True)):
            for coefficient, torque in zip(row, self.torque, strict=True):
                end -= coefficient * torque
            self.angles[joint] = end
            states = self.inner[joint]
            for i, part in enumerate(self.elements[joint]):
                states[i] = part.resist(end, states[i])[1]
