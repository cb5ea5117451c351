"""From a `Structure` to a finite-element model: frames, poses, elements and bodies as arrays."""

from __future__ import annotations

import dataclasses
import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Inexact, Int

from middeck.structure.article import Body, Member, Node, Structure, clear_length, held_angle
from middeck.structure.beam import BeamProperties, beam_properties
from middeck.structure.checks import check_structure
from middeck.structure.frames import Configuration, FrameTree, PosePoints
from middeck.values import record


@record
class Model:
    """A meshed structure, undeformed. Every array of poses indexes ``points``.

    Parameters
    ----------
    frames:
        Names of the frames: nodes, mesh nodes inside members, joints.
    tree, rest, points:
        Topology, undeformed configuration, and the points that anything acts on.
    element_ends, element_triad, element_member, beams:
        The two poses of each beam element, its undeformed triad, its member, its properties.
    body_point, body_mass, body_inertia:
        Rigid bodies at their centres of mass.
    attach_names, attach_point:
        Attach points by name.
    spring_ends:
        Attach-point poses of the structure's own springs.
    """

    structure: Structure
    frames: tuple[str, ...]
    tree: FrameTree
    rest: Configuration
    points: PosePoints
    element_ends: Int[np.ndarray, "element 2"]
    element_triad: Inexact[np.ndarray, "element 3 3"]
    element_member: Int[np.ndarray, " element"]
    beams: BeamProperties
    body_point: Int[np.ndarray, " body"]
    body_mass: Inexact[np.ndarray, " body"]
    body_inertia: Inexact[np.ndarray, "body 3 3"]
    attach_names: tuple[str, ...]
    attach_point: Int[np.ndarray, " attach"]
    spring_ends: Int[np.ndarray, "spring 2"]


class _Point(NamedTuple):
    frame: int
    offset: np.ndarray


class _Mesh(NamedTuple):
    """Members cut into elements: inner mesh nodes (name, position), and one row per element."""

    inner: list[tuple[str, np.ndarray]]
    ends: list[tuple[_Point, _Point]]
    triads: list[np.ndarray]
    lengths: list[float]
    members: list[int]


def mesh_structure(structure: Structure) -> Model:
    """Mesh every member into its number of elements and lay out coordinates and poses.

    Raises `ConfigError` for a structure that names what it does not have, or whose geometry is impossible.
    """
    check_structure(structure)
    return lay_out(structure)


def lay_out(structure: Structure) -> Model:
    """`mesh_structure` without its checks; analytic in every number of the structure."""
    mesh = _mesh_members(structure)
    names = (*(n.name for n in structure.nodes), *(name for name, _ in mesh.inner))
    frames = (*names, *(j.name for j in structure.joints))
    index = {name: i for i, name in enumerate(frames)}
    x = np.array([*(n.position for n in structure.nodes), *(x for _, x in mesh.inner)]).reshape(-1, 3)
    bodies = [(index[p.name], p.body) for p in (*structure.nodes, *structure.joints) if _has_inertia(p.body)]
    flat = [end for ends in mesh.ends for end in ends]
    points = [
        *flat,
        *(_Point(frame, body.cg) for frame, body in bodies),
        *(_Point(index[a.frame], a.offset) for a in structure.attach_points),
    ]
    attach = {a.name: len(flat) + len(bodies) + i for i, a in enumerate(structure.attach_points)}
    sections = [structure.members[m].section for m in mesh.members]
    spring_ends = [[attach[s.start], attach[s.end]] for s in structure.springs]
    return Model(
        structure=structure,
        frames=frames,
        tree=_frame_tree(structure, len(x), index),
        rest=Configuration(
            x, np.tile(np.eye(3), (len(x), 1, 1)), np.array([held_angle(j) for j in structure.joints]) + 0.0
        ),
        points=PosePoints(
            np.array([p.frame for p in points], dtype=int),
            np.array([p.offset for p in points]).reshape(-1, 3),
        ),
        element_ends=np.arange(len(flat)).reshape(-1, 2),
        element_triad=np.array(mesh.triads).reshape(len(flat) // 2, 3, 3),
        element_member=np.array(mesh.members, dtype=int),
        beams=beam_properties(sections, np.array(mesh.lengths)),
        body_point=len(flat) + np.arange(len(bodies)),
        body_mass=np.array([b.mass for _, b in bodies]) + 0.0,
        body_inertia=np.array([b.inertia for _, b in bodies]).reshape(len(bodies), 3, 3),
        attach_names=tuple(attach),
        attach_point=np.array(list(attach.values()), dtype=int),
        spring_ends=np.array(spring_ends, dtype=int).reshape(-1, 2),
    )


def _mesh_members(structure: Structure) -> _Mesh:
    nodes = {n.name: n for n in structure.nodes}
    root = {n.name: i for i, n in enumerate(structure.nodes)}
    mesh = _Mesh([], [], [], [], [])
    for m, member in enumerate(structure.members):
        triad = member_triad(member, nodes)
        along = triad[:, 0]
        length = clear_length(member, nodes) / member.elements
        start, end = nodes[member.start], nodes[member.end]
        first = start.position + 0.5 * start.size * along
        chain = [_Point(root[start.name], 0.5 * start.size * along)]
        for k in range(1, member.elements):
            chain.append(_Point(len(nodes) + len(mesh.inner), np.zeros(3)))
            mesh.inner.append((f"{member.name}/{k}", first + k * length * along))
        chain.append(_Point(root[end.name], -0.5 * end.size * along))
        mesh.ends.extend(itertools.pairwise(chain))
        mesh.triads.extend([triad] * member.elements)
        mesh.lengths.extend([length] * member.elements)
        mesh.members.extend([m] * member.elements)
    return mesh


def select_beams(beams: BeamProperties, rows: slice | np.ndarray) -> BeamProperties:
    """The properties of some of the elements."""
    return BeamProperties(*(getattr(beams, f.name)[rows] for f in dataclasses.fields(beams)))


def _has_inertia(body: Body) -> bool:
    return body.mass != 0.0 or bool(np.any(body.inertia))


def member_triad(member: Member, nodes: dict[str, Node]) -> Inexact[np.ndarray, "3 3"]:
    """Columns x (along the member), y (the part of ``up`` normal to it) and z."""
    ex = nodes[member.end].position - nodes[member.start].position
    ex = ex / np.sqrt(ex @ ex)
    ey = member.up - (member.up @ ex) * ex
    ey = ey / np.sqrt(ey @ ey)
    return np.stack([ex, ey, np.cross(ex, ey)], axis=1)


def _frame_tree(structure: Structure, roots: int, index: dict[str, int]) -> FrameTree:
    joints = structure.joints
    return FrameTree(
        roots,
        np.array([index[j.parent] for j in joints], dtype=int),
        np.array([j.offset for j in joints]).reshape(-1, 3),
        np.array([j.axis for j in joints]).reshape(-1, 3),
        np.array([j.slides for j in joints], dtype=bool),
    )
