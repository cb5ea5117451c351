"""A plant with friction and gaps stepped in the plainest of ways, for comparison with the rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.joints.attachment import JointElements, add_viscous
from middeck.joints.balance import Balance
from middeck.joints.deadband import Deadband
from middeck.joints.element import JointElement
from middeck.joints.friction import Friction
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import sample_dynamics


def stored_energy(element: JointElement, angle: float, state: float) -> float:
    """Energy [J] in the presliding spring, or in the flanks of a gap less the work of its preload."""
    if isinstance(element, Friction):
        return 0.5 * element.stiffness * (angle - state) ** 2
    assert isinstance(element, Deadband)
    torque = element.resist(angle, state)[0] + element.preload
    return 0.5 * (torque**2 - element.preload**2) / element.stiffness - element.preload * angle


class PlainJoints:
    """States of plant, delay and elements; ``advance`` by a step under a torque held over it."""

    def __init__(self, plant: Plant, joints: Sequence[JointElements], step_s: float, delay_s: float) -> None:
        damped = add_viscous(plant, joints)
        self.sampled, prompt = sample_dynamics(damped, step_s, delay_s), sample_dynamics(damped, step_s)
        n, columns = len(prompt.A), plant.input_indices([j.torque for j in joints])
        rows = plant.output_indices([j.angle for j in joints])
        self.push, self.angle = np.zeros((len(self.sampled.A), len(joints))), self.sampled.C[rows]
        self.push[:n] = prompt.B[:, columns]
        self.parts = [j.elements for j in joints]
        self.balance = Balance(self.parts, (self.angle @ self.push).tolist())
        self.x = np.zeros(len(self.sampled.A))
        self.inner = [[0.0] * len(parts) for parts in self.parts]

    @property
    def outputs(self) -> np.ndarray:
        return self.sampled.C @ self.x

    def advance(self, u: np.ndarray) -> None:
        begin = (self.angle @ self.x).tolist()
        free = self.sampled.A @ self.x + self.sampled.B @ u
        guess = [0.0] * len(self.parts)
        torque = self.balance.solve(self.inner, begin, (self.angle @ free).tolist(), guess)
        self.x = free - self.push @ np.array(torque)
        ends = (self.angle @ self.x).tolist()
        self.inner = [
            [part.resist(end, state)[1] for part, state in zip(parts, states, strict=True)]
            for parts, states, end in zip(self.parts, self.inner, ends, strict=True)
        ]
