"""One tick of a rig: read, limit, move.

Channels are few: plain numbers are faster than arrays for all but the states.
"""

from collections.abc import Callable

import numpy as np

from middeck.joints.attachment import only_friction
from middeck.joints.balance import Balance
from middeck.laboratory.rig.parts.converters import as_counts, converter_ends
from middeck.laboratory.rig.parts.motors import LimitedMotors
from middeck.laboratory.rig.plant.hybrid_plant import HybridPlant
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.state import RigState

Array = np.ndarray


class Tick:
    """Buffers and matrices of one block; `read`, `limit` (of the motors) and `move` are a tick."""

    def __init__(self, rig: Rig, plant: HybridPlant, start: RigState) -> None:
        size = len(start.x)
        # The states, and behind them the joints' angles that they have without torque.
        self.after = np.concatenate([start.x, np.zeros(len(plant.angle))])
        self.x, self.free = self.after[:size], self.after[size:]
        self.limit = LimitedMotors(rig.bank, start.issued[-1], start.momentum).drive
        self.converters = converter_ends(rig.readout)
        first = np.vstack([plant.step[0], plant.read / rig.readout.step[:, None]])
        self.ahead = np.empty(len(first))
        self.after_first, self.sampled = np.split(self.ahead, [len(plant.step[0])])
        # The order of ``ticks.c``, on machines where that takes over.
        self.sums = sums = blas_sums if only_friction(rig.joints) is None else column_sums
        self.look = sums(first)
        self.steps = [sums(a) for a in plant.step]
        self.drives = [sums(b) for b in plant.drive]
        self.noisy = plant.noise.shape[1] > 0
        self.elements = [j.elements for j in rig.joints]
        values = iter(start.joints.tolist())
        self.inner = [[next(values) for _ in parts] for parts in self.elements]
        # Response to torques held over a step, and to torques at its ends, which some samples feel.
        self.feels = any(np.any(a) for a in plant.answer)
        push = [np.hstack([p, a]) if self.feels else p for p, a in zip(plant.push, plant.answer, strict=True)]
        self.push = [sums(p) for p in push]
        self.held = np.zeros(push[0].shape[1])
        compliance: list[list[list[float]]] = [(plant.angle @ p).tolist() for p in plant.push]
        self.balance = [Balance(self.elements, rows) for rows in compliance]
        self.joints = [
            [
                (joint, tuple(enumerate(row)), tuple(enumerate(parts)))
                for joint, (row, parts) in enumerate(zip(rows, self.elements, strict=True))
            ]
            for rows in compliance
        ]
        self.angles: list[float] = (plant.angle @ self.x).tolist()
        self.torque = [0.0] * len(self.elements)
        self.stands = [
            -sum(part.resist(angle, state)[0] for part, state in zip(parts, states, strict=True))
            for parts, angle, states in zip(self.elements, self.angles, self.inner, strict=True)
        ]

    def joint_states(self) -> Array:
        """State of every joint element in order."""
        return np.array([s for row in self.inner for s in row], dtype=float)

    def read(self, offset: list[float], reading: Array) -> None:
        """Readings of the sensors now, in counts; and the states after the first substep."""
        self.look(0.0, self.x, self.ahead)
        read = self.sampled.tolist()
        for i, converter in enumerate(self.converters):
            reading[i] = as_counts(read[i] + offset[i], converter)

    def move(self, window: Array, noise: Array) -> None:
        """The continuous part to the next tick."""
        ahead = self.after_first
        for j, drive in enumerate(self.drives):
            if j:
                self.steps[j](0.0, self.x, ahead)
            drive(ahead, window, self.after)
            if self.elements:
                self._rub(j, self.free.tolist())
        if self.noisy:
            np.add(self.x, noise, self.x)

    def _rub(self, j: int, free: list[float]) -> None:
        """Torques of the joints, held over this step, where their angles end, and what samples feel."""
        angles, inner, held = self.angles, self.inner, self.held
        self.torque = torques = self.balance[j].solve(inner, angles, free, self.torque)
        before, stands = self.stands, []
        for joint, row, parts in self.joints[j]:
            end = free[joint]
            for i, coefficient in row:
                end -= coefficient * torques[i]
            angles[joint], states, standing = end, inner[joint], 0.0
            for i, part in parts:
                stood, states[i] = part.resist(end, states[i])
                standing += stood
            stands.append(-standing)
            held[joint] = -torques[joint]
        self.stands = stands
        if self.feels:
            held[len(stands) :] = before + stands
        self.push[j](self.x, held, self.x)


def column_sums(matrix: Array) -> Callable[[Array | float, Array, Array], None]:
    """A call that sets its last argument to its first plus ``matrix`` times its second, column by column.

    BLAS, as `blas_sums`, is faster, and has another order for each processor.

    >>> out = np.empty(1)
    >>> column_sums(np.array([[1.0, 1.0, 1.0]]))(1e16, np.array([1.0, 1.0, -1e16]), out)
    >>> out
    array([0.])
    """
    columns = np.ascontiguousarray(matrix.T)
    terms = np.empty((len(columns) + 1, columns.shape[1]))
    products, alone = terms[1:], columns.shape[1] == 1

    def add(start: Array | float, vector: Array, out: Array) -> None:
        terms[0] = start
        np.multiply(columns, vector[:, None], products)
        if alone:  # a sum along memory would be by pairs
            out[:] = np.add.accumulate(terms)[-1]
        else:
            np.add.reduce(terms, axis=0, out=out)

    return add


def blas_sums(matrix: Array) -> Callable[[Array | float, Array, Array], None]:
    """`column_sums` in the order of BLAS."""
    dot, made = np.ascontiguousarray(matrix).dot, np.empty(len(matrix))

    def add(start: Array | float, vector: Array, out: Array) -> None:
        dot(vector, made)
        np.add(made, start, out)

    return add
