"""Dry friction of joints while a survey was taken: a spring and a loss in each mode, by its amplitude.

In harmonic balance the friction of a joint that swings by A is k_eq(A) + j k_loss(A) (Caughey 1960, J. Appl.
Mech. 27; `middeck.joints.friction.Friction`). A survey measured each mode at an amplitude of its own, so that
each of them is one of another linear article.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import gammainc

from middeck.errors import ConfigError
from middeck.joints.friction import Friction
from middeck.structure.model.article import JointState
from middeck.structure.modes.solve import Modes
from middeck.updating.unknowns.unknowns import Bound
from middeck.values import record

TORQUE, ANGLE = "slip_torque", "slip_angle"
# Step in y of amplitudes beyond the slip angle, (A/angle - 1) = exp(2 y): in y the mean is smooth, so the
# trapezoidal rule is exact to rounding for an rms of up to 1e20 slip angles.
STEP = 1.0 / 16.0
BEYOND = np.exp(2.0 * np.arange(-15.0, 25.0, STEP))


@record(kw_only=True)
class SurveyedFriction:
    """Friction of a joint, and the joint's amplitude in each measured mode.

    Attributes:
        joint: Name of the joint. Unknowns are ``friction.NAME.slip_torque`` and ``friction.NAME.slip_angle``,
            factors on the next two.
        slip_torque, slip_angle: Spring and slider in series [N m], [rad]; for a slide [N], [m].
        amplitude: Amplitude of the joint in each measured mode [rad], zero to peak; of a slide [m].
        random: Whether that is the rms of a narrow-band random motion instead.

    Raises `ConfigError` for numbers that are not positive and finite.
    """

    joint: str
    slip_torque: float
    slip_angle: float
    amplitude: Float[np.ndarray, " measured"]
    random: bool = False

    def __post_init__(self) -> None:
        sizes = np.array([self.slip_torque, self.slip_angle, *self.amplitude])
        if not np.all(np.isfinite(sizes) & (sizes > 0.0)):
            raise ConfigError(
                f"friction of {self.slip_torque} N m over {self.slip_angle} rad at amplitudes "
                f"{self.amplitude.tolist()} rad",
                where=f"joint {self.joint!r}",
                hint="all above zero; a joint that a mode hardly moves has a small amplitude",
            )

    @property
    def parameters(self) -> tuple[str, str]:
        """Names of the parameters of slip torque and slip angle."""
        return f"friction.{self.joint}.{TORQUE}", f"friction.{self.joint}.{ANGLE}"

    def moved_by(self, unknowns: Sequence[Sequence[str]]) -> Float[np.ndarray, "2 unknown"]:
        """One where an unknown, by the names of its parameters, moves slip torque or angle; else zero."""
        rows = [[any(fnmatchcase(own, p) for p in names) for names in unknowns] for own in self.parameters]
        return np.array(rows, dtype=float).reshape(2, len(unknowns))


class Added(NamedTuple):
    """Stiffness and loss that the friction of one joint adds in each measured mode.

    Attributes:
        coordinate: Coordinate of the joint in shapes.
        row: Row of the joint in the model's modes.
        stiffness: k_eq + j k_loss [N m/rad].
        slope: Its derivative by each unknown.
    """

    coordinate: int
    row: Float[np.ndarray, " mode"]
    stiffness: Complex[np.ndarray, " measured"]
    slope: Complex[np.ndarray, "unknown measured"]


def joint_coordinate(modes: Modes, name: str) -> int:
    """The coordinate of a joint in shapes.

    Raises `ConfigError` for one that there is not, or that does not move.
    """
    model = modes.equilibrium.model
    joints = {j.name: (k, j.state) for k, j in enumerate(model.structure.joints)}
    number, state = joints.get(name, (0, JointState.LOCKED))
    if state in (JointState.LOCKED, JointState.DRIVEN):
        moving = [n for n, (_, s) in joints.items() if s not in (JointState.LOCKED, JointState.DRIVEN)]
        raise ConfigError(
            f"no joint {name!r} that moves",
            where="friction of a survey",
            hint=f"such joints are {', '.join(moving) or 'not there'}",
        )
    return 6 * model.tree.roots + number


def added_to_joint(
    modes: Modes, count: int, friction: SurveyedFriction, bound: Sequence[Bound], x: np.ndarray
) -> Added:
    """Effect of one joint's friction on the lowest ``count`` modes, with the unknowns at ``x``."""
    moved = friction.moved_by([b.unknown.parameters for b in bound])
    torque, angle = np.array([friction.slip_torque, friction.slip_angle]) * np.exp(moved @ x)
    value, slopes = equivalent(friction, torque, angle)
    coordinate = joint_coordinate(modes, friction.joint)
    return Added(coordinate, modes.shapes[coordinate, :count], value, moved.T @ slopes)


def equivalent(
    friction: SurveyedFriction, torque: float, angle: float
) -> tuple[Complex[np.ndarray, " measured"], Complex[np.ndarray, "2 measured"]]:
    """k_eq + j k_loss of each mode, and its derivatives by the logarithms of slip torque and slip angle.

    Of a random motion, whose amplitude has Rayleigh's distribution, the mean weighted with the energy of the
    swing (Roberts and Spanos 1990, "Random Vibration and Statistical Linearization", chapter 5).
    """
    sticks = 0.0
    A, weights = friction.amplitude[None], np.ones((1, 1))
    if friction.random:
        slips = angle / (np.sqrt(2.0) * friction.amplitude)
        t = slips * (1.0 + BEYOND[:, None])
        # Weights of exp(-u) u du with u = (A/rms)^2/2 = t^2.
        A, weights = (
            np.sqrt(2.0) * friction.amplitude * t,
            4.0 * STEP * np.exp(3.0 * np.log(t) - t**2) * (t - slips),
        )
        sticks = gammainc(2.0, slips**2)
    found = Friction(slip_torque=torque, stiffness=torque / angle).describing_function(A.ravel())
    N = (found.stiffness + 1j * found.loss).reshape(A.shape)
    # With cos psi = 1 - 2 ratio: of k_eq (4 k / pi) sin psi, of k_loss (4 k / pi) (1 - 2 ratio), by ratio.
    ratio = np.minimum(angle / A, 1.0)
    rise = 4.0 / np.pi * torque / angle * (2.0 * np.sqrt(ratio * (1.0 - ratio)) + 1j * (1.0 - 2.0 * ratio))
    by_angle = np.where(ratio < 1.0, rise * ratio, 0.0)
    value = sticks * torque / angle + np.sum(weights * N, axis=0)
    return value, np.array([value, np.sum(weights * by_angle, axis=0) - value])
