"""Coordinates that depend on others through links: a basis of the motions that links allow.

Rows of links that share no coordinate are solved apart. In each such block a QR factorisation with pivots
among the rows finds redundant ones, and one with pivots among the columns which coordinates to
take as dependent, so that these follow from the others with small factors (Golub and Van Loan 2013, section
5.4). Before that rows have length one, shifts counted over the longest arm of their block: no unit enters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

# Remainder of a row of length one that repeats others, and of one that cannot be distinguished from such.
REPEATED, NEARLY = 1e-9, 1e-7
# Least part that a row has in one that repeats it.
PART = 1e-6
# Entries of a row below this part of it are differences that cancelled.
CANCELLED = 1e-13
# Shortest arm, over the length of the whole, on which a turn may follow shifts: shorter gives large factors.
SHORT = 1e-2
# Dependent coordinates are not those of stiff parts as their carriers see them, unless no other will do.
CARRIED = 1e-5
NONE = np.zeros(0, dtype=int)


class _Block(NamedTuple):
    rows: np.ndarray
    dependent: np.ndarray
    matrix: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Closing:
    """The dependent coordinates, and those that they depend on.

    Attributes:
        basis: Motions that the links allow, a column for each independent coordinate.
        independent: Indices of these coordinates.
        blocks: Rows and dependent coordinates that belong together, and the matrix between them.
        spare: Rows that repeat others, and these: none where nothing that moves enters them.
        nearly: Rows that nearly repeat others.
        size: Length of each row before it was made one, its unit being that of its value.
        axes: Rotation of coordinates into those of W, applied by `follow` and `multipliers`; None for none.
    """

    basis: sp.csr_array
    independent: Bool[np.ndarray, " coordinate"]
    blocks: tuple[_Block, ...]
    spare: tuple[tuple[int, tuple[int, ...]], ...]
    nearly: Int[np.ndarray, " nearly"]
    size: Float[np.ndarray, " row"]
    axes: sp.csr_array | None = None

    def follow(self, value: Float[np.ndarray, "row ..."]) -> Float[np.ndarray, "coordinate ..."]:
        """Moves of the dependent coordinates that take ``value`` from the rows, to first order."""
        out = np.zeros((len(self.independent), *value.shape[1:]))
        for block in self.blocks:
            out[block.dependent] = -np.linalg.solve(block.matrix, value[block.rows])
        return out if self.axes is None else self.axes @ out

    def multipliers(self, gradient: Float[np.ndarray, "coordinate ..."]) -> Float[np.ndarray, "row ..."]:
        """Factors of the rows that leave no gradient at the dependent coordinates; zero for spare rows."""
        gradient = gradient if self.axes is None else self.axes.T @ gradient
        out = np.zeros((len(self.size), *gradient.shape[1:]))
        for block in self.blocks:
            out[block.rows] = -np.linalg.solve(block.matrix.T, gradient[block.dependent])
        return out


def close_rows(
    rows: sp.csr_array,
    moving: Bool[np.ndarray, " coordinate"],
    turns: Bool[np.ndarray, " coordinate"],
    carried: Bool[np.ndarray, " coordinate"],
    length: float = 0.0,
) -> Closing:
    """Solve ``rows`` q = 0 for some of the ``moving`` coordinates, of which ``turns`` are angles.

    ``length`` [m] is that of the whole.
    """
    C = _of_moving(rows, moving)
    solved = [_solve_block(C, *part, turns, carried, SHORT * length) for part in _apart(C, len(moving))]
    size = np.ones(len(C.indptr) - 1)
    for part in solved:
        size[part.rows] = part.size
    independent = moving.copy()
    independent[[k for part in solved for k in part.block.dependent.tolist()]] = False
    own, place = np.flatnonzero(independent), np.cumsum(independent) - 1
    entries = [(own, own, np.ones(len(own))), *(part.follow for part in solved)]
    i, j, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return Closing(
        basis=sp.csr_array((value, (i, place[j])), shape=(len(moving), len(own))),
        independent=independent,
        blocks=tuple(part.block for part in solved if len(part.block.rows)),
        spare=tuple(sorted(spare for part in solved for spare in part.spare)),
        nearly=np.array(sorted(row for part in solved for row in part.nearly), dtype=int),
        size=size,
    )


def _of_moving(rows: sp.csr_array, moving: np.ndarray) -> sp.csr_array:
    """Entries at coordinates that move, without those that cancelled."""
    number = np.repeat(np.arange(len(rows.indptr) - 1), np.diff(rows.indptr))
    most = np.zeros(len(rows.indptr) - 1)
    np.maximum.at(most, number, np.abs(rows.data))
    kept = moving[rows.indices] & (np.abs(rows.data) > CANCELLED * most[number])
    shape = (len(most), len(moving))
    return sp.csr_array((rows.data[kept], (number[kept], rows.indices[kept])), shape=shape)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solved:
    """A block, how its dependent coordinates follow others, and what its rows are."""

    rows: np.ndarray
    size: np.ndarray
    block: _Block
    follow: tuple[np.ndarray, np.ndarray, np.ndarray]
    spare: list[tuple[int, tuple[int, ...]]]
    nearly: list[int]


def _solve_block(
    C: sp.csr_array,
    some: np.ndarray,
    columns: np.ndarray,
    turns: np.ndarray,
    carried: np.ndarray,
    least: float,
) -> _Solved:
    """The rows ``some`` of C, which enter the coordinates ``columns`` alone; no arm is below ``least``."""
    dense: np.ndarray = C[some][:, columns].toarray()
    if not len(columns):
        block = _Block(NONE, NONE, dense)
        return _Solved(
            rows=some,
            size=np.ones(len(some)),
            block=block,
            follow=(NONE, NONE, NONE),
            spare=[(int(r), ()) for r in some],
            nearly=[],
        )
    unit = np.where(turns[columns], 1.0, _arm(dense, turns[columns], least))
    size = np.linalg.norm(dense * unit, axis=1)
    scaled = dense * unit / size[:, None]
    triangle, order = _pivoted(scaled.T)
    left = np.abs(np.diagonal(triangle))
    rank = int(np.sum(left > REPEATED))
    kept = np.sort(order[:rank])
    spare: list[tuple[int, tuple[int, ...]]] = []
    for row in order[rank:]:
        parts = np.linalg.lstsq(scaled[kept].T, scaled[row], rcond=None)[0]
        spare.append((int(some[row]), tuple(some[kept[np.abs(parts) > PART]].tolist())))
    _, pick = _pivoted(scaled[kept] * np.where(carried[columns], CARRIED, 1.0))
    own, others = pick[:rank], pick[rank:]
    follow = -unit[own, None] * np.linalg.solve(scaled[np.ix_(kept, own)], scaled[np.ix_(kept, others)])
    i, j = np.nonzero(follow)
    return _Solved(
        rows=some,
        size=size,
        block=_Block(some[kept], columns[own], dense[np.ix_(kept, own)]),
        follow=(columns[own][i], columns[others][j], follow[i, j] / unit[others[j]]),
        spare=spare,
        nearly=some[order[:rank][left[:rank] < NEARLY]].tolist(),
    )


def _pivoted(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The triangle and the order of the columns of a QR factorisation with pivots."""
    return cast("tuple[np.ndarray, np.ndarray]", sla.qr(A, mode="r", pivoting=True))


