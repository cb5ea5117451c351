"""One tick of a hybrid simulation: read, limit, move."""

from __future__ import annotations

import numpy as np

from middeck.joints.simulation import balance_torques
from middeck.realtime.hybrid_state import HybridState, HybridSystem
from middeck.realtime.motors import EXACT

Array = np.ndarray


class Tick:
    """Buffers and matrices of one block; `read`, `limit` and `move` are the three parts of a tick."""

    def __init__(self, system: HybridSystem, start: HybridState) -> None:
        plant, motors, readout = system.plant, system.motors, system.readout
        self.x = start.x.copy()
        self.momentum, self.previous = start.momentum, start.issued[-1]
        self.motors = motors
        self.per_step = 1.0 / motors.step
        self.converts = bool(np.any(motors.step > EXACT))
        # Both ways at once: one addition instead of two.
        self.slew = _both_ways(motors.slew)
        self.room = _both_ways(motors.momentum)
        self.ends = np.empty((2, len(self.momentum)))
        self.low, self.high = self.ends
        self.counts = bool(np.any(readout.step > EXACT))
        self.range = _both_ways(readout.range / readout.step)
        self.steps = [np.ascontiguousarray(a) for a in plant.step]
        self.drives = [np.ascontiguousarray(b) for b in plant.drive]
        self.first = np.vstack([self.steps[0], plant.read / readout.step[:, None]])
        self.ahead = np.empty(len(self.first))
        self.after_first, self.sampled = np.split(self.ahead, [len(self.steps[0])])
        self.noisy = plant.noise.shape[1] > 0
        self.elements = [j.elements for j in system.joints]
        values = iter(start.joints.tolist())
        self.inner = [[next(values) for _ in parts] for parts in self.elements]
        self.push = [np.ascontiguousarray(p) for p in plant.push]
        self.held, self.pushed = np.zeros(len(self.elements)), np.empty(len(self.x))
        self.compliance: list[list[list[float]]] = [(plant.angle @ p).tolist() for p in plant.push]
        self.angles: list[float] = (plant.angle @ self.x).tolist()
        self.torque = [0.0] * len(self.elements)

    def joint_states(self) -> Array:
        """State of every joint element in order."""
        return np.array([s for row in self.inner for s in row], dtype=float)

    def read(self, offset: Array, reading: Array) -> None:
        """What the sensors give now, in counts; and the states after the first internal step."""
        np.dot(self.first, self.x, out=self.ahead)
        np.add(self.sampled, offset, out=reading)
        if self.range is not None:
            np.maximum(reading, self.range[0], out=reading)
            np.minimum(reading, self.range[1], out=reading)
        if self.counts:
            np.rint(reading, out=reading)

    def limit(self, law: Array, excitation: Array, torque: Array) -> None:
        """What the motors give for law and excitation together."""
        motors, low, high = self.motors, self.low, self.high
        np.add(law, excitation, out=torque)
        if self.converts:
            np.multiply(torque, self.per_step, out=torque)
            np.rint(torque, out=torque)
            np.multiply(torque, motors.step, out=torque)
        if self.slew is not None:
            np.add(self.previous, self.slew, out=self.ends)
            np.maximum(torque, low, out=torque)
            np.minimum(torque, high, out=torque)
        np.maximum(torque, motors.lower, out=torque)
        np.minimum(torque, motors.upper, out=torque)
        if self.room is not None:
            np.add(self.momentum, self.room, out=self.ends)
            np.maximum(torque, low, out=torque)
            np.minimum(torque, high, out=torque)
            self.momentum = self.momentum - torque
        self.previous = torque

    def move(self, window: Array, noise: Array) -> None:
        """The continuous part to the next tick."""
        ahead = self.after_first
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
        self.held[:] = self.torque
        np.dot(self.push[j], self.held, out=self.pushed)
        np.subtract(self.x, self.pushed, out=self.x)
        # Few joints: plain numbers are faster than arrays.
        for joint, (end, row) in enumerate(zip(free, compliance, strict=True)):
            for coefficient, torque in zip(row, self.torque, strict=True):
                end -= coefficient * torque
            self.angles[joint] = end
            states = self.inner[joint]
            for i, part in enumerate(self.elements[joint]):
                states[i] = part.resist(end, states[i])[1]


def _both_ways(limit: Array) -> Array | None:
    """A limit downwards and upwards; None where no channel has one."""
    return np.stack([-limit, limit]) if np.isfinite(limit).any() else None
