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

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Inexact, Int

from middeck.structure.elements.rotations import IDENTITY, cross, skew, symmetric_double_cross, turn_of
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


def whole_motion(at: SinceDrawn) -> tuple[np.ndarray, np.ndarray]:
    """Shift and turn of every root as seen from W."""
    if not at.carries:
        return at.shift, at.turn
    roots = np.arange(len(at.shift))
    return seen_from(at, roots, np.zeros((len(roots), 3)), np.full(len(roots), -1))


def carried_by(at: SinceDrawn, carrier: Int[np.ndarray, " root"]) -> SinceDrawn:
    """The same motion with other carriers."""
    shift, turn = (part.copy() for part in whole_motion(at))
    own, up = np.flatnonzero(carrier >= 0), carrier[carrier >= 0]
    back = np.swapaxes(turn[up], 1, 2) + IDENTITY
    arm = np.matvec(turn[up], at.drawn[own] - at.drawn[up])
    inner = np.matvec(back, shift[own] - shift[up] - arm), back @ (turn[own] - turn[up])
    shift[own], turn[own] = inner
    return SinceDrawn(at.drawn, carrier, shift, turn)


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
        shift[left] = at.shift[r] + np.matvec(E, arm + inner) + inner
        turn[left] = E + turn[left] + E @ turn[left]
        up = at.carrier[r]
        offset[left] = arm + np.where(up[:, None] >= 0, at.drawn[r] - at.drawn[up], 0.0)
        root[left] = up
        left = left[up != outer[left]]
    return shift, turn


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
        axes = np.where((at.carrier >= 0)[:, None, None], np.swapaxes(R[at.carrier], 1, 2), IDENTITY)
        rho, phi = np.matvec(axes, rho), np.matvec(axes, phi)
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


class Lever(NamedTuple):
    """One link of the chains of elements' ends: its roots, -1 where a chain has ended, and what they move.

    ``motion`` is that of all ends, as one body with the root each, zero where the chain has ended.
    """

    root: Int[np.ndarray, "element end"]
    arm: Inexact[np.ndarray, "element end 3"]
    motion: Inexact[np.ndarray, "element 6*end 6*end"]

    @property
    def coordinates(self) -> Int[np.ndarray, "element 6*end"]:
        """Coordinates of the roots; negative where the chain has ended."""
        return (6 * self.root[:, :, None] + np.arange(6)).reshape(len(self.root), -1)


class Triplets(NamedTuple):
    """Entries of a sparse matrix, to be summed."""

    row: Int[np.ndarray, " entry"]
    column: Int[np.ndarray, " entry"]
    value: Inexact[np.ndarray, " entry"]


def levers(
    chain: Iterable[Int[np.ndarray, "element end"]],
    origin: Inexact[np.ndarray, "root 3"],
    world: Inexact[np.ndarray, "element end 3"],
) -> list[Lever]:
    """First-order motion of ends at ``world`` by the roots in the chains, in carried coordinates."""
    return [_lever(root, origin, world) for root in chain]


def _lever(root: np.ndarray, origin: np.ndarray, world: np.ndarray) -> Lever:
    count, ends = root.shape
    there, arm = root >= 0, world - origin[root]
    motion = np.zeros((count, ends, 6, ends, 6), arm.dtype)
    end = np.arange(ends)
    motion[:, end[:, None], np.arange(6), end[:, None], np.arange(6)] = there[:, :, None]
    motion[:, end, :3, end, 3:] = np.swapaxes(-skew(arm) * there[:, :, None, None], 0, 1)
    return Lever(root, arm, motion.reshape(count, 6 * ends, 6 * ends))


def add_pull(
    links: list[Lever],
    load: Inexact[np.ndarray, "element 6*end"],
    gradient: Inexact[np.ndarray, " coordinate"],
) -> None:
    """Add the contribution of the energy gradient ``load`` at the ends to the carried ``gradient``."""
    for link in links:
        pull = (load[:, None] @ link.motion)[:, 0]
        np.add.at(gradient, np.maximum(link.coordinates, 0), pull)


