"""Real motors: a converter of finite steps, limits of torque and slew, and a rotor that saturates.

Disturbance and control reach a motor as one command and share its limits. What a gimbal's motor gives to hold
its payload up in 1-g is taken from its range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.values import record

EXACT = 2.0**-100
"""Step of a converter that has none: a power of two, by which scaling is exact."""
WHOLE = 2.0**53
"""From here on every number is whole."""


@record
class Rotor:
    """The rotor of a reaction wheel: inertia [kg m^2] about its spin axis, and its largest rate [rad/s].

    The torque on the bus is minus inertia times acceleration. The speed counts from where the wheel stands
    when the experiment begins; that of the bus is small beside it and left out.
    """

    inertia: float
    speed_limit: float

    def __post_init__(self) -> None:
        if not (0.0 < self.inertia < math.inf and self.speed_limit > 0.0):
            raise ConfigError(
                f"a rotor of {self.inertia} kg m^2 up to {self.speed_limit} rad/s",
                where="Rotor",
                hint="both above zero, the inertia finite",
            )


@record(kw_only=True)
class Motor:
    """Limits and dynamics between a torque command and the torque [N m] (a force [N] where the input is one).

    Attributes:
        torque_limit: Most that the motor gives, to either side.
        holding: Constant part of it that gravity takes; commands count from there.
        slew_limit: Most that the torque changes in a second [N m/s]; only a rotor that runs full takes it
            back faster, at once.
        resolution: One step of its converter [N m]; zero for none.
        rotor: Rotor of a wheel; None for a motor between two bodies.

    Raises `ConfigError` for limits that are not positive, or a holding torque beyond the limit.
    """

    torque_limit: float = math.inf
    holding: float = 0.0
    slew_limit: float = math.inf
    resolution: float = 0.0
    rotor: Rotor | None = None

    def __post_init__(self) -> None:
        if not (self.torque_limit > 0.0 and self.slew_limit > 0.0 and 0.0 <= self.resolution < math.inf):
            raise ConfigError(
                f"limits of {self.torque_limit} N m and {self.slew_limit} N m/s in steps of "
                f"{self.resolution} N m",
                where="Motor",
                hint="limits above zero, steps from zero",
            )
        if not abs(self.holding) < self.torque_limit:
            raise ConfigError(
                f"the motor gives no more than the {abs(self.holding):g} N m that hold the payload",
                where="Motor",
                hint=f"a torque_limit above {abs(self.holding):g}",
            )


@record(kw_only=True)
class MotorBank:
    """All motors of a rig as arrays, one entry each; momentum in units of a torque over one tick."""

    lower: Float[np.ndarray, " input"]
    upper: Float[np.ndarray, " input"]
    slew: Float[np.ndarray, " input"]
    step: Float[np.ndarray, " input"]
    momentum: Float[np.ndarray, " input"]


def gather_motors(motors: Sequence[Motor], period_s: float) -> MotorBank:
    """The motors at a tick of ``period_s``."""
    rotors = [m.rotor for m in motors]
    return MotorBank(
        lower=np.array([-m.torque_limit - m.holding for m in motors]),
        upper=np.array([m.torque_limit - m.holding for m in motors]),
        slew=np.array([m.slew_limit * period_s for m in motors]),
        step=np.array([m.resolution or EXACT for m in motors]),
        momentum=np.array([np.inf if r is None else r.inertia * r.speed_limit / period_s for r in rotors]),
    )


class _Limits(NamedTuple):
    """Limits of one motor; counts below ``whole`` are rounded, none where it has no converter."""

    step: float
    per_step: float
    whole: float
    slew: float
    lower: float
    upper: float
    momentum: float


class LimitedMotors:
    """The motors from tick to tick: the last torque of each, and the momentum of its rotor."""

    def __init__(
        self, motors: MotorBank, previous: Float[np.ndarray, " input"], momentum: Float[np.ndarray, " input"]
    ) -> None:
        whole = np.where(motors.step > EXACT, WHOLE, 0.0)
        columns = (
            motors.step, 1.0 / motors.step, whole, motors.slew, motors.lower, motors.upper, motors.momentum
        )  # fmt: skip
        self.limits = [_Limits(*row) for row in np.column_stack(columns).tolist()]
        self.previous, self.momentum = previous.tolist(), momentum.tolist()

    def drive(self, law: list[float], excitation: list[float], torque: np.ndarray) -> None:
        """Torques of the motors for the sum of compensator and excitation: rounded, then limited."""
        for i, (step, per_step, whole, slew, lower, upper, room) in enumerate(self.limits):
            wanted, last, stored = law[i] + excitation[i], self.previous[i], self.momentum[i]
            counts = wanted * per_step
            if -whole < counts < whole:
                wanted = round(counts) * step
            # Slew, torque, rotor; what is no number passes all three.
            low, high = last - slew, last + slew
            wanted = low if wanted < low else high if wanted > high else wanted
            wanted = lower if wanted < lower else upper if wanted > upper else wanted
            low, high = stored - room, stored + room
            wanted = low if wanted < low else high if wanted > high else wanted
            self.momentum[i] = stored - wanted
            self.previous[i] = torque[i] = wanted
