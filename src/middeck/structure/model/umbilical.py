"""A weak cable to an article that floats."""

import dataclasses

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.model.article import AttachPoint, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment

LENGTH = 1.0  # m, of the springs that stand for it


def floats(environment: Environment) -> bool:
    """Whether nothing holds an article there: no weight, device, spring, bushing or clamp."""
    ties = environment.hung, environment.springs, environment.bushings, environment.clamps
    return not any(ties) and not np.any(environment.gravity)


def umbilical_point(structure: Structure) -> AttachPoint:
    """The middle attach point of an article that has any."""
    return structure.attach_points[len(structure.attach_points) // 2]


def tie_umbilical(structure: Structure, environment: Environment, frequency_hz: float) -> Environment:
    """``environment`` with three unstrained springs at the middle attach point, along the axes.

    On them the article's mass has ``frequency_hz``. Where there is gravity, or at zero, nothing is tied.
    Raises `ConfigError` for an article without an attach point.
    """
    if frequency_hz <= 0.0 or np.any(environment.gravity):
        return environment
    if not structure.attach_points:
        raise ConfigError(
            "an umbilical needs an attach point",
            where=f"structure {structure.title!r}",
            hint="add an [[attach]] table to the article",
        )
    point = umbilical_point(structure)
    frame = next(n for n in structure.nodes if n.name == point.frame)
    at = frame.position + point.offset
    stiffness = structure.mass * (2.0 * np.pi * frequency_hz) ** 2
    springs = tuple(
        AnchoredSpring(
            name=f"umbilical {letter}",
            attach=point.name,
            anchor=at + LENGTH * axis,
            stiffness=stiffness,
            free_length=LENGTH,
        )
        for letter, axis in zip("xyz", np.eye(3), strict=True)
    )
    return dataclasses.replace(environment, springs=(*environment.springs, *springs))
