"""Places of the entries of element matrices in the matrices of a model: found once, filled repeatedly.

An entry B_ij between coordinates i and j of poses adds A_ia B_ij A_jb to K_ab for every pair of coordinates a
and b that move them. Which these are depends on topology alone, so that K is a sum over a fixed list.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int

from middeck.structure.elements.offset_points import PoseMap
from middeck.structure.elements.sparse_of_parts import csr_of
from middeck.values import record

NONE = np.zeros(0, dtype=int)
KEPT, LARGEST = 16, 30_000
"""Patterns that are kept: a refinement or a promise meshes one article hundreds of times. And the coordinates
of the largest of them: a million take 0.3 GB."""


class _Products(NamedTuple):
    """Products of one group: entry of the element matrices, two of the Jacobian, and place of the product.

    ``left`` and ``right`` are None where all of them are one.
    """

    entry: np.ndarray
    left: np.ndarray | None
    right: np.ndarray | None
    slot: np.ndarray


@record(kw_only=True)
class Pattern:
    """The pattern of a symmetric sparse matrix in coordinates, and places of each group of elements in it."""

    indptr: np.ndarray
    indices: np.ndarray
    mirror: np.ndarray  # place of the entry across the diagonal
    diagonal: np.ndarray
    groups: Mapping[str, tuple[_Products, ...]]

    def matrix(
        self, jacobian: np.ndarray, blocks: Mapping[str, np.ndarray], diagonal: np.ndarray | float = 0.0
    ) -> sp.csr_array:
        """The sum over element matrices by group, ``jacobian`` being the values of the points' Jacobian.

        ``diagonal`` is a further stiffness of each coordinate.
        """
        size, count = len(self.indptr) - 1, len(self.indices)
        dtype = np.result_type(jacobian, diagonal, *blocks.values())
        data = np.zeros(count, dtype)
        data[self.diagonal] = diagonal
        for name, block in blocks.items():
            flat = block.ravel()
            for part in self.groups[name]:
                value = flat[part.entry]
                if part.left is not None:
                    value = value * (jacobian[part.left] * jacobian[part.right])
                data += _sums(part.slot, value, count)
        # Symmetric by construction; the mean removes the rounding.
        values = 0.5 * (data + data[self.mirror])
        there = values != 0.0
        if np.all(there):
            return csr_of(values, self.indices, self.indptr, (size, size))
        indptr = np.concatenate([[0], np.cumsum(there)])[self.indptr].astype(self.indptr.dtype)
        return csr_of(values[there], self.indices[there], indptr, (size, size))


def _sums(slot: np.ndarray, value: np.ndarray, count: int) -> np.ndarray:
    if np.iscomplexobj(value):
        return _sums(slot, np.real(value), count) + 1j * _sums(slot, np.imag(value), count)
    return np.bincount(slot, weights=value, minlength=count)


@record(kw_only=True)
class _Topology:
    """All that a pattern depends on.

    Attributes:
        size: Number of coordinates.
        frame, special, moves: Frame of each point, and `Special.point` and `JacobianLayout.moves`.
        indptr, indices: Sparse structure of the Jacobian of the points.
        groups: Name of each group, its elements and the ends of one.
        poses: The ends of all elements of the groups in turn.
    """

    size: int
    frame: Int[np.ndarray, " point"]
    special: Int[np.ndarray, " special"]
    moves: Int[np.ndarray, "special turn"]
    indptr: Int[np.ndarray, " row"]
    indices: Int[np.ndarray, " entry"]
    groups: tuple[tuple[str, int, int], ...]
    poses: Int[np.ndarray, " end"]

    @property
    def ends(self) -> dict[str, np.ndarray]:
        """The poses of each group's elements."""
        sizes = [elements * each for _, elements, each in self.groups]
        parts = np.split(self.poses, np.cumsum(sizes)[:-1])
        return {
            name: part.reshape(elements, each)
            for (name, elements, each), part in zip(self.groups, parts, strict=True)
        }


