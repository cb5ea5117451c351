"""Links as rows of numbers on the poses of a model, and how coordinates move them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact, Int

from middeck.structure.elements.bushings import RelativeMotion, relative_motion
from middeck.structure.elements.direction_cosines import Cosines, cosines
from middeck.structure.model.clamps import LETTERS
from middeck.structure.model.links import (
    DIRECTIONS,
    AnyLink,
    Equation,
    Interpolation,
    Link,
    fitted_body,
    square_axes,
)
from middeck.values import record

GROUND = -1


@record(kw_only=True)
class LinkRows:
    """One row for each number that links hold at zero.

    Attributes:
        label: Name of each row, for messages.
        link: The link that it belongs to, by its place among the structure's.
        ends: The two poses of each pair of frames, the first of them `GROUND` where it is the world.
        factors: Factors of the motions of the second frames as the first ones see them, six a pair.
        angles: Angles of the coordinates of joints.
        square, pair, first, second: Rows that are cosines: their numbers, pairs, and directions as drawn.
    """

    label: tuple[str, ...]
    link: Int[np.ndarray, " row"]
    ends: Int[np.ndarray, "pair 2"]
    factors: sp.csr_array
    angles: sp.csr_array
    square: Int[np.ndarray, " cosine"]
    pair: Int[np.ndarray, " cosine"]
    first: Inexact[np.ndarray, "cosine 3"]
    second: Inexact[np.ndarray, "cosine 3"]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkState:
    """The numbers that links hold at zero, with derivatives by poses (``slope``) and coordinates in W."""

    rows: LinkRows
    value: Inexact[np.ndarray, " row"]
    slope: sp.csr_array
    jacobian: sp.csr_array
    motion: RelativeMotion
    cosine: Cosines

    def load(self, multiplier: Inexact[np.ndarray, " row"]) -> Inexact[np.ndarray, "pose 6"]:
        """Gradient of the multipliers times the rows at the poses."""
        return (self.slope.T @ multiplier).reshape(-1, 6)

    def bent(self, multiplier: Inexact[np.ndarray, " row"], J: sp.csr_array) -> sp.csr_array:
        """The same for the Hessian, as far as poses move in their own charts."""
        rows = self.rows
        hessian = self.motion.second_order((rows.factors.T @ multiplier).reshape(-1, 6))
        np.add.at(hessian, rows.pair, self.cosine.second_order(multiplier[rows.square]))
        ground = rows.ends[:, 0] == GROUND
        hessian[ground, :6] = 0.0
        hessian[ground, :, :6] = 0.0
        ends = J[_six(np.maximum(rows.ends, 0).ravel())]
        return sp.csr_array(ends.T @ _diagonal(hessian) @ ends)


def lay_out_links(
    links: Sequence[AnyLink], place: Mapping[str, np.ndarray], joint: Mapping[str, int], first: int, size: int
) -> LinkRows | None:
    """Rows of ``links``, whose frames stand at ``place``; None for none.

    Their points, one for each of `AnyLink.frames`, are the poses from ``first`` on; ``joint`` states the
    coordinates of joints.
    """
    if not links:
        return None
    laid = _Layout(label=[], link=[], ends=[], factors=[], angles=[], squares=[])
    for number, link in enumerate(links):
        if isinstance(link, Link):
            laid.add_link(number, link, first)
        elif isinstance(link, Interpolation):
            laid.add_interpolation(number, link, first, place)
        else:
            laid.add_equation(number, link, first, joint)
        first += len(link.frames)
    rows, pairs = len(laid.label), len(laid.ends)
    return LinkRows(
        label=tuple(laid.label),
        link=np.array(laid.link, dtype=int),
        ends=np.array(laid.ends, dtype=int).reshape(-1, 2),
        factors=_sparse(laid.factors, (rows, 6 * pairs)),
        angles=_sparse(laid.angles, (rows, size)),
        square=np.array([s[0] for s in laid.squares], dtype=int),
        pair=np.array([s[1] for s in laid.squares], dtype=int),
        first=np.array([s[2] for s in laid.squares]).reshape(-1, 3),
        second=np.array([s[3] for s in laid.squares]).reshape(-1, 3),
    )


def link_points(links: Sequence[AnyLink]) -> list[tuple[str, np.ndarray]]:
    """Frame and offset of every point that `lay_out_links` counts on."""
    return [
        (frame, link.offset if isinstance(link, Link) and k == 1 else np.zeros(3))
        for link in links
        for k, frame in enumerate(link.frames)
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Layout:
    label: list[str]
    link: list[int]
    ends: list[tuple[int, int]]
    factors: list[tuple[int, int, float]]
    angles: list[tuple[int, int, float]]
    squares: list[tuple[int, int, np.ndarray, np.ndarray]]

    def _row(self, number: int, label: str) -> int:
        self.label.append(label)
        self.link.append(number)
        return len(self.label) - 1

    def _pair(self, first: int, second: int) -> int:
        self.ends.append((first, second))
        return len(self.ends) - 1

    def _add(self, row: int, pair: int, six: np.ndarray) -> None:
        self.factors.extend((row, 6 * pair + k, six[k]) for k in np.flatnonzero(six).tolist())

    def add_link(self, number: int, link: Link, first: int) -> None:
        pair = self._pair(first, first + 1)
        for letter in sorted(link.along):
            six = np.concatenate([link.axes[:, LETTERS.index(letter)], np.zeros(3)])
            self._add(self._row(number, f"link {link.name!r} along {letter}"), pair, six)
        for letter, (a, b) in zip(sorted(link.about), square_axes(link), strict=True):
            self.squares.append((self._row(number, f"link {link.name!r} about {letter}"), pair, a, b))

    def add_interpolation(
        self, number: int, link: Interpolation, first: int, place: Mapping[str, np.ndarray]
    ) -> None:
        arms = np.array([place[share.frame] - place[link.frame] for share in link.shares])
        factors = fitted_body(link, arms.reshape(-1, 3))
        pairs = [self._pair(first, first + 1 + k) for k in range(len(link.shares))]
        names = [f"along {a}" for a in link.along] + [f"about {a}" for a in link.about]
        for k, name in enumerate(names):
            row = self._row(number, f"link {link.name!r} {name}")
            for pair, six in zip(pairs, factors[:, k], strict=True):
                self._add(row, pair, six)

    def add_equation(self, number: int, link: Equation, first: int, joint: Mapping[str, int]) -> None:
        row = self._row(number, f"link {link.name!r}")
        pairs: dict[str, int] = {}
        for term in link.terms:
            if term.direction == "angle":
                self.angles.append((row, joint[term.frame], term.coefficient))
                continue
            pair = pairs.get(term.frame)
            if pair is None:
                pair = pairs[term.frame] = self._pair(GROUND, first + link.frames.index(term.frame))
            self.factors.append((row, 6 * pair + DIRECTIONS.index(term.direction), term.coefficient))


def link_state(
    rows: LinkRows,
    J: sp.csr_array,
    world: Inexact[np.ndarray, "pose 3"],
    since: tuple[Inexact[np.ndarray, "end 3"], Inexact[np.ndarray, "end 3 3"]],
    turned: Inexact[np.ndarray, " coordinate"],
) -> LinkState:
    """The state of links at poses ``world`` with the Jacobian J.

    ``since`` are the shift and the turn less the identity of the ``ends``, in their order, since drawn, and
    ``turned`` what the coordinates of joints have changed by.
    """
    ground = rows.ends[:, 0] == GROUND
    place = np.maximum(rows.ends, 0)
    shift = np.array(since[0].reshape(-1, 2, 3))
    turn = np.array(since[1].reshape(-1, 2, 3, 3))
    shift[ground, 0], turn[ground, 0] = 0.0, 0.0
    motion = relative_motion(world[place[:, 1]] - world[place[:, 0]], shift[:, 1] - shift[:, 0], turn)
    cosine = cosines(rows.first, rows.second, turn[rows.pair])
    value = rows.factors @ motion.value.ravel() + rows.angles @ turned
    value[rows.square] += cosine.value
    slope = np.array(motion.slope)
    slope[ground, :, :6] = 0.0
    of_pairs = rows.factors @ _diagonal(slope)
    count = 12 * len(rows.ends)
    square = (np.repeat(rows.square, 12), _six(place[rows.pair].ravel()))
    own = sp.coo_array((cosine.slope.ravel(), square), shape=(len(value), len(J.indptr) - 1))
    spread = sp.csr_array(
        (np.ones(count), (np.arange(count), _six(place.ravel()))), shape=(count, len(J.indptr) - 1)
    )
    on_poses = sp.csr_array(sp.csr_array(of_pairs) @ spread + own)
    return LinkState(
        rows=rows,
        value=value,
        slope=on_poses,
        jacobian=sp.csr_array(on_poses @ J + rows.angles),
        motion=motion,
        cosine=cosine,
    )


def _six(pose: np.ndarray) -> np.ndarray:
    """Numbers of the six motions of each pose."""
    return (6 * pose[:, None] + np.arange(6)).ravel()


def _diagonal(blocks: np.ndarray) -> sp.csr_array:
    """Blocks on the diagonal of a matrix."""
    count, high, wide = blocks.shape
    places = np.arange(count + 1)
    return sp.bsr_array((blocks, places[:-1], places), shape=(count * high, count * wide)).tocsr()


def _sparse(entries: list[tuple[int, int, float]], shape: tuple[int, int]) -> sp.csr_array:
    row, column, value = zip(*entries, strict=True) if entries else ((), (), ())
    return sp.csr_array((np.array(value) + 0.0, (np.array(row, int), np.array(column, int))), shape=shape)
