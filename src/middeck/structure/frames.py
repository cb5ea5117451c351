"""Rigid frames with minimal coordinates, and how what happens at a point of a frame reaches them.

A *root* frame has six coordinates: dx and a world rotation vector theta, R_new = exp(theta) R. A *joint*
frame has one: its angle. A *pose* is a point of a frame with a triad fixed to it; every element, body and
device sees poses only. Moving coordinates by q changes a pose, in its own chart (dx, theta), by

    A q + (1/2) q' H q + ...

where for rotations i outside j about the world axes w through the points p:  d2x = w_i x (w_j x (x - p_j)),
d2theta = (1/2) w_i x w_j  (composition of finite rotations to second order, Bronshtein-Baker-Campbell-
Hausdorff). With both terms offset masses, rigid offsets and gimbals under load have their exact tangent:
this is where m g h comes from.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.structure.rotations import rotation_exp, skew, symmetric_double_cross
from middeck.values import record


@record
class FrameTree:
    """Topology: ``roots`` root frames first, then one frame per joint, parents before children."""

    roots: int
    parent: Int[np.ndarray, " joint"]
    offset: Float[np.ndarray, "joint 3"]
    axis: Float[np.ndarray, "joint 3"]

    @property
    def size(self) -> int:
        """Number of coordinates: six per root, one per joint."""
        return 6 * self.roots + len(self.parent)


@record
class Configuration:
    """Where the frames are: root positions and rotation matrices, joint angles [rad]."""

    x: Float[np.ndarray, "root 3"]
    R: Float[np.ndarray, "root 3 3"]
    angle: Float[np.ndarray, " joint"]


@record
class Poses:
    """World origin and rotation of every frame, and the world axis of every joint."""

    p: Float[np.ndarray, "frame 3"]
    R: Float[np.ndarray, "frame 3 3"]
    axis: Float[np.ndarray, "joint 3"]


@record
class PosePoints:
    """Points on frames: frame index and offset in frame axes [m]."""

    frame: Int[np.ndarray, " pose"]
    offset: Float[np.ndarray, "pose 3"]


def move(tree: FrameTree, config: Configuration, q: Float[np.ndarray, " coordinate"]) -> Configuration:
    """The configuration after the increment ``q``."""
    step = q[: 6 * tree.roots].reshape(-1, 6)
    return Configuration(
        config.x + step[:, :3],
        rotation_exp(step[:, 3:]) @ config.R,
        config.angle + q[6 * tree.roots :],
    )


def rigid_columns(
    tree: FrameTree, config: Configuration, centre: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "coordinate 6"]:
    """Unit translations along and unit rotations about the world axes through ``centre``, joints held."""
    columns = np.zeros((tree.size, 6))
    step = columns[: 6 * tree.roots].reshape(tree.roots, 6, 6)
    step[:, :3, :3] = step[:, 3:, 3:] = np.eye(3)
    step[:, :3, 3:] = -skew(config.x - centre)
    return columns


def move_whole(
    tree: FrameTree,
    config: Configuration,
    q: Float[np.ndarray, " coordinate"],
    mass: Float[np.ndarray, "coordinate coordinate"],
) -> Configuration:
    """Like `move` to first order, but the rigid motion in ``q`` (by mass) turns the whole without strain.

    Straight displacements stretch what turns: by 1e-3 of its length for a turn of 0.05, far more than a stiff
    member bears, so that a descent with `move` would have to creep.
    """
    T = rigid_columns(tree, config, np.zeros(3))
    rigid, *_ = np.linalg.lstsq(T.T @ mass @ T, T.T @ mass @ q, rcond=None)
    rest = q - T @ rigid
    R = rotation_exp(rigid[3:])
    # The rotation is about the world origin: its second-order part must not carry a far structure along.
    centre = config.x.mean(axis=0)
    shift = rigid[:3] + np.cross(rigid[3:], centre)
    turned = Configuration(centre + shift + (config.x - centre) @ R.T, R @ config.R, config.angle)
    step = rest[: 6 * tree.roots].reshape(-1, 2, 3) @ R.T
    return move(tree, turned, np.concatenate([step.ravel(), rest[6 * tree.roots :]]))


def frame_poses(tree: FrameTree, config: Configuration) -> Poses:
    """World poses of all frames."""
    p, R = list(config.x), list(config.R)
    axes = np.zeros((len(tree.parent), 3))
    for j, parent in enumerate(tree.parent):
        p.append(p[parent] + R[parent] @ tree.offset[j])
        axes[j] = R[parent] @ tree.axis[j]
        R.append(R[parent] @ rotation_exp(tree.axis[j] * config.angle[j]))
    return Poses(np.array(p).reshape(-1, 3), np.array(R).reshape(-1, 3, 3), axes)


def points_in_world(points: PosePoints, poses: Poses) -> Float[np.ndarray, "pose 3"]:
    """World positions of the points."""
    return poses.p[points.frame] + np.einsum("aij,aj->ai", poses.R[points.frame], points.offset)


def joint_chain(tree: FrameTree, frame: int) -> tuple[int, list[int]]:
    """Root of a frame and the joints from the root out to it."""
    joints: list[int] = []
    while frame >= tree.roots:
        joints.insert(0, frame - tree.roots)
        frame = int(tree.parent[frame - tree.roots])
    return frame, joints


def pose_jacobian(tree: FrameTree, points: PosePoints, poses: Poses) -> sp.csr_array:
    """Sparse A (6 rows a pose, one column a coordinate): first-order change of every pose."""
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    world = points_in_world(points, poses)
    root = np.array([joint_chain(tree, int(f))[0] for f in points.frame], dtype=int)
    blocks = np.zeros((len(root), 6, 6))
    blocks[:] = np.eye(6)
    blocks[:, :3, 3:] = -skew(world - poses.p[root])
    at = np.arange(len(root))
    rows.append(np.broadcast_to((6 * at[:, None] + np.arange(6))[:, :, None], blocks.shape))
    columns.append(np.broadcast_to((6 * root[:, None] + np.arange(6))[:, None, :], blocks.shape))
    values.append(blocks)
    for a in np.flatnonzero(points.frame >= tree.roots):
        for j in joint_chain(tree, int(points.frame[a]))[1]:
            w = poses.axis[j]
            rows.append(6 * a + np.arange(6))
            columns.append(np.full(6, 6 * tree.roots + j))
            values.append(np.concatenate([np.cross(w, world[a] - poses.p[tree.roots + j]), w]))
    entries = np.concatenate([v.ravel() for v in values])
    index = (np.concatenate([r.ravel() for r in rows]), np.concatenate([c.ravel() for c in columns]))
    return sp.csr_array((entries, index), shape=(6 * len(root), tree.size))


def pose_stiffness(
    tree: FrameTree, points: PosePoints, poses: Poses, load: Float[np.ndarray, "pose 6"]
) -> sp.csr_array:
    """Second-order part of the poses weighted by ``load``, the energy gradient (F, M) at each pose."""
    world = points_in_world(points, poses)
    K = sp.lil_array((tree.size, tree.size))
    for a in np.flatnonzero(np.any(points.offset != 0.0, axis=1) | (points.frame >= tree.roots)):
        index, block = _one_pose_stiffness(tree, poses, int(points.frame[a]), world[a], load[a])
        K[np.ix_(index, index)] = K[np.ix_(index, index)].toarray() + block
    return K.tocsr()


def _one_pose_stiffness(
    tree: FrameTree, poses: Poses, frame: int, x: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    F, M = load[:3], load[3:]
    root, joints = joint_chain(tree, frame)
    index = np.concatenate([6 * root + np.arange(3, 6), 6 * tree.roots + np.array(joints, dtype=int)])
    block = np.zeros((len(index), len(index)))
    block[:3, :3] = symmetric_double_cross(F, x - poses.p[root])
    axes = [poses.axis[j] for j in joints]
    for b, j in enumerate(joints):
        swing = np.cross(axes[b], x - poses.p[tree.roots + j])
        # d2E for any outer rotation o: o . (swing x F + (w x M)/2); for itself only F . (w x swing).
        pull = np.cross(swing, F) + 0.5 * np.cross(axes[b], M)
        block[:3, 3 + b] = block[3 + b, :3] = pull
        for c in range(b):
            block[3 + c, 3 + b] = block[3 + b, 3 + c] = axes[c] @ pull
        block[3 + b, 3 + b] = F @ np.cross(axes[b], swing)
    return index, block
