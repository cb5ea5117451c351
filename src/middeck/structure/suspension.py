"""From an environment to loads: pinned reactions, then the stiffness of each device (the paper's step 1)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import EquilibriumError
from middeck.structure.article import AttachPoint
from middeck.structure.assembly import Loads, no_loads
from middeck.structure.devices import SpringLaw
from middeck.structure.environment import Environment, Suspension
from middeck.structure.frames import frame_poses, points_in_world
from middeck.structure.mesh import Model
from middeck.structure.statics import PinnedPoints, solve_pinned
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
    points = _attach_points(model, suspension)
    held = PinnedPoints(points, suspension.held)
    force = solve_pinned(model, environment.gravity, held)
    g = float(np.linalg.norm(environment.gravity))
    up = -environment.gravity / g
    reaction = force @ up
    for name, value in zip(suspension.attach, reaction, strict=True):
        if value <= 0.0:
            raise EquilibriumError(
                f"the cable at {name!r} would be slack: its pinned reaction is {value:.3f} N",
                where=f"suspension at {name!r}",
                hint="move the attach points so that each carries load, or hang the article by fewer",
                reactions_n=dict(zip(suspension.attach, map(float, reaction), strict=True)),
            )
    stiffness = reaction / g * (2.0 * np.pi * suspension.bounce_hz) ** 2
    return TunedSuspension(suspension.attach, reaction, stiffness)


def environment_loads(model: Model, environment: Environment, tuned: TunedSuspension) -> Loads:
    """Cables with the tuned law and their anchors straight above, and the environment's own springs."""
    loads = no_loads()
    poses = frame_poses(model.tree, model.rest)
    world = points_in_world(model.points, poses)
    attach: list[int] = []
    anchors: list[np.ndarray] = []
    laws: list[tuple[float, float, float]] = []
    if environment.suspension is not None:
        up = -environment.gravity / np.linalg.norm(environment.gravity)
        length = environment.suspension.cable_length
        for point, R, k in zip(
            _attach_points(model, environment.suspension), tuned.reaction, tuned.stiffness, strict=True
        ):
            attach.append(point)
            anchors.append(world[point] + length * up)
            laws.append((R, k, length))
    for spring in environment.springs:
        attach.append(attach_index(model, spring.attach))
        anchors.append(spring.anchor)
        laws.append((0.0, spring.stiffness, spring.free_length))
    if not attach:
        return Loads(environment.gravity, loads.anchor, loads.attach_point, loads.law)
    preload, stiffness, length = np.array(laws).T
    return Loads(
        environment.gravity,
        np.array(anchors),
        np.array(attach, dtype=int),
        SpringLaw(preload, stiffness, length),
    )


def attach_index(model: Model, name: str) -> int:
    """Pose of the attach point ``name``."""
    if name not in model.attach_names:
        known: tuple[AttachPoint, ...] = model.structure.attach_points
        raise EquilibriumError(
            f"the article has no attach point {name!r}",
            where="environment",
            hint=f"attach points are {', '.join(a.name for a in known) or 'none'}",
        )
    return int(model.attach_point[model.attach_names.index(name)])


def _attach_points(model: Model, suspension: Suspension) -> np.ndarray:
    return np.array([attach_index(model, name) for name in suspension.attach], dtype=int)
