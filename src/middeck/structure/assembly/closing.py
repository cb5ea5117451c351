"""Which coordinates depend on the others where links tie them, and how: a basis of what the links allow.

Rows of links that share no coordinate are solved apart. In each such block a QR factorisation with pivots
among the rows tells those that say nothing new, and one with pivots among the columns which coordinates to
take as dependent, so that these follow from the others with small factors (Golub and Van Loan 2013, section
5.4). Before that rows have length one, shifts counted over the longest arm of their block: no unit enters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

# Of a row of length one: what is left of one that repeats others, and of one that cannot be told from such.
REPEATED, NEARLY = 1e-9, 1e-7
# Least part that a row has in one that repeats it.
PART = 1e-6
# Entries of a row below this part of it are differences that cancelled.
CANCELLED = 1e-13
# Dependent coordinates are not those of stiff parts as their carriers see them, unless no other will do.
CARRIED = 1e-5


class _Block(NamedTuple):
    rows: np.ndarray
    dependent: np.ndarray
    matrix: np.ndarray


class Closing(NamedTuple):
    """The coordinates that follow others, and those.

    Attributes:
        basis: Motions that the links allow, a column for each independent coordinate.
        independent: Which coordinates these are.
        blocks: Rows and dependent coordinates that belong together, and the matrix between them.
        spare: Rows that repeat others, and these: none where nothing that moves enters them.
        nearly: Rows that nearly repeat others.
        size: Length of each row before it was made one, its unit being that of its value.
    """

    basis: sp.csr_array
    independent: Bool[np.ndarray, " coordinate"]
    blocks: tuple[_Block, ...]
    spare: tuple[tuple[int, tuple[int, ...]], ...]
    nearly: Int[np.ndarray, " nearly"]
    size: Float[np.ndarray, " row"]

    def follow(self, value: Float[np.ndarray, " row"]) -> Float[np.ndarray, " coordinate"]:
        """Moves of the dependent coordinates that take ``value`` from the rows, to first order."""
        out = np.zeros(len(self.independent))
        for block in self.blocks:
            out[block.dependent] = -np.linalg.solve(block.matrix, value[block.rows])
        return out

    def multipliers(self, gradient: Float[np.ndarray, " coordinate"]) -> Float[np.ndarray, " row"]:
        """Factors of the rows that leave no gradient at the dependent coordinates; zero for spare rows."""
        out = np.zeros(len(self.size))
        for block in self.blocks:
            out[block.rows] = -np.linalg.solve(block.matrix.T, gradient[block.dependent])
        return out


def close_rows(
    C: sp.csr_array,
    moving: Bool[np.ndarray, " coordinate"],
    turns: Bool[np.ndarray, " coordinate"],
    carried: Bool[np.ndarray, " coordinate"],
) -> Closing:
    """Solve C q = 0 for some of the ``moving`` coordinates, of which ``turns`` are angles."""
    C = sp.csr_array(C)
    rows = np.repeat(np.arange(C.shape[0]), np.diff(C.indptr))
    most = np.zeros(C.shape[0])
    np.maximum.at(most, rows, np.abs(C.data))
    there = moving[C.indices] & (np.abs(C.data) > CANCELLED * most[rows])
    C = sp.csr_array((C.data[there], (rows[there], C.indices[there])), shape=C.shape)
    size, nearly = np.ones(C.shape[0]), []
    spare: list[tuple[int, tuple[int, ...]]] = []
    blocks: list[_Block] = []
    entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for some, columns in _apart(C):
        if not len(columns):
            spare += [(int(row), ()) for row in some]
            continue
        dense = C[some][:, columns].toarray()
        unit = np.where(turns[columns], 1.0, _arm(dense, turns[columns]))
        size[some] = np.linalg.norm(dense * unit, axis=1)
        scaled = dense * unit / size[some, None]
        triangle, order = sla.qr(scaled.T, mode="r", pivoting=True)
        left = np.abs(np.diagonal(triangle))
        rank = int(np.sum(left > REPEATED))
        nearly += some[order[:rank][left[:rank] < NEARLY]].tolist()
        kept = np.sort(order[:rank])
        for row in order[rank:]:
            parts = np.linalg.lstsq(scaled[kept].T, scaled[row], rcond=None)[0]
            spare.append((int(some[row]), tuple(some[kept[np.abs(parts) > PART]].tolist())))
        weight = np.where(carried[columns], CARRIED, 1.0)
        pick = sla.qr(scaled[kept] * weight, mode="r", pivoting=True)[1]
        own, others = pick[:rank], pick[rank:]
        blocks.append(_Block(some[kept], columns[own], dense[np.ix_(kept, own)]))
        follow = -unit[own, None] * np.linalg.solve(scaled[np.ix_(kept, own)], scaled[np.ix_(kept, others)])
        i, j = np.nonzero(follow)
        entries.append((columns[own][i], columns[others][j], follow[i, j] / unit[others[j]]))
    dependent = np.concatenate([np.zeros(0, int), *(b.dependent for b in blocks)])
    independent = moving.copy()
    independent[dependent] = False
    place = np.cumsum(independent) - 1
    own = np.flatnonzero(independent)
    i, j, value = (np.concatenate(part) for part in zip((own, own, np.ones(len(own))), *entries, strict=True))
    basis = sp.csr_array((value, (i, place[j])), shape=(len(moving), len(own)))
    return Closing(
        basis, independent, tuple(blocks), tuple(sorted(spare)), np.array(sorted(nearly), int), size
    )


def _apart(C: sp.csr_array) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows that share coordinates, and these."""
    m, n = C.shape
    rows = np.repeat(np.arange(m), np.diff(C.indptr))
    graph = sp.coo_array((np.ones(len(rows)), (rows, m + C.indices)), shape=(m + n, m + n))
    _, part = connected_components(graph, directed=False)
    order = np.argsort(part, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(part[order])) + 1)
    return [(g[g < m], g[g >= m] - m) for g in groups if np.any(g < m)]


def _arm(dense: np.ndarray, turns: np.ndarray) -> float:
    """The longest arm of rows that both shifts and turns enter; one where none is."""
    shift = np.abs(dense[:, ~turns]).max(axis=1, initial=0.0)
    turn = np.abs(dense[:, turns]).max(axis=1, initial=0.0)
    both = (shift > 0.0) & (turn > 0.0)
    return float((turn[both] / shift[both]).max(initial=0.0)) or 1.0
