"""Places by their gravity, the paths between them, and the behaviour of devices along these."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from enum import Enum

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly.environment_loads import Loads, scale_loads
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.suspension_tuning import environment_loads, tune_suspension
from middeck.values import record

# [m/s^2]. Earth: standard acceleration of gravity, exact (CODATA). Moon, Mars: surface gravity of NASA's
# planetary fact sheets (D. R. Williams, NSSDCA), whose editions differ in the last digit.
GRAVITIES = {"earth": 9.80665, "mars": 3.71, "moon": 1.62, "orbit": 0.0}
# Sine of the angle below which two gravities point the same way, or opposite ways.
PARALLEL = 1e-12


@record
class GravityLevel:
    """A name and the gravity vector in W [m/s^2]; where that is zero, the article is free."""

    name: str
    gravity: Float[np.ndarray, "3"]

    @property
    def size(self) -> float:
        """Size of gravity [m/s^2]."""
        return float(np.linalg.norm(self.gravity))


class DeviceRule(Enum):
    """Behaviour of the suspension's devices in another gravity than that of their tuning.

    In zero gravity they are released, whatever the rule.
    """

    KEPT = "kept"  # anchors and stiffnesses as tuned; their set force is scaled with gravity
    RETUNED = "retuned"  # tuned and anchored anew, as if each gravity were an environment of its own


def find_place(name: str, down: Float[np.ndarray, "3"] | None = None) -> GravityLevel:
    """A place of `GRAVITIES`, or a number of m/s^2, with gravity along ``down``.

    By default against y, which is up in the articles and environments that come along. Raises `ConfigError`
    for any other name and for a ``down`` of no length.

    >>> find_place("moon").gravity.tolist()
    [0.0, -1.62, 0.0]
    >>> find_place("2.5", down=np.array([0.0, 0.0, -9.80665])).gravity.tolist()
    [0.0, 0.0, -2.5]
    """
    down = np.array([0.0, -1.0, 0.0]) if down is None else down
    length = float(np.linalg.norm(down))
    if length == 0.0:
        raise ConfigError(
            "down is the zero vector: a place needs a direction", hint="take the laboratory's gravity"
        )
    try:
        size = GRAVITIES[name] if name in GRAVITIES else float(name)
    except ValueError:
        size = -1.0
    if not 0.0 <= size < np.inf:
        known = ", ".join(GRAVITIES)
        raise ConfigError(f"no place {name!r}", where="place", hint=f"{known}, or a gravity in m/s^2 from 0")
    return GravityLevel(name if name in GRAVITIES else f"{size:g} m/s^2", size * down / length + 0.0)


def tilt_place(place: GravityLevel, angle: float, axis: Float[np.ndarray, "3"]) -> GravityLevel:
    """The same place with its floor, anchors and article tilted by ``angle`` [rad] about ``axis``.

    W is fixed to the floor, so that in W gravity turns by the opposite angle.
    """
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise ConfigError(
            "an axis to tilt about must not be the zero vector",
            where="tilt",
            hint="a direction, such as (1, 0, 0)",
        )
    turned = rotation_exp(-angle * axis / length) @ place.gravity
    return GravityLevel(f"{place.name} tilted {np.degrees(angle):g} deg", turned)


def gravity_between(a: GravityLevel, b: GravityLevel, t: float) -> Float[np.ndarray, "3"]:
    """Gravity at the fraction ``t`` of the way: its size linear, its direction along the great circle.

    Raises `ConfigError` for opposite directions, between which there is no one way.
    """
    size = (1.0 - t) * a.size + t * b.size
    if a.size == 0.0 or b.size == 0.0:
        end = a if b.size == 0.0 else b
        return size * end.gravity / (end.size or 1.0)
    start, end = a.gravity / a.size, b.gravity / b.size
    normal = np.cross(start, end)
    sine, cosine = float(np.linalg.norm(normal)), float(start @ end)
    if sine < PARALLEL:
        if cosine < 0.0:
            raise ConfigError(
                f"gravity in {b.name!r} is opposite to that in {a.name!r}",
                hint="name a place between them, or go through orbit",
            )
        return size * start
    return size * rotation_exp(t * np.arctan2(sine, cosine) * normal / sine) @ start


def loads_in(full: Equilibrium, rule: DeviceRule) -> Callable[[np.ndarray], Loads]:
    """The loads as a function of gravity, ``full`` being the state for which the devices were tuned.

    `tune_suspension` raises `EquilibriumError` where a device that is tuned anew would have to push.
    """

    def kept(gravity: np.ndarray) -> Loads:
        tuned_for = float(np.linalg.norm(full.loads.gravity)) or 1.0
        scaled = scale_loads(full.loads, float(np.linalg.norm(gravity)) / tuned_for)
        return dataclasses.replace(scaled, gravity=gravity, push=full.loads.push)

    def retuned(gravity: np.ndarray) -> Loads:
        there = dataclasses.replace(full.environment, gravity=gravity)
        return environment_loads(full.model, there, tune_suspension(full.model, there))

    return kept if rule is DeviceRule.KEPT else retuned
