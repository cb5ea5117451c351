"""Map from coordinates to the points of a frame tree: laid out once, filled in at every configuration.

The places of the Jacobian's entries depend on the topology alone, so that an iteration that forms it again
and again need not look for them.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact, Int

from middeck.structure.elements.rotations import cross, skew, symmetric_double_cross
from middeck.structure.elements.sparse_of_parts import csr_of
from middeck.structure.elements.trees import FrameTree, PosePoints, Poses, joint_chain
from middeck.values import record

# Places of the off-diagonal entries of a matrix, by rows.
OFF_DIAGONAL = np.array([1, 2, 3, 5, 6, 7])
KEPT, LARGEST = 16, 5_000
"""Layouts that are kept, and the points of the largest: a promise meshes one article hundreds of times."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Special:
    """Points that do not move as a root's origin: those with an offset, and those on joints.

    ``joint`` has their joints from the root out, -1 where there are no more.
    """

    point: Int[np.ndarray, " special"]
    frame: Int[np.ndarray, " special"]
    offset: Inexact[np.ndarray, "special 3"]
    root: Int[np.ndarray, " special"]
    joint: Int[np.ndarray, "special chain"]


@record(kw_only=True)
class JacobianLayout:
    """The Jacobian of points by rows: its pattern, its values but for arms, and where arms and joints go.

    ``moves`` has the coordinates of the root's turn and of the joints of each special point. Matrices of all
    articles of one topology keep these very arrays.
    """

    moves: Int[np.ndarray, "special turn"]
    indptr: np.ndarray
    indices: np.ndarray
    constant: np.ndarray
    arm_slot: Int[np.ndarray, "special 6"]
    joint_slot: Int[np.ndarray, "special chain 6"]


