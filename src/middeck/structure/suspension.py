"""From an environment to loads: pinned reactions, then the stiffness of each device (the paper's step 1)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, EquilibriumError
from middeck.structure.assembly import Loads, no_loads
from middeck.structure.devices import SpringLaw
from middeck.structure.environment import Environment, Suspension
from middeck.structure.frames import frame_poses, points_in_world
from middeck.structure.mesh import Model
from middeck.structure.pinned import PinnedPoints, solve_pinned
from middeck.values import record


@record
class TunedSuspension:
    """Vertical reaction [N] and stiffness [N/m] at each attach point of the suspension."""

    attach: tuple[str, ...]
    reaction: Float[np.ndarray, " attach"]
    stiffness: Float[np.ndarray, " attach"]


def tune_suspension(model: Model, environment: Environment) -> TunedSuspension:
    """Pin the article at its attach points under full gravity; k = (R/g) (2 pi bounce)^2.

    Raises `EquilibriumError` where a device would have to push: a cable cannot.
    """
    suspension = environment.suspension
    if suspension is None:
        return TunedSuspension((), np.zeros(0), np.zeros(0))
    held = PinnedPoints(_attach_points(model, suspension), suspension.held)
    g = float(np.linalg.norm(environment.gravity))
    reaction = solve_pinned(model, environment.gravity, held) @ (-environment.gravity / g)
    _check_pull(suspension.attach, reaction)
    stiffness = reaction / g * (2.0 * np.pi * suspension.bounce_hz) ** 2
    return TunedSuspension(suspension.attach, reaction, stiffness)


def _check_pull(attach: tuple[str, ...], reaction: np.ndarray) -> None:
    for name, value in zip(attach, reaction, strict=True):
        if value <= 0.0:
            raise EquilibriumError(
                f"the cable at {name!r} would be slack: its pinned reaction is {value:.3f} N",
                where=f"suspension at {name!r}",
                hint="move the attach points so that each carries load, or hang the article by fewer",
                reactions_n=dict(zip(attach, map(float, reaction), strict=True)),
            )


def environment_loads(model: Model, environment: Environment, tuned: TunedSuspension) -> Loads:
    """Cables with the tuned law and their anchors straight above, and the environment's own springs."""
    devices = [*_cables(model, environment, tuned), *_ground_springs(model, environment)]
    if not devices:
        none = no_loads()
        return Loads(environment.gravity, none.anchor, none.attach_point, none.law, none.mass)
    attach, anchor, law = zip(*devices, strict=True)
    preload, stiffness, length = np.array(law).T
    return Loads(
        environment.gravity,
        np.array(anchor),
        np.array(attach, dtype=int),
        SpringLaw(preload, stiffness, length),
        np.zeros(len(attach)),
    )


# Pose of the attach point, anchor in W, and (preload, stiffness, length at which the preload acts).
_Device = tuple[int, np.ndarray, tuple[float, float, float]]


def _cables(model: Model, environment: Environment, tuned: TunedSuspension) -> list[_Device]:
    suspension = environment.suspension
    if suspension is None:
        return []
    world = points_in_world(model.points, frame_poses(model.tree, model.rest))
    length = suspension.cable_length
    rise = -environment.gravity / np.linalg.norm(environment.gravity) * length
    return [
        (int(point), world[point] + rise, (float(R), float(k), length))
        for point, R, k in zip(
            _attach_points(model, suspension), tuned.reaction, tuned.stiffness, strict=True
        )
    ]


def _ground_springs(model: Model, environment: Environment) -> list[_Device]:
    return [
        (attach_index(model, s.attach), s.anchor, (0.0, s.stiffness, s.free_length))
        for s in environment.springs
    ]


def attach_index(model: Model, name: str) -> int:
    """Pose of the attach point ``name``; raises `ConfigError` if there is none."""
    if name not in model.attach_names:
        raise ConfigError(
            f"the article has no attach point {name!r}",
            where="environment",
            hint=f"attach points are {', '.join(model.attach_names) or 'none'}",
        )
    return int(model.attach_point[model.attach_names.index(name)])


def _attach_points(model: Model, suspension: Suspension) -> np.ndarray:
    return np.array([attach_index(model, name) for name in suspension.attach], dtype=int)
