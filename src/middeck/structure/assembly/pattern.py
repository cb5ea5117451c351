"""Where the entries of element matrices go in the matrices of a model: found once, filled in repeatedly.

An entry B_ij between coordinates i and j of poses adds A_ia B_ij A_jb to K_ab for every pair of coordinates a
and b that move them. Which these are depends on topology alone, so that K is a sum over a fixed list.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int

from middeck.structure.elements.offset_points import PoseMap
from middeck.structure.elements.sparse_of_parts import csr_of

NONE = np.zeros(0, dtype=int)


class _Products(NamedTuple):
    """Products of one group: entry of the element matrices, two of the Jacobian, and place of the product.

    ``left`` and ``right`` are None where all of them are one.
    """

    entry: np.ndarray
    left: np.ndarray | None
    right: np.ndarray | None
    slot: np.ndarray


class Pattern(NamedTuple):
    """The pattern of a symmetric sparse matrix in coordinates, and what each group of elements adds to it."""

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


def lay_out_pattern(points: PoseMap, ends: Mapping[str, Int[np.ndarray, "element end"]]) -> Pattern:
    """Pattern of elements that join the poses ``ends``, by group, and of their `second_order`, "turning"."""
    found: dict[str, list[tuple[np.ndarray, ...]]] = {}
    for name, poses in ends.items():
        special = np.zeros(len(points.points.frame), dtype=bool)
        special[points.special.point] = True
        bent = np.any(special[poses], axis=1)
        plain, others = np.flatnonzero(~bent), np.flatnonzero(bent)
        found[name] = [_plain(points, poses, plain), _bent(points, poses, others)]
    entry, row, column = _pairs(points.special.moves)
    found["turning"] = [(entry, NONE, NONE, row, column)]
    size = points.tree.size
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
    return Pattern(indptr.astype(np.int32), indices.astype(np.int32), mirror, diagonal, groups)


def _plain(points: PoseMap, poses: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, ...]:
    """Elements whose ends move as the origins of roots do: every entry has one place."""
    width = 6 * poses.shape[1]
    index = (6 * points.points.frame[poses[some]][:, :, None] + np.arange(6)).reshape(len(some), width)
    entry, row, column = _pairs(index)
    return some[entry // width**2] * width**2 + entry % width**2, NONE, NONE, row, column


def _pairs(index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count, width = index.shape
    row = np.repeat(index, width, axis=1).ravel()
    column = np.tile(index, (1, width)).ravel()
    return np.arange(count * width**2), row, column


def _bent(points: PoseMap, poses: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, ...]:
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