class PoseMap(NamedTuple):
    """How poses of points follow from coordinates."""

    tree: FrameTree
    points: PosePoints
    special: Special
    layout: JacobianLayout

    def jacobian(self, poses: Poses) -> sp.csr_array:
        """Sparse A (6 rows a point, one column a coordinate): first-order change of every point's pose."""
        shape = (6 * len(self.points.frame), self.tree.size)
        return csr_of(self.jacobian_values(poses), self.layout.indices, self.layout.indptr, shape)

    def jacobian_values(self, poses: Poses) -> np.ndarray:
        """The values of `jacobian`, in the order of its pattern."""
        at, arm = self.special, self._arms(poses)
        values = self.layout.constant.astype(np.result_type(arm, poses.R))
        values[self.layout.arm_slot] = -skew(arm).reshape(-1, 9)[:, OFF_DIAGONAL]
        if at.joint.shape[1]:
            own = at.joint >= 0
            values[self.layout.joint_slot[own]] = np.concatenate(self._twists(poses), axis=2)[own]
        return values

    def second_order(self, poses: Poses, load: Inexact[np.ndarray, "point 6"]) -> np.ndarray:
        """Blocks on `JacobianLayout.moves`: second-order part of the poses, weighted by ``load``.

        That is the energy gradient (F, M) at each point; see the formulas of `frames`.
        """
        at = self.special
        F, M = load[at.point, :3], load[at.point, 3:]
        width = self.layout.moves.shape[1]
        block = np.zeros((len(at.point), width, width), dtype=np.result_type(poses.p, load))
        block[:, :3, :3] = symmetric_double_cross(F, self._arms(poses))
        if width == 3:
            return block
        shift, turn = self._twists(poses)
        # d2E for any outer rotation o: o . (shift x F + (turn x M)/2); for itself only F . (turn x shift).
        pull = cross(shift, F[:, None]) + 0.5 * cross(turn, M[:, None])
        block[:, :3, 3:] = np.swapaxes(pull, 1, 2)
        block[:, 3:, :3] = pull
        both = turn @ np.swapaxes(pull, 1, 2)
        outer = np.triu(np.ones((width - 3, width - 3)), 1) * both
        own = np.einsum("sj,sbj->sb", F, cross(turn, shift))
        block[:, 3:, 3:] = outer + np.swapaxes(outer, 1, 2) + own[:, :, None] * np.eye(width - 3)
        return block

    def _arms(self, poses: Poses) -> np.ndarray:
        return self._places(poses) - poses.p[self.special.root]

    def _places(self, poses: Poses) -> np.ndarray:
        at = self.special
        return poses.p[at.frame] + np.matvec(poses.R[at.frame], at.offset)

    def _twists(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and angular velocity (special, chain, 3) for a unit rate of each joint; zero for none."""
        joint = self.special.joint
        axis = np.where((joint >= 0)[:, :, None], poses.axis[joint], 0.0)
        arm = self._places(poses)[:, None] - poses.p[self.tree.roots + joint]
        slides = self.tree.slides[joint][:, :, None]
        return np.where(slides, axis, cross(axis, arm)), np.where(slides, 0.0, axis)


@record(kw_only=True)
class _Movers:
    """Data that fix the places of a Jacobian's entries: roots of a tree, and of points their root, which are
    special, and the joints of these.
    """

    roots: int
    root: Int[np.ndarray, " point"]
    special: Int[np.ndarray, " special"]
    joint: Int[np.ndarray, "special chain"]


def map_points(tree: FrameTree, points: PosePoints) -> PoseMap:
    """Lay out the Jacobian of ``points``."""
    frame = points.frame
    jointed = frame >= tree.roots
    special = np.flatnonzero(np.any(points.offset != 0.0, axis=1) | jointed)
    root = frame.copy()
    chains = {int(f): joint_chain(tree, int(f)) for f in np.unique(frame[jointed])}
    depth = max((len(joints) for _, joints in chains.values()), default=0)
    joint = np.full((len(special), depth), -1)
    for k, point in enumerate(special.tolist()):
        if jointed[point]:
            root[point], joints = chains[int(frame[point])]
            joint[k, : len(joints)] = joints
    of = Special(
        point=special, frame=frame[special], offset=points.offset[special], root=root[special], joint=joint
    )
    movers = _Movers(roots=tree.roots, root=root, special=special, joint=joint)
    lay_out = _lay_out if len(root) <= LARGEST else _lay_out.__wrapped__
    return PoseMap(tree, points, of, lay_out(movers))


@functools.lru_cache(maxsize=KEPT)
def _lay_out(movers: _Movers) -> JacobianLayout:
    root, special, joint, count = movers.root, movers.special, movers.joint, len(movers.root)
    rows, columns, values = _plain(root)
    plain = len(rows)
    arm = np.stack(np.divmod(OFF_DIAGONAL, 3), axis=1)
    rows = np.concatenate([rows, (6 * special[:, None] + arm[:, 0]).ravel()])
    columns = np.concatenate([columns, (6 * root[special, None] + 3 + arm[:, 1]).ravel()])
    chain = np.argwhere(joint >= 0)
    rows = np.concatenate([rows, (6 * special[chain[:, 0], None] + np.arange(6)).ravel()])
    columns = np.concatenate([columns, np.repeat(6 * movers.roots + joint[joint >= 0], 6)])
    values = np.concatenate([values, np.zeros(len(rows) - plain)])
    rank = np.lexsort((columns, rows))
    slot = np.empty(len(rank), dtype=int)
    slot[rank] = np.arange(len(rank))
    joint_slot = np.zeros((*joint.shape, 6), dtype=int)
    joint_slot[joint >= 0] = slot[plain + 6 * len(special) :].reshape(-1, 6)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=6 * count))])
    turn = 6 * root[special, None] + np.arange(3, 6)
    # A chain that is shorter than the longest adds nothing, anywhere.
    index = np.concatenate([turn, np.where(joint >= 0, 6 * movers.roots + joint, turn[:, :1])], axis=1)
    return JacobianLayout(
        moves=index,
        indptr=indptr.astype(np.int32),
        indices=columns[rank].astype(np.int32),
        constant=values[rank],
        arm_slot=slot[plain : plain + 6 * len(special)].reshape(-1, 6),
        joint_slot=joint_slot,
    )


def _plain(root: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points move with their roots."""
    six = np.arange(6)
    rows, columns = 6 * np.arange(len(root))[:, None] + six, 6 * root[:, None] + six
    return rows.ravel(), columns.ravel(), np.ones(6 * len(root))