def lever_stiffness(
    links: list[Lever],
    load: Inexact[np.ndarray, "element end 6"],
    hessian: Inexact[np.ndarray, "element 6*end 6*end"] | None = None,
) -> list[Triplets]:
    """Tangent in carried coordinates of elements of the energy gradient ``load``, (F, M) at each end.

    It is the ``hessian`` at the ends, and ``load`` times the second-order motion of the ends.
    """
    out: list[Triplets] = []
    F, M = load[..., :3], load[..., 3:]
    width = 6 * load.shape[1]
    end = np.arange(load.shape[1])
    by_shift, by_moment = skew(F), 0.5 * skew(M)
    for k, inner in enumerate(links):
        # An outer rotation o: o . (e x F) for a shift e, o . ((e x arm) x F + (e x M)/2) for a turn e.
        pull = np.concatenate([-by_shift, by_shift @ skew(inner.arm) - by_moment], axis=3)
        worked = None if hessian is None else hessian @ inner.motion
        for outer in links[k:]:
            there = ((inner.root >= 0) & (outer.root >= 0))[:, :, None, None]
            block = np.zeros((len(load), width, width), pull.dtype)
            if worked is not None:
                block = np.swapaxes(outer.motion, 1, 2) @ worked
            turned = block.reshape(len(load), len(end), 6, len(end), 6)
            if outer is inner:
                own = there * symmetric_double_cross(F, inner.arm)
                turned[:, end, 3:, end, 3:] += np.swapaxes(own, 0, 1)
            else:
                turned[:, end, 3:, end] += np.swapaxes(there * pull, 0, 1)
            found = _entries(outer.coordinates, inner.coordinates, block)
            out += [found] if outer is inner else [found, Triplets(found.column, found.row, found.value)]
    return out


def _entries(rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray) -> Triplets:
    shape = blocks.shape
    row, column = np.broadcast_to(rows[:, :, None], shape), np.broadcast_to(columns[:, None], shape)
    there = blocks != 0.0
    return Triplets(row[there], column[there], blocks[there])


def summed(parts: Iterable[Triplets], size: int) -> sp.csr_array:
    """The square matrix of all the entries."""
    row, column, value = (np.concatenate(some) for some in zip(*parts, strict=True))
    return sp.coo_array((value, (row, column)), shape=(size, size)).tocsr()


def lever_jacobian(links: list[Lever], size: int) -> sp.csr_array:
    """First-order change of all roots, and of what they carry, by carried coordinates."""
    own = np.arange(links[0].root.size * 6).reshape(-1, 6)
    last = np.arange(own.size, size)
    moved = [_entries(own, link.coordinates, link.motion) for link in links]
    return summed([*moved, Triplets(last, last, np.ones(len(last)))], size)


def uncarried(at: SinceDrawn | None, size: int) -> Bool[np.ndarray, " coordinate"]:
    """Coordinates of roots that nothing carries, and of joints."""
    out = np.ones(size, dtype=bool)
    if at is not None:
        out[: 6 * len(at.carrier)] = np.repeat(at.carrier < 0, 6)
    return out


class Within(NamedTuple):
    """The common carrier of the ends of every element, -1 where there is none.

    Those inside carried parts by ``rows``, with the ``chain`` of each end up to the common carrier.
    """

    outer: Int[np.ndarray, " all"]
    rows: Int[np.ndarray, " element"]
    chain: list[Int[np.ndarray, "element end"]]


class Inside(NamedTuple):
    """Beams and bushings inside carried parts."""

    beams: Within
    bushings: Within


def within(since: SinceDrawn | None, roots: int, frames: Int[np.ndarray, "element 2"]) -> Within:
    """Elements with ends on these frames, of which the first ``roots`` are roots."""
    outer = np.full(len(frames), -1)
    if since is None or not since.carries:
        return Within(outer, np.zeros(0, dtype=int), [])
    on_roots = np.all(frames < roots, axis=1)
    outer[on_roots] = common_carrier(since, frames[on_roots])
    rows = np.flatnonzero(outer >= 0)
    chain = chain_within(since, frames[rows].ravel(), np.repeat(outer[rows], 2))
    return Within(outer, rows, [link.reshape(-1, 2) for link in chain])
