"""Dry friction of joints in a promise: stated values, tolerances and draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.values import record


@record(kw_only=True)
class JointSlip:
    """A joint with a slip angle before it slips, see `middeck.joints.friction.Friction`.

    Attributes:
        name: Name of the joint's motor and of the angle that is read there.
        slip_torque: Torque [N m] at which it slips; along a slide [N].
        slip_angle: Presliding angle [rad]; along a slide [m].
        viscous: Viscous drag [N m s/rad] beside it; along a slide [N s/m].
        slip_torque_tolerance, slip_angle_tolerance: To both sides, relative, all values within as likely.
    """

    name: str
    slip_torque: float
    slip_angle: float
    viscous: float = 0.0
    slip_torque_tolerance: float = 0.0
    slip_angle_tolerance: float = 0.0

    def __post_init__(self) -> None:
        sizes = self.slip_torque, self.viscous, self.slip_torque_tolerance, self.slip_angle_tolerance
        sound = all(np.isfinite(s) and s >= 0.0 for s in sizes) and 0.0 < self.slip_angle < np.inf
        if not sound or max(sizes[2:]) >= 1.0:
            raise ConfigError(
                f"slips at {self.slip_torque} N m +- {self.slip_torque_tolerance}, by {self.slip_angle} rad "
                f"+- {self.slip_angle_tolerance}, drag {self.viscous} N m s/rad",
                where=f"joint {self.name!r}",
                hint="slip torque and drag from zero, slip angle above zero, tolerances from 0 to below 1",
            )


@record(kw_only=True)
class DrawnSlips:
    """Sliders of all joints, draw by draw, and the drawn numbers as parts of the tolerance."""

    slip_torque: Float[np.ndarray, "draw joint"]
    slip_angle: Float[np.ndarray, "draw joint"]
    names: tuple[str, ...]
    drawn: Float[np.ndarray, "draw name"]

    @property
    def stiffness(self) -> Float[np.ndarray, "draw joint"]:
        """Stiffness of the presliding springs [N m/rad]."""
        return self.slip_torque / self.slip_angle


def draw_slips(joints: Sequence[JointSlip], draws: int, rng: np.random.Generator) -> DrawnSlips:
    """Slip torques and slip angles within their tolerances."""
    torque, angle = rng.uniform(-1.0, 1.0, (2, draws, len(joints)))
    slip_torque, slip_angle = (
        np.array([getattr(j, key) for j in joints])
        * (1.0 + np.array([getattr(j, f"{key}_tolerance") for j in joints]) * part)
        for key, part in (("slip_torque", torque), ("slip_angle", angle))
    )
    return DrawnSlips(
        slip_torque=slip_torque,
        slip_angle=slip_angle,
        names=(*(f"slip torque of {j.name}" for j in joints), *(f"slip angle of {j.name}" for j in joints)),
        drawn=np.concatenate([torque, angle], axis=1),
    )