def lay_out_pattern(points: PoseMap, ends: Mapping[str, Int[np.ndarray, "element end"]]) -> Pattern:
    """Pattern of elements that join the poses ``ends``, by group, and of their `second_order`, "turning"."""
    lay_out = _laid_out if points.tree.size <= LARGEST else _laid_out.__wrapped__
    return lay_out(
        _Topology(
            size=points.tree.size,
            frame=points.points.frame,
            special=points.special.point,
            moves=points.layout.moves,
            indptr=points.layout.indptr,
            indices=points.layout.indices,
            groups=tuple((name, *poses.shape) for name, poses in ends.items()),
            poses=np.concatenate([poses.ravel() for poses in ends.values()]),
        )
    )


@functools.lru_cache(maxsize=KEPT)
def _laid_out(points: _Topology) -> Pattern:
    found: dict[str, list[tuple[np.ndarray, ...]]] = {}
    for name, poses in points.ends.items():
        special = np.zeros(len(points.frame), dtype=bool)
        special[points.special] = True
        bent = np.any(special[poses], axis=1)
        plain, others = np.flatnonzero(~bent), np.flatnonzero(bent)
        found[name] = [_plain(points, poses, plain), _bent(points, poses, others)]
    entry, row, column = _pairs(points.moves)
    found["turning"] = [(entry, NONE, NONE, row, column)]
    size = points.size
    keys = [row * size + column for parts in found.values() for *_, row, column in parts]
    pattern, slot = np.unique(np.concatenate([*keys, np.arange(size) * (size + 1)]), return_inverse=True)
    rows, indices = np.divmod(pattern, size)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=size))])
    groups: dict[str, tuple[_Products, ...]] = {}
    start = 0
    for name, parts in found.items():
        done: list[_Products] = []
        for entry, left, right, row, _ in parts:
            places = slot[start : start + len(row)]
            start += len(row)
            done.append(_Products(entry, left if len(left) else None, right if len(left) else None, places))
        groups[name] = tuple(p for p in done if len(p.slot))
    mirror = np.lexsort((rows, indices))
    diagonal = np.flatnonzero(rows == indices)
    # Matrices of all articles of one topology keep these very arrays.
    for each in (part for parts in groups.values() for of in parts for part in of):
        if each is not None:
            each.setflags(write=False)
    return Pattern(
        indptr=indptr.astype(np.int32),
        indices=indices.astype(np.int32),
        mirror=mirror,
        diagonal=diagonal,
        groups=groups,
    )


def _plain(points: _Topology, poses: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, ...]:
    """Elements whose ends move as the origins of roots do: every entry has one place."""
    width = 6 * poses.shape[1]
    index = (6 * points.frame[poses[some]][:, :, None] + np.arange(6)).reshape(len(some), width)
    entry, row, column = _pairs(index)
    return some[entry // width**2] * width**2 + entry % width**2, NONE, NONE, row, column


def _pairs(index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count, width = index.shape
    row = np.repeat(index, width, axis=1).ravel()
    column = np.tile(index, (1, width)).ravel()
    return np.arange(count * width**2), row, column


def _bent(points: _Topology, poses: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, ...]:
    """Elements with an end that has an arm or a joint: the product of all that move the two coordinates."""
    width = 6 * poses.shape[1]
    rows = (6 * poses[some][:, :, None] + np.arange(6)).reshape(len(some), width)
    first, length = points.indptr[rows].astype(int), np.diff(points.indptr)[rows].astype(int)
    most = int(length.max(initial=0))
    k = np.arange(most)
    there = k < length[:, :, None]
    value = np.where(there, first[:, :, None] + k, 0)  # (element, coordinate, mover)
    e, i, a, j, b = np.nonzero(there[:, :, :, None, None] & there[:, None, None, :, :])
    left, right = value[e, i, a], value[e, j, b]
    entry = (some[e] * width + i) * width + j
    return entry, left, right, points.indices[left].astype(int), points.indices[right].astype(int)
