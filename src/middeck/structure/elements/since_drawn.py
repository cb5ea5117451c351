"""Motion of roots since the drawn state, each relative to the root that carries it.

A link of 1e22 N/m bears its load with 1e-21 m, and no coordinate in W can hold that beside the centimetres
that the article sinks. What a stiff part does to its neighbour is therefore a number of its own: the motion
of a *carried* root is kept as its carrier sees it, in the carrier's axes, and rounds at its own size. A root
without a carrier is seen from W, where only its displacement rounds, never its coordinates.

Coordinates of carried roots follow suit: (rho, phi) of a root i with the carrier c moves it by

    dx_i = dx_c + theta_c x (x_i - x_c) + rho_i,    theta_i = theta_c + phi_i

to first order, the carrier being outside the root as a joint's carrier is in `frames`: exp(theta_c) turns
what exp(phi_i) has turned.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Inexact, Int

from middeck.structure.elements.rotations import cross, skew, symmetric_double_cross, turn_of
from middeck.values import record


@record
class SinceDrawn:
    """Drawn place of every root in W, the root that carries it (-1: none), and its motion since.

    ``shift`` [m] is that of the root's origin, ``turn`` its rotation matrix less the identity; both in the
    axes of the carrier, which are those of W in the drawn state.
    """

    drawn: Inexact[np.ndarray, "root 3"]
    carrier: Int[np.ndarray, " root"]
    shift: Inexact[np.ndarray, "root 3"]
    turn: Inexact[np.ndarray, "root 3 3"]

    @property
    def carries(self) -> bool:
        """Whether any root is carried."""
        return bool(np.any(self.carrier >= 0))


def as_drawn(drawn: Inexact[np.ndarray, "root 3"], carrier: Int[np.ndarray, " root"]) -> SinceDrawn:
    """Nothing has moved."""
    return SinceDrawn(drawn, carrier, np.zeros_like(drawn), np.zeros((len(drawn), 3, 3)))


def whole_motion(at: SinceDrawn) -> tuple[np.ndarray, np.ndarray]:
    """Shift and turn of every root as seen from W."""
    if not at.carries:
        return at.shift, at.turn
    roots = np.arange(len(at.shift))
    return seen_from(at, roots, np.zeros((len(roots), 3)), np.full(len(roots), -1))


def seen_from(
    at: SinceDrawn, root: np.ndarray, offset: np.ndarray, outer: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shift and turn of points ``offset`` on roots, each as seen from ``outer``: itself, a carrier, or -1."""
    shift = np.zeros_like(offset)
    turn = np.zeros((len(root), 3, 3))
    root, offset = root.copy(), offset.copy()
    left = np.flatnonzero(root != outer)
    while len(left):
        r = root[left]
        E, inner = at.turn[r], shift[left]
        arm = offset[left]
        shift[left] = at.shift[r] + _apply(E, arm + inner) + inner
        turn[left] = E + turn[left] + E @ turn[left]
        up = at.carrier[r]
        offset[left] = arm + np.where(up[:, None] >= 0, at.drawn[r] - at.drawn[up], 0.0)
        root[left] = up
        left = left[up != outer[left]]
    return shift, turn


def _apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (matrices @ vectors[:, :, None])[:, :, 0]


def carried_step(
    at: SinceDrawn, x: Inexact[np.ndarray, "root 3"], step: Inexact[np.ndarray, "root 6"]
) -> Inexact[np.ndarray, "root 6"]:
    """Increments in W as the carriers see them, to first order."""
    if not at.carries:
        return step
    own, up = np.flatnonzero(at.carrier >= 0), at.carrier[at.carrier >= 0]
    out = np.array(step)
    out[own] -= step[up]
    out[own, :3] -= cross(step[up, 3:], x[own] - x[up])
    return out


def move_since_drawn(
    at: SinceDrawn, R: Inexact[np.ndarray, "root 3 3"], step: Inexact[np.ndarray, "root 6"]
) -> SinceDrawn:
    """After increments as the carriers see them, in the axes of W; ``R`` are the rotations before it."""
    rho, phi = step[:, :3], step[:, 3:]
    if at.carries:
        axes = np.where((at.carrier >= 0)[:, None, None], np.swapaxes(R[at.carrier], 1, 2), np.eye(3))
        rho, phi = _apply(axes, rho), _apply(axes, phi)
    turn = turn_of(phi)
    return SinceDrawn(at.drawn, at.carrier, at.shift + rho, turn + at.turn + turn @ at.turn)


