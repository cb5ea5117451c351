"""Rigid frames with minimal coordinates, and how what happens at a point of a frame reaches them.

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

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Inexact, Int

from middeck.structure.elements.rotations import cross, rotation_exp, skew, symmetric_double_cross
from middeck.structure.elements.since_drawn import SinceDrawn, carried_step, move_since_drawn, whole_motion
from middeck.values import record


@record
class FrameTree:
    """Topology: ``roots`` root frames first, then one frame per joint, parents before children.

    ``slides`` marks the joints that shift along their axis instead of turning about it.
    """

    roots: int
    parent: Int[np.ndarray, " joint"]
    offset: Inexact[np.ndarray, "joint 3"]
    axis: Inexact[np.ndarray, "joint 3"]
    slides: Bool[np.ndarray, " joint"]

    @property
    def size(self) -> int:
        """Number of coordinates: six per root, one per joint."""
        return 6 * self.roots + len(self.parent)


@record
class Configuration:
    """Where the frames are: root positions and rotation matrices, joint angles [rad] or travels [m].

    ``since_drawn`` says where the roots are with the digits that ``x`` and ``R`` cannot hold; None where
    nobody has followed them from the drawn state.
    """

    x: Inexact[np.ndarray, "root 3"]
    R: Inexact[np.ndarray, "root 3 3"]
    angle: Inexact[np.ndarray, " joint"]
    since_drawn: SinceDrawn | None = None


@record
class Poses:
    """World origin and rotation of every frame, and the world axis of every joint."""

    p: Inexact[np.ndarray, "frame 3"]
    R: Inexact[np.ndarray, "frame 3 3"]
    axis: Inexact[np.ndarray, "joint 3"]


@record
class PosePoints:
    """Points on frames: frame index and offset in frame axes [m]."""

    frame: Int[np.ndarray, " pose"]
    offset: Inexact[np.ndarray, "pose 3"]


def move(tree: FrameTree, config: Configuration, q: Inexact[np.ndarray, " coordinate"]) -> Configuration:
    """The configuration after the increment ``q``."""
    step = q[: 6 * tree.roots].reshape(-1, 6)
    angle = config.angle + q[6 * tree.roots :]
    if config.since_drawn is not None:
        moved = move_since_drawn(
            config.since_drawn, config.R, carried_step(config.since_drawn, config.x, step)
        )
        return placed(moved, angle)
    return Configuration(config.x + step[:, :3], rotation_exp(step[:, 3:]) @ config.R, angle)


def move_carried(
    tree: FrameTree, config: Configuration, q: Inexact[np.ndarray, " coordinate"]
) -> Configuration:
    """Like `move`, ``q`` being in carried coordinates; of what is followed from the drawn state only."""
    if config.since_drawn is None:
        return move(tree, config, q)
    step = q[: 6 * tree.roots].reshape(-1, 6)
    return placed(move_since_drawn(config.since_drawn, config.R, step), config.angle + q[6 * tree.roots :])


def placed(since_drawn: SinceDrawn, angle: Inexact[np.ndarray, " joint"]) -> Configuration:
    """The configuration whose roots have moved so since the drawn state."""
    shift, turn = whole_motion(since_drawn)
    return Configuration(since_drawn.drawn + shift, np.eye(3) + turn, angle, since_drawn)


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
    for j, parent in enumerate(tree.parent):
        axes[j] = R[parent] @ tree.axis[j]
        shift = config.angle[j] * axes[j] if tree.slides[j] else 0.0
        p[tree.roots + j] = p[parent] + R[parent] @ tree.offset[j] + shift
        turn = np.eye(3) if tree.slides[j] else rotation_exp(tree.axis[j] * config.angle[j])
        R[tree.roots + j] = R[parent] @ turn
    return Poses(p, R, axes)


def points_in_world(points: PosePoints, poses: Poses) -> Inexact[np.ndarray, "pose 3"]:
    """World positions of the points."""
    return poses.p[points.frame] + (poses.R[points.frame] @ points.offset[:, :, None])[:, :, 0]


def joint_chain(tree: FrameTree, frame: int) -> tuple[int, list[int]]:
    """Root of a frame and the joints from the root out to it."""
    joints: list[int] = []
    while frame >= tree.roots:
        joints.insert(0, frame - tree.roots)
        frame = int(tree.parent[frame - tree.roots])
    return frame, joints


def pose_jacobian(tree: FrameTree, points: PosePoints, poses: Poses) -> sp.csr_array:
    """Sparse A (6 rows a pose, one column a coordinate): first-order change of every pose."""
    world = points_in_world(points, poses)
    root = points.frame.copy()
    jointed = np.flatnonzero(points.frame >= tree.roots)
    chains = [joint_chain(tree, int(points.frame[a])) for a in jointed]
    root[jointed] = [chain[0] for chain in chains]
    blocks = np.zeros((len(root), 6, 6), dtype=world.dtype)
    blocks[:] = np.eye(6)
    blocks[:, :3, 3:] = -skew(world - poses.p[root])
    at, row, column = np.nonzero(blocks)
    rows, columns, values = [6 * at + row], [6 * root[at] + column], [blocks[at, row, column]]
    for a, (_, joints) in zip(jointed, chains, strict=True):
        for j in joints:
            rows.append(6 * a + np.arange(6))
            columns.append(np.full(6, 6 * tree.roots + j))
            values.append(np.concatenate(_joint_twist(tree, poses, j, world[a])))
    index = (np.concatenate(rows), np.concatenate(columns))
    shape = (6 * len(root), tree.size)
    return sp.csr_array(sp.coo_array((np.concatenate(values), index), shape=shape))


def _joint_twist(tree: FrameTree, poses: Poses, j: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity of the point ``x`` and angular velocity for a unit rate of joint ``j``."""
    w = poses.axis[j]
    return (w, np.zeros_like(w)) if tree.slides[j] else (cross(w, x - poses.p[tree.roots + j]), w)