def pivots(motions: Float[np.ndarray, "coordinate motion"]) -> Int[np.ndarray, " motion"]:
    """Coordinates that, held, stop all ``motions``: the pivots of a rank-revealing QR (Golub 1965)."""
    return _pivoted(motions.T)[1][: motions.shape[1]] if motions.shape[1] else NONE


def _apart(C: sp.csr_array, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows that share coordinates, and these."""
    m = len(C.indptr) - 1
    rows = np.repeat(np.arange(m), np.diff(C.indptr))
    graph = sp.coo_array((np.ones(len(rows)), (rows, m + C.indices)), shape=(m + n, m + n))
    _, part = connected_components(graph, directed=False)
    order = np.argsort(part, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(part[order])) + 1)
    return [(g[g < m], g[g >= m] - m) for g in groups if np.any(g < m)]


def _arm(dense: np.ndarray, turns: np.ndarray, least: float) -> float:
    """The longest arm of rows that both shifts and turns enter, or ``least``; one where none is."""
    shift = np.abs(dense[:, ~turns]).max(axis=1, initial=0.0)
    turn = np.abs(dense[:, turns]).max(axis=1, initial=0.0)
    both = (shift > 0.0) & (turn > 0.0)
    return max(least, float((turn[both] / shift[both]).max())) if np.any(both) else 1.0
