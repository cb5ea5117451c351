"""Rigid frames in trees, each carried by another, and points on them."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Bool, Inexact, Int

from middeck.values import record


@record(kw_only=True)
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

    @functools.cached_property
    def turns(self) -> Bool[np.ndarray, " coordinate"]:
        """Whether each coordinate is an angle; the others are shifts."""
        return np.concatenate([np.tile(np.repeat([False, True], 3), self.roots), ~self.slides])

    def frame_of(self, coordinate: int) -> int:
        """The frame that a coordinate moves."""
        return coordinate // 6 if coordinate < 6 * self.roots else coordinate - 5 * self.roots

    @functools.cached_property
    def levels(self) -> tuple[np.ndarray, ...]:
        """Joints on roots, joints on these, and so on."""
        depth = np.zeros(len(self.parent), dtype=int)
        for j, parent in enumerate(self.parent.tolist()):
            depth[j] = depth[parent - self.roots] + 1 if parent >= self.roots else 0
        return tuple(np.flatnonzero(depth == d) for d in range(int(depth.max(initial=-1)) + 1))


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

    def of(self, some: np.ndarray | list[int]) -> PosePoints:
        """Some of the points, by number."""
        return PosePoints(self.frame[some], self.offset[some])


def joint_chain(tree: FrameTree, frame: int) -> tuple[int, list[int]]:
    """Root of a frame and the joints from the root out to it."""
    joints: list[int] = []
    while frame >= tree.roots:
        joints.insert(0, frame - tree.roots)
        frame = int(tree.parent[frame - tree.roots])
    return frame, joints
