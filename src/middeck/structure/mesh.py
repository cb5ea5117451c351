"""From a `Structure` to a finite-element model: frames, poses, elements and bodies as arrays."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.article import (
    Joint,
    JointState,
    Member,
    Node,
    Section,
    Structure,
    clear_length,
)
from middeck.structure.beam import BeamProperties, beam_properties
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
    element_triad: Float[np.ndarray, "element 3 3"]
    element_member: Int[np.ndarray, " element"]
    beams: BeamProperties
    body_point: Int[np.ndarray, " body"]
    body_mass: Float[np.ndarray, " body"]
    body_inertia: Float[np.ndarray, "body 3 3"]
    attach_names: tuple[str, ...]
    attach_point: Int[np.ndarray, " attach"]
    spring_ends: Int[np.ndarray, "spring 2"]


class _Ends(NamedTuple):
    frame: int
    offset: np.ndarray


def mesh_structure(structure: Structure) -> Model:
    """Mesh every member into its number of elements and lay out coordinates and poses."""
    nodes = {n.name: i for i, n in enumerate(structure.nodes)}
    names = [n.name for n in structure.nodes]
    x = [n.position for n in structure.nodes]
    ends: list[tuple[_Ends, _Ends]] = []
    triads: list[np.ndarray] = []
    sections: list[Section] = []
    lengths: list[float] = []
    owner: list[int] = []
    by_name = {n.name: n for n in structure.nodes}
    for m, member in enumerate(structure.members):
        triad = member_triad(member, by_name)
        length = clear_length(member, by_name) / member.elements
        start, end = by_name[member.start], by_name[member.end]
        chain = [_Ends(nodes[start.name], 0.5 * start.size * triad[:, 0])]
        first = start.position + chain[0].offset
        for k in range(1, member.elements):
            names.append(f"{member.name}/{k}")
            x.append(first + k * length * triad[:, 0])
            chain.append(_Ends(len(x) - 1, np.zeros(3)))
        chain.append(_Ends(nodes[end.name], -0.5 * end.size * triad[:, 0]))
        ends += list(itertools.pairwise(chain))
        triads += [triad] * member.elements
        sections += [member.section] * member.elements
        lengths += [length] * member.elements
        owner += [m] * member.elements
    tree, frame_names = _joint_frames(structure, names)
    index = {name: i for i, name in enumerate(frame_names)}
    flat = [e for pair in ends for e in pair]
    bodies = [(index[p.name], p.body) for p in (*structure.nodes, *structure.joints) if p.body.mass > 0.0]
    attach = [_Ends(index[a.frame], a.offset) for a in structure.attach_points]
    points = [*flat, *(_Ends(f, b.cg) for f, b in bodies), *attach]
    first_attach = len(flat) + len(bodies)
    attach_at = {a.name: first_attach + i for i, a in enumerate(structure.attach_points)}
    return Model(
        structure=structure,
        frames=tuple(frame_names),
        tree=tree,
        rest=Configuration(
            np.array(x).reshape(-1, 3),
            np.tile(np.eye(3), (len(x), 1, 1)),
            np.array([held_angle(j) for j in structure.joints]),
        ),
        points=PosePoints(
            np.array([p.frame for p in points], dtype=int),
            np.array([p.offset for p in points]).reshape(-1, 3),
        ),
        element_ends=np.arange(len(flat)).reshape(-1, 2),
        element_triad=np.array(triads).reshape(-1, 3, 3),
        element_member=np.array(owner, dtype=int),
        beams=beam_properties(sections, np.array(lengths)),
        body_point=len(flat) + np.arange(len(bodies)),
        body_mass=np.array([b.mass for _, b in bodies]),
        body_inertia=np.array([b.inertia for _, b in bodies]).reshape(-1, 3, 3),
        attach_names=tuple(attach_at),
        attach_point=np.array(list(attach_at.values()), dtype=int),
        spring_ends=np.array(
            [[attach_at[s.start], attach_at[s.end]] for s in structure.springs], dtype=int
        ).reshape(-1, 2),
    )


def member_triad(member: Member, nodes: dict[str, Node]) -> Float[np.ndarray, "3 3"]:
    """Columns x (along the member), y (the part of ``up`` normal to it) and z."""
    ex = nodes[member.end].position - nodes[member.start].position
    ex = ex / np.linalg.norm(ex)
    ey = member.up - (member.up @ ex) * ex
    ey = ey / np.linalg.norm(ey)
    return np.stack([ex, ey, np.cross(ex, ey)], axis=1)


def _joint_frames(structure: Structure, roots: list[str]) -> tuple[FrameTree, list[str]]:
    """Frame tree with joints in an order in which parents come first (as given by the structure)."""
    names = [*roots, *(j.name for j in structure.joints)]
    index = {name: i for i, name in enumerate(names)}
    tree = FrameTree(
        len(roots),
        np.array([index[j.parent] for j in structure.joints], dtype=int),
        np.array([j.offset for j in structure.joints]).reshape(-1, 3),
        np.array([j.axis for j in structure.joints]).reshape(-1, 3),
    )
    return tree, names


def held_angle(joint: Joint) -> float:
    """Angle [rad] at which statics begin: the command of a driven axis, else the nominal one."""
    return joint.target if joint.state is JointState.DRIVEN else joint.angle