def common_carrier(at: SinceDrawn, roots: Int[np.ndarray, "pair 2"]) -> Int[np.ndarray, " pair"]:
    """The innermost root that both of a pair are, or are carried by; -1 where there is none."""
    out = np.full(len(roots), -1)
    for a in _ancestors(at.carrier, roots[:, 0]):
        for b in _ancestors(at.carrier, roots[:, 1]):
            out = np.where((out < 0) & (a == b), a, out)
    return out


def _ancestors(carrier: np.ndarray, root: np.ndarray) -> list[np.ndarray]:
    """The roots themselves, their carriers, the carriers of these, as far as there are any."""
    out: list[np.ndarray] = []
    while np.any(root >= 0):
        out.append(root)
        root = np.where(root >= 0, carrier[root], -1)
    return out


def chain_within(
    at: SinceDrawn, root: Int[np.ndarray, " pose"], outer: Int[np.ndarray, " pose"]
) -> list[np.ndarray]:
    """The root of each pose, its carrier and so on, up to ``outer``; -1 from there on."""
    out: list[np.ndarray] = []
    root = np.where(root == outer, -1, root)
    while np.any(root >= 0):
        out.append(root)
        up = at.carrier[root]
        root = np.where((root < 0) | (up == outer), -1, up)
    return out


def chain_jacobian(
    chain: list[np.ndarray],
    origin: Inexact[np.ndarray, "root 3"],
    world: np.ndarray,
    size: int,
    joints: int = 0,
) -> sp.csr_array:
    """First-order change of poses at ``world`` by the carried coordinates of the roots in their chains.

    Below the poses so many ``joints``, the last coordinates, follow as they are.
    """
    rows = [6 * len(world) + np.arange(joints)]
    columns = [size - joints + np.arange(joints)]
    values = [np.ones(joints)]
    for link in chain:
        pose = np.flatnonzero(link >= 0)
        block = np.tile(np.eye(6), (len(pose), 1, 1))
        block[:, :3, 3:] = -skew(world[pose] - origin[link[pose]])
        at, row, column = np.nonzero(block)
        rows.append(6 * pose[at] + row)
        columns.append(6 * link[pose][at] + column)
        values.append(block[at, row, column])
    index = (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(sp.coo_array((np.concatenate(values), index), shape=(6 * len(world) + joints, size)))


def chain_stiffness(
    chain: list[np.ndarray],
    origin: Inexact[np.ndarray, "root 3"],
    world: np.ndarray,
    load: Inexact[np.ndarray, "pose 6"],
    size: int,
) -> sp.csr_array:
    """Second-order change of the same poses, weighted by ``load``, the energy gradient (F, M) at each."""
    rows: list[np.ndarray] = [np.zeros(0, int)]
    columns: list[np.ndarray] = [np.zeros(0, int)]
    values: list[np.ndarray] = [np.zeros(0)]

    def add(first: np.ndarray, second: np.ndarray, blocks: np.ndarray) -> None:
        """Blocks of the rotations of ``first`` and the last coordinates of ``second``."""
        width = blocks.shape[2]
        rows.append(np.repeat(6 * first[:, None] + np.arange(3, 6), width, axis=1).ravel())
        columns.append(np.tile(6 * second[:, None] + np.arange(6 - width, 6), (1, 3)).ravel())
        values.append(blocks.ravel())

    for k, inner in enumerate(chain):
        pose = np.flatnonzero(inner >= 0)
        F, M = load[pose, :3], load[pose, 3:]
        arm = world[pose] - origin[inner[pose]]
        add(inner[pose], inner[pose], symmetric_double_cross(F, arm))
        # An outer rotation o: o . (e x F) for a shift e, o . ((e x arm) x F + (e x M)/2) for a turn e.
        pull = np.zeros((len(pose), 3, 6))
        pull[:, :, :3] = -skew(F)
        pull[:, :, 3:] = skew(F) @ skew(arm) - 0.5 * skew(M)
        for outer in chain[k + 1 :]:
            some = np.flatnonzero(outer[pose] >= 0)
            first, second = outer[pose[some]], inner[pose[some]]
            add(first, second, pull[some])
            rows.append(columns[-1])
            columns.append(rows[-2])
            values.append(values[-1])
    index = (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(sp.coo_array((np.concatenate(values), index), shape=(size, size)))


def uncarried(at: SinceDrawn | None, size: int) -> Bool[np.ndarray, " coordinate"]:
    """The coordinates of roots that nothing carries, and of joints."""
    out = np.ones(size, dtype=bool)
    if at is not None:
        out[: 6 * len(at.carrier)] = np.repeat(at.carrier < 0, 6)
    return out
