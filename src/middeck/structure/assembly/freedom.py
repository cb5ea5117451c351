"""Free coordinates where clamps hold nodes and joints are held: exact, without stiff penalty springs.

A clamp's directions need not be those of W. At a node that is held along others its coordinates are turned
into them, and then some are struck out. Only equations are turned: shapes, gradients and masses stay in W.
Links are another set of columns in the place of the turn: of coordinates that follow others, see
`redundant_constraints`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from middeck.errors import ConfigError
from middeck.structure.elements.sparse_of_parts import csr_of
from middeck.structure.model.clamps import SQUARE, Clamp, held_directions
from middeck.values import record

# A motion whose largest part moves what is held by less than this is none of it: rounding.
STILL = 1e-9


@record
class Held:
    """Coordinates that clamps hold, after ``axes`` have turned them; None where all are those of W.

    ``moved`` is the prescribed displacement of each root: a shift in W [m] and a rotation vector [rad];
    ``pinned`` are the roots that are held along any way.
    """

    fixed: Bool[np.ndarray, " coordinate"]
    axes: sp.csr_array | None
    moved: Float[np.ndarray, "root 6"]
    pinned: Int[np.ndarray, " pinned"]


class Freedom(NamedTuple):
    """The free coordinates among those that ``axes`` define.

    ``basis`` has how others follow them, and ``moving`` which these are too; None where links tie nothing.
    """

    active: Bool[np.ndarray, " coordinate"]
    axes: sp.csr_array | None
    basis: sp.csr_array | None = None
    moving: Bool[np.ndarray, " coordinate"] | None = None

    def matrix(self, K: sp.csr_array) -> sp.csr_array:
        """The part of a symmetric matrix in W on the moving coordinates; itself where all move."""
        turned = K if self.axes is None else sp.csr_array(self.axes.T @ K @ self.axes)
        if self.basis is None:
            return restrict(turned, self.active)
        own = sp.csr_array(self.basis.T @ turned @ self.basis)
        return sp.csr_array(0.5 * (own + own.T))

    def cancels(self, K: sp.csr_array, part: float) -> Bool[np.ndarray, " moving"]:
        """Coordinates where ``matrix(K)`` is less than ``part`` of the terms that cancel there."""
        own = np.abs(self.matrix(K).diagonal())
        if self.basis is None:
            return own == 0.0
        turned, follow = K if self.axes is None else self.axes.T @ K @ self.axes, abs(self.basis)
        return own <= part * np.asarray(follow.multiply(abs(turned) @ follow).sum(axis=0)).ravel()

    def part(self, load: np.ndarray) -> np.ndarray:
        """The part of loads in W (one or more columns) on the moving coordinates."""
        turned = self._turned(load)
        return turned[self.active] if self.basis is None else self.basis.T @ turned

    def columns(self, rows: sp.csr_array) -> sp.csr_array:
        """Readings of coordinates in W as readings of the free coordinates."""
        turned = rows if self.axes is None else rows @ self.axes
        return sp.csr_array(turned[:, self.active] if self.basis is None else turned @ self.basis)

    def spread(self, q: np.ndarray) -> np.ndarray:
        """Displacements in W, one or more columns, of the free coordinates: zero where they are held."""
        if self.basis is not None:
            return self._in_world(self.basis @ q)
        full = np.zeros((len(self.active), *q.shape[1:]), dtype=q.dtype)
        full[self.active] = q
        return self._in_world(full)

    def coordinates(self, q: np.ndarray) -> np.ndarray:
        """The free coordinates of displacements in W, one or more columns."""
        return self._turned(q)[self.active]

    def allowed(self, motions: Float[np.ndarray, "coordinate motion"]) -> np.ndarray:
        """A basis of the combinations of ``motions`` in W that clamps, held joints and links allow."""
        return motions @ _still(motions, motions - self.spread(self.coordinates(motions)))

    def beyond(self, load: np.ndarray) -> np.ndarray:
        """The part of ``load`` in W, links included, on held coordinates: those of clamps and held joints."""
        return self._in_world(np.where(self._moves, 0.0, self._turned(load)))

    def within(self, load: np.ndarray) -> np.ndarray:
        """``load`` in W, that of links included, less the part on clamps and held joints."""
        return self._in_world(np.where(self._moves, self._turned(load), 0.0))

    @property
    def _moves(self) -> np.ndarray:
        return self.active if self.moving is None else self.moving

    def _turned(self, x: np.ndarray) -> np.ndarray:
        return x if self.axes is None else self.axes.T @ x

    def _in_world(self, x: np.ndarray) -> np.ndarray:
        return x if self.axes is None else self.axes @ x


def allowed_motions(
    held: Held | None, motions: Float[np.ndarray, "coordinate motion"]
) -> Float[np.ndarray, "coordinate allowed"]:
    """A basis of the combinations of ``motions`` in W that move nothing ``held``; all if nothing is."""
    if held is None or not motions.shape[1]:
        return motions
    return motions @ _still(motions, (motions if held.axes is None else held.axes.T @ motions)[held.fixed])


def whole_motions(held: Held, rigid: Float[np.ndarray, "coordinate 6"]) -> Float[np.ndarray, "6 motion"]:
    """Combinations of the ``rigid`` columns that turn about what is ``held``, by any angle."""
    fixed = held.fixed.copy()
    fixed[: held.moved.size].reshape(-1, 6)[held.pinned, :3] = True
    return _still(rigid, (rigid if held.axes is None else held.axes.T @ rigid)[fixed])


def _still(motions: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Combinations of ``motions`` of which the rows ``moved`` are zero."""
    size = np.sqrt(np.einsum("im,im->m", motions, motions))
    _, parts, turn = np.linalg.svd(moved / size)
    return turn[np.append(parts, np.zeros(len(turn) - len(parts))) < STILL].T / size[:, None]