def pose_stiffness(
    tree: FrameTree, points: PosePoints, poses: Poses, load: Inexact[np.ndarray, "pose 6"]
) -> sp.csr_array:
    """Second-order part of the poses weighted by ``load``, the energy gradient (F, M) at each pose."""
    world = points_in_world(points, poses)
    offset = np.flatnonzero(np.any(points.offset != 0.0, axis=1) & (points.frame < tree.roots))
    root = points.frame[offset]
    turn = 6 * root[:, None] + np.arange(3, 6)
    values = [symmetric_double_cross(load[offset, :3], world[offset] - poses.p[root]).ravel()]
    rows = [np.repeat(turn, 3, axis=1).ravel()]
    columns = [np.tile(turn, (1, 3)).ravel()]
    for a in np.flatnonzero(points.frame >= tree.roots):
        index, block = _jointed_stiffness(tree, poses, int(points.frame[a]), world[a], load[a])
        values.append(block.ravel())
        rows.append(np.repeat(index, len(index)))
        columns.append(np.tile(index, len(index)))
    index = (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(sp.coo_array((np.concatenate(values), index), shape=(tree.size, tree.size)))


def _jointed_stiffness(
    tree: FrameTree, poses: Poses, frame: int, x: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    F, M = load[:3], load[3:]
    root, joints = joint_chain(tree, frame)
    index = np.concatenate([6 * root + np.arange(3, 6), 6 * tree.roots + np.array(joints, dtype=int)])
    block = np.zeros((len(index), len(index)), dtype=np.result_type(x, load))
    block[:3, :3] = symmetric_double_cross(F, x - poses.p[root])
    turns = [np.zeros(3) if tree.slides[j] else poses.axis[j] for j in joints]
    for b, j in enumerate(joints):
        shift, turn = _joint_twist(tree, poses, j, x)
        # d2E for any outer rotation o: o . (shift x F + (turn x M)/2); for itself only F . (turn x shift).
        pull = cross(shift, F) + 0.5 * cross(turn, M)
        block[:3, 3 + b] = block[3 + b, :3] = pull
        for c in range(b):
            block[3 + c, 3 + b] = block[3 + b, 3 + c] = turns[c] @ pull
        block[3 + b, 3 + b] = F @ cross(turn, shift)
    return index, block
