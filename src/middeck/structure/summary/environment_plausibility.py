"""Plausibility warnings for an environment: gravity, cables and devices that no laboratory has."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Inexact

from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment

GRAVITY = 30.0  # m/s^2: above that of Jupiter
CABLE = (1e-2, 200.0)  # m: from a flexure to a drop tower
BOUNCE = (1e-3, 1e3)  # Hz: a pneumatic device to a hard mount
LOAD = 100.0  # weights of the article that a device may be given to carry


def warnings_on_environment(structure: Structure, environment: Environment) -> tuple[str, ...]:
    """One warning for each implausible number, with the unit in which it is read."""
    return (
        *warnings_on_gravity(environment.gravity),
        *_devices(structure, environment),
        *_springs(structure, environment),
    )


def warnings_on_gravity(gravity: Inexact[np.ndarray, "3"]) -> Iterator[str]:
    """A warning for a gravity [m/s^2] that no planet has."""
    size = float(np.linalg.norm(gravity))
    if size > GRAVITY:
        yield f"gravity is {size:.4g} m/s^2 (Jupiter has 25): is it in ft/s^2 or mm/s^2? it is read as m/s^2"


def _devices(structure: Structure, environment: Environment) -> Iterator[str]:
    weight = structure.mass * float(np.linalg.norm(environment.gravity))
    for device in environment.hung:
        named = f"device {device.name!r}"
        if device.cable_length is not None and not CABLE[0] <= device.cable_length <= CABLE[1]:
            yield f"{named} has a cable of {device.cable_length:.4g} m: is it in millimetres? it is read as m"
        if device.bounce_hz is not None and not BOUNCE[0] <= device.bounce_hz <= BOUNCE[1]:
            yield f"{named} bounces at {device.bounce_hz:.4g} Hz: is that in Hz?"
        if device.stiffness is not None:
            yield from _stiffness(named, device.stiffness, structure.mass)
        if device.force is not None and weight > 0.0 and device.force > LOAD * weight:
            yield f"{named} pulls with {device.force:.4g} N, the article weighs {weight:.4g} N: is it in N?"
        if device.moving_mass > LOAD * structure.mass:
            yield f"{named} moves {device.moving_mass:.4g} kg: is its moving mass in kg?"


def _springs(structure: Structure, environment: Environment) -> Iterator[str]:
    for spring in environment.springs:
        yield from _stiffness(f"spring {spring.name!r}", spring.stiffness, structure.mass)


def _stiffness(named: str, stiffness: float, mass: float) -> Iterator[str]:
    hz = float(np.sqrt(stiffness / mass) / (2.0 * np.pi)) if mass > 0.0 else 0.0
    if hz > 0.0 and not BOUNCE[0] <= hz <= BOUNCE[1]:
        yield (
            f"on {named} of {stiffness:.4g} N/m the article of {mass:.4g} kg would bounce at {hz:.3g} Hz: "
            "is its stiffness in N/m?"
        )
