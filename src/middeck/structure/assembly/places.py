"""Places at a configuration, motion since drawn, and the carriers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact

from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import (
    Configuration,
    FrameTree,
    Poses,
    frame_poses,
    points_in_world,
)
from middeck.structure.elements.motion_since_drawn import (
    Lever,
    SinceDrawn,
    Triplets,
    chain_within,
    lever_jacobian,
    lever_stiffness,
    levers,
    whole_motion,
)
from middeck.structure.elements.rotations import IDENTITY
from middeck.structure.elements.sparse_of_parts import identity


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """Poses and angles; where known, motion of the roots since drawn, and shift and turn as seen from W."""

    poses: Poses
    angle: np.ndarray
    world: np.ndarray
    since: SinceDrawn | None
    motion: tuple[np.ndarray, np.ndarray]


def poses_at(model: Model, config: Configuration) -> Placement:
    """Poses of all points of the model at ``config``."""
    return config.once("at", model, lambda: _poses_at(model, config))


def _poses_at(model: Model, config: Configuration) -> Placement:
    poses, since = frame_poses(model.tree, config), config.since_drawn
    motion = (np.zeros((0, 3)), np.zeros((0, 3, 3))) if since is None else whole_motion(since)
    world = points_in_world(model.points, poses)
    for shared in (world, *motion):
        shared.setflags(write=False)
    return Placement(poses=poses, angle=config.angle, world=world, since=since, motion=motion)


def moved_since(model: Model, at: Placement, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift and turn (less the identity) of poses since drawn."""
    frame, drawn = model.points.frame[pose], model.drawn
    away = at.world[pose] - points_in_world(model.points.of(pose), drawn)
    turn = at.poses.R[frame] @ np.swapaxes(drawn.R[frame], 1, 2) - IDENTITY
    if at.since is None:
        return away, turn
    own, moved = frame < model.tree.roots, drawn_places(model, at, pose)[1]
    root = np.where(own, frame, 0)
    return np.where(own[:, None], moved, away), np.where(own[:, None, None], at.motion[1][root], turn)


def drawn_places(model: Model, at: Placement, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drawn places of poses and their shift since; on a joint's frame the present place and no shift."""
    frame, offset = model.points.frame[pose], model.points.offset[pose]
    if at.since is None:
        return at.world[pose], np.zeros_like(at.world[pose])
    own = frame < model.tree.roots
    root = np.where(own, frame, 0)
    change = at.motion[0][root] + np.matvec(at.motion[1][root], offset)
    drawn = np.where(own[:, None], at.since.drawn[root] + offset, at.world[pose])
    return drawn, np.where(own[:, None], change, 0.0)


def root_levers(config: Configuration) -> list[Lever]:
    """Motion of the roots by carried coordinates; none where nothing is carried."""
    since, roots = config.since_drawn, np.arange(len(config.x))
    if since is None or not since.carries:
        return []
    chain = chain_within(since, roots, np.full(len(roots), -1))
    return levers((link[:, None] for link in chain), config.x, config.x[:, None])


def carried_turning(links: list[Lever], gradient: Inexact[np.ndarray, " coordinate"]) -> list[Triplets]:
    """Second-order motion of the roots in W by carried coordinates, weighted by the ``gradient`` in W."""
    roots = len(links[0].root)
    return lever_stiffness(links, gradient[: 6 * roots].reshape(-1, 1, 6))


def transport(config: Configuration, tree: FrameTree) -> sp.csr_array:
    """Motions of the coordinates in W per carried coordinate; the identity where nothing is carried."""
    links = root_levers(config)
    return lever_jacobian(links, tree.size) if links else identity(tree.size)


def symmetric(K: sp.csr_array) -> sp.csr_array:
    """The symmetric part, of a matrix that rounding alone made unsymmetric."""
    out = K + K.T.tocsr()
    out.data *= 0.5
    return out
