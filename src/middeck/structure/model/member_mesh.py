"""Members as arrays: their geometry, and their division into elements. Analytic in every number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Inexact, Int

from middeck.structure.model.article import Structure
from middeck.values import record


class MemberGeometry(NamedTuple):
    """Nodes of each member, its clear part's ends from their centres [m], its clear length [m], its triad.

    The triad's columns are x (along the member), y (the part of ``up`` normal to it) and z. A member without
    length, or along its ``up``, gives NaN; `check_structure` refuses it.
    """

    nodes: Int[np.ndarray, "member 2"]
    offset: Inexact[np.ndarray, "member 2 3"]
    length: Inexact[np.ndarray, " member"]
    triad: Inexact[np.ndarray, "member 3 3"]


@record(kw_only=True)
class CutMembers:
    """Members cut into elements; inner mesh nodes are numbered after the structure's own nodes.

    ``frame`` and ``offset`` are those of both ends of each element, the latter in frame axes [m].
    """

    inner: Inexact[np.ndarray, "inner 3"]
    frame: Int[np.ndarray, "element 2"]
    offset: Inexact[np.ndarray, "element 2 3"]
    length: Inexact[np.ndarray, " element"]
    member: Int[np.ndarray, " element"]


def member_geometry(structure: Structure) -> MemberGeometry:
    """Geometry of all members."""
    index = {n.name: i for i, n in enumerate(structure.nodes)}
    nodes = np.array([(index[m.start], index[m.end]) for m in structure.members], dtype=int).reshape(-1, 2)
    position = np.array([n.position for n in structure.nodes]).reshape(-1, 3)
    reach = 0.5 * np.array([n.size for n in structure.nodes])[nodes]
    up = np.array([m.up for m in structure.members]).reshape(-1, 3)
    own = np.array([(m.start_offset, m.end_offset) for m in structure.members]).reshape(-1, 2, 3)
    along = position[nodes[:, 1]] + own[:, 1] - position[nodes[:, 0]] - own[:, 0]
    span = np.sqrt(np.sum(along * along, axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        ex = along / span[:, None]
        ey = up - np.sum(up * ex, axis=1)[:, None] * ex
        ey = ey / np.sqrt(np.sum(ey * ey, axis=1))[:, None]
    triad = np.stack([ex, ey, np.cross(ex, ey)], axis=2)
    offset = own + reach[:, :, None] * np.stack([ex, -ex], axis=1)
    return MemberGeometry(nodes, offset, span - reach.sum(axis=1), triad)


def cut_members(structure: Structure, geometry: MemberGeometry) -> CutMembers:
    """Equal elements along the clear length of every member, joined rigidly to the nodes at its ends."""
    nodes, reach, clear, triad = geometry
    count = np.array([m.elements for m in structure.members], dtype=int)
    member = np.repeat(np.arange(len(count)), count)
    begin = np.cumsum(count) - count
    place = np.arange(len(member)) - begin[member]  # place of an element along its member
    first, last = place == 0, place == count[member] - 1
    length = (clear / count)[member]
    along = triad[member, :, 0]
    number = len(structure.nodes) + np.arange(len(member)) - member  # inner node at an element's end
    frame = np.stack(
        [np.where(first, nodes[member, 0], number - 1), np.where(last, nodes[member, 1], number)], axis=1
    )
    offset = np.zeros((len(member), 2, 3), dtype=reach.dtype)
    offset[first, 0] = reach[member[first], 0]
    offset[last, 1] = reach[member[last], 1]
    position = np.array([n.position for n in structure.nodes]).reshape(-1, 3)
    start = position[nodes[member, 0]] + reach[member, 0]
    inner = start + ((place + 1) * length)[:, None] * along
    return CutMembers(inner=inner[~last], frame=frame, offset=offset, length=length, member=member)
