"""Forces of spinning wheels about a rest state.

A rotor that turns at the speed W about the axis n of its frame has the momentum h = J W n. In the kinetic
energy it adds h . omega, linear in the rates: a one-form of the coordinates, of which its exterior derivative
alone acts. That needs the first derivative of the frame's turn and no more. Whatever rotation vectors are
chosen, the equations of motion about rest are

    M q'' + G q' + K q = f,    G = - sum over wheels of A' [h x] A,

with A the turn of the wheel's frame in W per coordinate: G q' is Euler's omega x h, on the left. G is skew:
it does no work, and at rest there is nothing of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration, PosePoints, frame_poses, pose_jacobian
from middeck.structure.elements.rotations import skew
from middeck.structure.model.environment import Environment


class Spin(NamedTuple):
    """The wheels that turn: rows of A, three a wheel, and momentum [N m s] in W."""

    turn: sp.csr_array
    momentum: Float[np.ndarray, "wheel 3"]

    @property
    def turns(self) -> bool:
        """Whether any wheel turns."""
        return len(self.momentum) > 0

    def forces(self, turn: np.ndarray) -> np.ndarray:
        """-h x ``turn`` for columns with three rows a wheel."""
        seen = turn.reshape(len(self.momentum), 3, turn.shape[1])
        return (-skew(self.momentum) @ seen).reshape(turn.shape)

    def reduced(self, shapes: Float[np.ndarray, "coordinate mode"]) -> Float[np.ndarray, "mode mode"]:
        """G between ``shapes``."""
        turn = self.turn @ shapes
        G = turn.T @ self.forces(turn)
        return 0.5 * (G - G.T)


def spinning_wheels(model: Model, config: Configuration, environment: Environment) -> Spin:
    """The wheels of the article that turn in ``environment``: none at speed zero."""
    wheels = {wheel.name: wheel for wheel in model.structure.wheels}
    turning = [(wheels[name], speed) for name, speed in environment.wheel_speeds if speed != 0.0]
    if not turning:
        return Spin(sp.csr_array((0, model.tree.size)), np.zeros((0, 3)))
    frames = np.array([model.frames.index(wheel.frame) for wheel, _ in turning])
    poses = frame_poses(model.tree, config)
    J = pose_jacobian(model.tree, PosePoints(frames, np.zeros((len(frames), 3))), poses)
    h = np.array([wheel.inertia * speed * wheel.axis for wheel, speed in turning])
    rows = (6 * np.arange(len(frames))[:, None] + np.arange(3, 6)).ravel()
    return Spin(sp.csr_array(J[rows]), np.matvec(poses.R[frames], h))


def check_speeds(model: Model, environment: Environment) -> None:
    """Raise `ConfigError` for a speed of a wheel that the article lacks, or that is no finite number."""
    wheels = [wheel.name for wheel in model.structure.wheels]
    for name, speed in environment.wheel_speeds:
        if name not in wheels or not np.isfinite(speed):
            known = (
                f"one of {', '.join(wheels)}" if wheels else "the article has no wheels: give it [[wheel]]"
            )
            raise ConfigError(
                f"a speed of {speed:g} rad/s for wheel {name!r}",
                where=f"environment {environment.title!r}",
                hint=f"a finite speed; {known}",
            )