def restrict(K: sp.csr_array, active: Bool[np.ndarray, " coordinate"]) -> sp.csr_array:
    """Rows and columns of the free coordinates; the matrix itself where all are free."""
    if np.all(active):
        return K
    # Every step of a descent asks for it: several times as quick as two of scipy's own selections.
    keep = np.repeat(active, np.diff(K.indptr)) & active[K.indices]
    place, before = np.cumsum(active) - 1, np.concatenate([[0], np.cumsum(keep)])
    indptr = np.append(before[K.indptr[:-1][active]], before[-1])
    size = len(indptr) - 1
    indices, indptr = place[K.indices[keep]].astype(K.indices.dtype), indptr.astype(K.indptr.dtype)
    return csr_of(K.data[keep], indices, indptr, (size, size))


def hold_nodes(clamps: Sequence[Clamp], roots: Mapping[str, int], size: int, count: int) -> Held | None:
    """The held coordinates of ``count`` roots under ``clamps``, by the names of nodes; None for no clamps.

    Raises `ConfigError` for an unknown node and for a direction that is held twice.
    """
    if not clamps:
        return None
    fixed, moved = np.zeros(size, dtype=bool), np.zeros((count, 6))
    turned: dict[int, np.ndarray] = {}
    for node in dict.fromkeys(c.node for c in clamps):
        if node not in roots:
            raise ConfigError(
                f"no node {node!r} to clamp", where="clamps", hint=f"nodes are {', '.join(roots)}"
            )
        first = 6 * roots[node]
        for start, held in zip((first, first + 3), held_directions(clamps, node), strict=True):
            axes, struck = _axes(held)
            fixed[start : start + 3] = struck
            if axes is not None:
                turned[start] = axes
    for clamp in clamps:
        moved[roots[clamp.node]] += np.concatenate([clamp.axes @ clamp.shift, clamp.axes @ clamp.turn])
    pinned = np.array(sorted({roots[c.node] for c in clamps if c.along}), dtype=int)
    return Held(fixed, _block_diagonal(turned, size) if turned else None, moved, pinned)


def _axes(held: Sequence[np.ndarray]) -> tuple[np.ndarray | None, np.ndarray]:
    """Three axes among which the ``held`` directions are, None for those of W, and which of them are held."""
    whole = [np.flatnonzero(np.abs(axis) > 1.0 - SQUARE) for axis in held]
    if len(held) in (0, 3) or all(len(w) for w in whole):
        struck = np.full(3, len(held) == 3)
        struck[[int(w[0]) for w in whole if len(w)]] = True
        return None, struck
    axes, _ = np.linalg.qr(np.column_stack([*held, np.eye(3)]))
    return axes, np.arange(3) < len(held)


def _block_diagonal(turned: Mapping[int, np.ndarray], size: int) -> sp.csr_array:
    out = sp.lil_array(sp.eye_array(size))
    for start, axes in turned.items():
        out[start : start + 3, start : start + 3] = axes
    return sp.csr_array(out)
