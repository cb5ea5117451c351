"""Springs, devices, bushings and sprung joints at their places."""

from __future__ import annotations

import numpy as np
from jaxtyping import Inexact

from middeck.structure.assembly.environment_loads import Inner, Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import Placement, drawn_places, moved_since, poses_at
from middeck.structure.elements.bushings import NO_BUSHINGS, BushingState, bushing_state
from middeck.structure.elements.frames import Configuration, points_in_world
from middeck.structure.elements.motion_since_drawn import seen_from
from middeck.structure.elements.springs_and_cables import (
    NO_SPRINGS,
    SpringLaw,
    SpringState,
    spring_state,
)
from middeck.structure.model.article import JointState


def own_law(model: Model) -> SpringLaw:
    """Law of the structure's own springs."""
    own = model.structure.springs
    return SpringLaw(
        np.zeros(len(own)), np.array([s.stiffness for s in own]), np.array([s.free_length for s in own])
    )


def own_span(model: Model, at: Placement) -> tuple[np.ndarray, np.ndarray]:
    """End minus start of the structure's own springs as drawn, and its change since."""
    (start, start_moved), (end, end_moved) = (drawn_places(model, at, p) for p in model.spring_ends.T)
    return end - start, end_moved - start_moved


def own_springs(model: Model, at: Placement, tension: np.ndarray | None) -> SpringState:
    """State of the structure's own springs; ``tension`` replaces theirs."""
    if not len(model.spring_ends):
        return NO_SPRINGS
    drawn, change = own_span(model, at)
    return spring_state(own_law(model), drawn + change, tension, (drawn, change))


def device_springs(model: Model, at: Placement, loads: Loads, tension: np.ndarray | None) -> SpringState:
    """State of devices; ``tension`` replaces theirs."""
    if not len(loads.attach_point):
        return NO_SPRINGS
    drawn, change = device_span(model, at, loads)
    return spring_state(loads.law, drawn + change, tension, (drawn, change))


def device_span(model: Model, at: Placement, loads: Loads) -> tuple[np.ndarray, np.ndarray]:
    """The same for devices, from anchor to attach point."""
    drawn, change = drawn_places(model, at, loads.attach_point)
    return drawn - loads.anchor, change


def device_tension(model: Model, config: Configuration, loads: Loads) -> Inexact[np.ndarray, " device"]:
    """Pull of each device at ``config``."""
    return device_springs(model, poses_at(model, config), loads, None).tension


def pose_shift(model: Model, config: Configuration, pose: np.ndarray) -> Inexact[np.ndarray, "pose 3"]:
    """Displacement of poses since they were drawn."""
    drawn, change = drawn_places(model, poses_at(model, config), pose)
    return change + (drawn - points_in_world(model.points.of(pose), model.drawn))


def bushing_states(model: Model, config: Configuration, loads: Loads) -> tuple[BushingState, BushingState]:
    """States of the structure's own bushings, and of those to the ground."""
    at = poses_at(model, config)
    return own_bushings(model, at), grounded(model, at, loads)


def own_bushings(
    model: Model, at: Placement, inner: Inner | None = None, *, inside: bool = False
) -> BushingState:
    """Bushings of the structure; those ``inside`` carried parts with the digits that their carriers see."""
    own = model.structure.bushings
    if not own:
        return NO_BUSHINGS
    start, end = model.bushing_ends.T
    (begin, begun), (finish, finished) = (moved_since(model, at, pose) for pose in (start, end))
    span, change = at.world[end] - at.world[start], finish - begin
    turn = np.stack([begun, finished], axis=1)
    axes = np.tile(np.eye(3), (len(own), 1, 1))
    if inside and at.since is not None and at.since.carries:
        rows = model.inside.bushings.rows
        outer = model.inside.bushings.outer[rows]
        ends = model.bushing_ends[rows]
        frame, offset = model.points.frame[ends], model.points.offset[ends]
        seen = seen_from(at.since, frame.ravel(), offset.reshape(-1, 3), np.repeat(outer, 2))
        shift, turn[rows] = seen[0].reshape(-1, 2, 3), seen[1].reshape(-1, 2, 3, 3)
        change[rows] = shift[:, 1] - shift[:, 0]
        drawn = at.since.drawn[frame] + offset
        span[rows] = drawn[:, 1] - drawn[:, 0] + change[rows]
        axes[rows] = at.poses.R[outer]
    state = bushing_state(
        np.array([b.stiffness for b in own]).reshape(-1, 6, 6),
        np.array([b.axes for b in own]).reshape(-1, 3, 3),
        span,
        change,
        turn,
        None if inner is None else inner.bushing.copy(),  # cleared by `_gather`
    )
    return state.turned(axes) if inside else state


def grounded(model: Model, at: Placement, loads: Loads, inner: Inner | None = None) -> BushingState:
    """Bushings to the ground, which is the first of their frames and does not move."""
    point = loads.ground.point
    if not len(point):
        return NO_BUSHINGS
    change, turn = moved_since(model, at, point)
    still = np.stack([np.zeros_like(turn), turn], axis=1)
    force = None if inner is None else inner.ground
    return bushing_state(loads.ground.stiffness, loads.ground.axes, change, change, still, force)


def on_ground(motion: np.ndarray) -> np.ndarray:
    """Motions of poses, and that of the ground beside them: none."""
    return np.concatenate([np.zeros_like(motion), motion], axis=1)


def sprung_joints(model: Model, config: Configuration) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy, gradient and the tangent's diagonal."""
    joints, none = model.structure.joints, np.zeros(6 * model.tree.roots)
    k = np.array([j.stiffness if j.state is JointState.SPRUNG else 0.0 for j in joints]) + 0.0
    turn = config.angle - np.array([j.target for j in joints])
    return 0.5 * np.sum(k * turn**2), np.concatenate([none, k * turn]), np.concatenate([none, k])


def at_attach_points(model: Model, loads: Loads, hessian: np.ndarray) -> np.ndarray:
    """Matrices of devices on translations, summed at their attach points."""
    return at_poses(model, loads.attach_point, on_translations(hessian))


def at_poses(model: Model, points: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    """Matrices on attach points, summed where there are several."""
    place = np.zeros(len(model.points.frame), dtype=int)
    place[model.attach_point] = np.arange(len(model.attach_point))
    out = np.zeros((len(model.attach_point), 6, 6), dtype=hessian.dtype)
    np.add.at(out, place[points], hessian)
    return out


def on_translations(hessian: np.ndarray) -> np.ndarray:
    """Matrices (.., 3, 3) of translations as those (.., 6, 6) of poses."""
    out = np.zeros((len(hessian), 6, 6), dtype=hessian.dtype)
    out[:, :3, :3] = hessian
    return out
