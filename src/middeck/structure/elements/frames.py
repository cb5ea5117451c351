"""Rigid frames with minimal coordinates, and the map from points of a frame to them.

A *root* frame has six coordinates: dx and a world rotation vector theta, R_new = exp(theta) R. A *joint*
frame has one: its angle, or the travel of a slide. A *pose* is a point of a frame with a triad fixed to it;
every element, body and device sees poses only. Moving coordinates by q changes a pose, in its own chart
(dx, theta), by

    A q + (1/2) q' H q + ...

where for rotations i outside j about the world axes w through the points p:  d2x = w_i x (w_j x (x - p_j)),
d2theta = (1/2) w_i x w_j  (composition of finite rotations to second order, Bronshtein-Baker-Campbell-
Hausdorff). A slide carries along but does not turn: as j it gives w_i x w_j, as i nothing. With both terms
offset masses, rigid offsets and gimbals under load have their exact tangent: this is where m g h comes from.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact

from middeck.structure.elements.motion_since_drawn import (
    SinceDrawn,
    carried_step,
    move_since_drawn,
    whole_motion,
)
from middeck.structure.elements.offset_points import map_points
from middeck.structure.elements.rotations import IDENTITY, rotation_exp, skew
from middeck.structure.elements.trees import FrameTree, PosePoints, Poses
from middeck.values import record

Found = TypeVar("Found")


@record
class Configuration:
    """Places of the frames: root positions and rotation matrices, joint angles [rad] or travels [m].

    ``since_drawn`` gives the roots' motion with digits that ``x`` and ``R`` cannot hold; None if they were
    not followed from the drawn state.
    """

    x: Inexact[np.ndarray, "root 3"]
    R: Inexact[np.ndarray, "root 3 3"]
    angle: Inexact[np.ndarray, " joint"]
    since_drawn: SinceDrawn | None = None

    def once(self, what: str, model: object, compute: Callable[[], Found]) -> Found:
        """``compute()``, which depends on this configuration and ``model`` alone, computed once for both."""
        known = vars(self).get(what)
        if known is None or known[0]() is not model:
            known = vars(self)[what] = (weakref.ref(model), compute())
        return known[1]


def move(tree: FrameTree, config: Configuration, q: Inexact[np.ndarray, " coordinate"]) -> Configuration:
    """The configuration after the increment ``q``."""
    step = q[: 6 * tree.roots].reshape(-1, 6)
    angle = config.angle + q[6 * tree.roots :]
    since = config.since_drawn
    if since is not None:
        return placed(move_since_drawn(since, config.R, carried_step(since, config.x, step)), angle)
    return Configuration(config.x + step[:, :3], rotation_exp(step[:, 3:]) @ config.R, angle)


def move_carried(
    tree: FrameTree, config: Configuration, q: Inexact[np.ndarray, " coordinate"]
) -> Configuration:
    """`move` with ``q`` in carried coordinates; only for configurations followed from the drawn state."""
    if config.since_drawn is None:
        return move(tree, config, q)
    step = q[: 6 * tree.roots].reshape(-1, 6)
    return placed(move_since_drawn(config.since_drawn, config.R, step), config.angle + q[6 * tree.roots :])


def placed(since_drawn: SinceDrawn, angle: Inexact[np.ndarray, " joint"]) -> Configuration:
    """The configuration after these motions of the roots since drawn."""
    shift, turn = whole_motion(since_drawn)
    return Configuration(since_drawn.drawn + shift, IDENTITY + turn, angle, since_drawn)


def rigid_columns(
    tree: FrameTree, config: Configuration, centre: Inexact[np.ndarray, "3"]
) -> Inexact[np.ndarray, "coordinate 6"]:
    """Unit translations along and unit rotations about the world axes through ``centre``, joints held."""
    columns = np.zeros((tree.size, 6))
    step = columns[: 6 * tree.roots].reshape(tree.roots, 6, 6)
    step[:, :3, :3] = step[:, 3:, 3:] = np.eye(3)
    step[:, :3, 3:] = -skew(config.x - centre)
    return columns


def frame_poses(tree: FrameTree, config: Configuration) -> Poses:
    """World poses of all frames."""
    dtype = np.result_type(config.x, config.R, config.angle, tree.offset, tree.axis)
    joints = len(tree.parent)
    p, R = np.zeros((tree.roots + joints, 3), dtype), np.zeros((tree.roots + joints, 3, 3), dtype)
    p[: tree.roots], R[: tree.roots] = config.x, config.R
    axes = np.zeros((joints, 3), dtype)
    turns = np.where(tree.slides[:, None], 0.0, tree.axis * config.angle[:, None])
    own = rotation_exp(turns) if joints else R[:0]
    for level in tree.levels:
        parent, frame = tree.parent[level], tree.roots + level
        axes[level] = np.matvec(R[parent], tree.axis[level])
        p[frame] = p[parent] + np.matvec(R[parent], tree.offset[level])
        p[frame] += np.where(tree.slides[level], config.angle[level], 0.0)[:, None] * axes[level]
        R[frame] = R[parent] @ own[level]
    return Poses(p, R, axes)


def points_in_world(points: PosePoints, poses: Poses) -> Inexact[np.ndarray, "pose 3"]:
    """World positions of the points."""
    return poses.p[points.frame] + np.matvec(poses.R[points.frame], points.offset)


def pose_jacobian(tree: FrameTree, points: PosePoints, poses: Poses) -> sp.csr_array:
    """Sparse A (6 rows a pose, one column a coordinate): first-order change of every pose."""
    return map_points(tree, points).jacobian(poses)
