"""From a `Structure` to a finite-element model: frames, poses, elements and bodies as arrays."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Inexact, Int

from middeck.errors import ConfigError
from middeck.structure.assembly.carriers import bushing_stiffness, choose_carriers
from middeck.structure.assembly.freedom import Held, hold_nodes
from middeck.structure.assembly.link_rows import LinkRows, lay_out_links, link_points
from middeck.structure.assembly.pattern import Pattern, lay_out_pattern
from middeck.structure.elements.beam import BeamProperties, beam_properties
from middeck.structure.elements.component_element import ComponentElement
from middeck.structure.elements.frames import (
    Configuration,
    FrameTree,
    PosePoints,
    Poses,
    frame_poses,
    points_in_world,
)
from middeck.structure.elements.motion_since_drawn import Inside, SinceDrawn, within
from middeck.structure.elements.offset_points import PoseMap, map_points
from middeck.structure.elements.trees import joint_chain
from middeck.structure.model.article import Body, Joint, JointState, Structure, held_angle
from middeck.structure.model.article_checks import check_structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.component import APART, Component, body_of, frame_weights
from middeck.structure.model.member_mesh import cut_members, member_geometry
from middeck.values import record


@record(kw_only=True)
class Model:
    """A meshed structure, undeformed. Every array of poses indexes ``points``.

    Attributes:
        frames: Names of the frames: nodes, mesh nodes inside members, joints.
        tree, rest, points: Topology, undeformed configuration, and the points that anything acts on.
        element_ends, element_triad, element_member, beams: The two poses of each beam element, its undeformed
            triad, its member, its properties.
        body_point, body_mass, body_inertia: Rigid bodies at their centres of mass.
        attach_names, attach_point: Attach points by name.
        spring_ends: Attach-point poses of the structure's own springs.
        bushing_ends, load_point: Attach-point poses of its bushings, and poses of its loads.
        components: Reduced components.
        held: Coordinates held by clamps; None for a free article.
        links: Numbers that links hold constant; None for no links.
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
    bushing_ends: Int[np.ndarray, "bushing 2"]
    load_point: Int[np.ndarray, " load"]
    components: tuple[ComponentElement, ...] = ()
    held: Held | None = None
    links: LinkRows | None = None

    @functools.cached_property
    def drawn(self) -> Poses:
        """Poses of the frames as drawn."""
        return frame_poses(self.tree, self.rest)

    @functools.cached_property
    def pose_map(self) -> PoseMap:
        """The map from coordinates to ``points``."""
        return map_points(self.tree, self.points)

    @functools.cached_property
    def inside(self) -> Inside:
        """Beams and bushings inside carried parts."""
        since, roots, frame = self.rest.since_drawn, self.tree.roots, self.points.frame
        return Inside(*(within(since, roots, frame[e]) for e in (self.element_ends, self.bushing_ends)))

    @functools.cached_property
    def pattern(self) -> Pattern:
        """Places of elements, springs, bushings, bodies and ties of attach points in matrices."""
        ends = {
            "element": self.element_ends,
            "spring": self.spring_ends,
            "bushing": self.bushing_ends,
            "body": self.body_point[:, None],
            "attach": self.attach_point[:, None],
        }
        return lay_out_pattern(self.pose_map, ends)


def mesh_structure(structure: Structure, clamps: Sequence[Clamp] = ()) -> Model:
    """Mesh every member into its number of elements, lay out coordinates and poses, and hold ``clamps``.

    Raises `ConfigError` for a structure with names of missing parts, or whose geometry is impossible, and for
    a clamp of no node or of a direction that is held already.
    """
    check_structure(structure)
    model = lay_out(with_modal_coordinates(structure))
    _check_placed(model)
    roots = {node.name: i for i, node in enumerate(structure.nodes)}
    held = hold_nodes(clamps, roots, model.tree.size, model.tree.roots)
    x, carrier = model.rest.x, _carriers(model, {roots[c.node] for c in clamps})
    drawn = SinceDrawn(x, carrier, np.zeros_like(x), np.zeros((len(x), 3, 3)))
    return dataclasses.replace(model, rest=dataclasses.replace(model.rest, since_drawn=drawn), held=held)


def _carriers(model: Model, held: Collection[int]) -> Int[np.ndarray, " root"]:
    roots, ends = model.tree.roots, np.concatenate([model.spring_ends, model.bushing_ends])
    at = [joint_chain(model.tree, int(frame))[0] for frame in model.points.frame[ends].ravel()]
    stiffness = [spring.stiffness for spring in model.structure.springs]
    size = float(np.linalg.norm(np.ptp(model.rest.x, axis=0))) or 1.0
    stiffness += [bushing_stiffness(b.stiffness, size) for b in model.structure.bushings]
    return choose_carriers(
        roots,
        model.beams,
        model.points.frame[model.element_ends],
        np.array(at, dtype=int).reshape(-1, 2),
        np.array(stiffness) + 0.0,
        model.structure.mass,
        held,
    )


def lay_out(structure: Structure) -> Model:
    """`mesh_structure` without its checks; analytic in every number of the structure."""
    geometry = member_geometry(structure)
    cut = cut_members(structure, geometry)
    inner = tuple(f"{m.name}/{k}" for m in structure.members for k in range(1, m.elements))
    frames = (*(n.name for n in structure.nodes), *inner, *(j.name for j in structure.joints))
    index = {name: i for i, name in enumerate(frames)}
    x = np.concatenate([np.array([n.position for n in structure.nodes]).reshape(-1, 3), cut.inner])
    bodies = _bodies(structure, index)
    ends = cut.frame.size
    attach = {a.name: ends + len(bodies) + i for i, a in enumerate(structure.attach_points)}
    places = [(frame, body.cg) for frame, body in bodies]
    places += [(index[a.frame], a.offset) for a in (*structure.attach_points, *structure.loads)]
    grids = ends + len(places)
    places += [
        (index[f], at) for p in structure.components for f, at in zip(p.frames, p.fixed_at, strict=True)
    ]
    linked = link_points(structure.links)
    places += [(index[frame], offset) for frame, offset in linked]
    spring_ends, bushing_ends = (
        np.array([[attach[t.start], attach[t.end]] for t in ties], dtype=int).reshape(-1, 2)
        for ties in (structure.springs, structure.bushings)
    )
    joints, tree = structure.joints, _frame_tree(structure.joints, index, roots=len(x))
    angle = np.array([held_angle(j) for j in joints]) + 0.0
    rest = Configuration(x, np.tile(np.eye(3), (len(x), 1, 1)), angle)
    place = frame_poses(tree, rest).p if linked else x
    return Model(
        structure=structure,
        frames=frames,
        tree=tree,
        rest=rest,
        points=PosePoints(
            np.concatenate([cut.frame.ravel(), np.array([frame for frame, _ in places], dtype=int)]),
            np.concatenate([cut.offset.reshape(-1, 3), np.array([at for _, at in places]).reshape(-1, 3)]),
        ),
        element_ends=np.arange(ends).reshape(-1, 2),
        element_triad=geometry.triad[cut.member],
        element_member=cut.member,
        beams=beam_properties(
            [section for m in structure.members for section in m.sections],
            cut.length,
            (np.array([m.tension for m in structure.members]) + 0.0)[cut.member],
        ),
        body_point=ends + np.arange(len(bodies)),
        body_mass=np.array([b.mass for _, b in bodies]) + 0.0,
        body_inertia=np.array([b.inertia for _, b in bodies]).reshape(len(bodies), 3, 3),
        attach_names=tuple(attach),
        attach_point=np.array(list(attach.values()), dtype=int),
        spring_ends=spring_ends,
        bushing_ends=bushing_ends,
        load_point=ends + len(bodies) + len(attach) + np.arange(len(structure.loads)),
        components=_components(structure, grids),
        links=lay_out_links(
            structure.links,
            {frame: place[index[frame]] for frame, _ in linked},
            {joint.name: 6 * len(x) + k for k, joint in enumerate(joints)},
            ends + len(places) - len(linked),
            tree.size,
        ),
    )


def _frame_tree(joints: Sequence[Joint], index: dict[str, int], roots: int) -> FrameTree:
    return FrameTree(
        roots=roots,
        parent=np.array([index[j.parent] for j in joints], dtype=int),
        offset=np.array([j.offset for j in joints]).reshape(-1, 3),
        axis=np.array([j.axis for j in joints]).reshape(-1, 3),
        slides=np.array([j.slides for j in joints], dtype=bool),
    )


def with_modal_coordinates(structure: Structure) -> Structure:
    """The structure with the modal coordinates of its components as massless slides that couple to nothing.

    They stand behind its joints; what moves with them is in the matrices of their components alone.
    """
    none = Body(0.0, np.zeros(3), np.zeros((3, 3)))
    modal = tuple(
        Joint(
            name=f"{part.name}/q{k + 1}",
            parent=part.frames[0],
            offset=np.zeros(3),
            axis=np.array([1.0, 0.0, 0.0]),
            angle=0.0,
            body=none,
            state=JointState.INTERNAL,
            slides=True,
        )
        for part in structure.components
        for k in range(part.modal)
    )
    return dataclasses.replace(structure, joints=(*structure.joints, *modal))


def _components(structure: Structure, first: int) -> tuple[ComponentElement, ...]:
    """Components in the axes of W as drawn; their grids are the points from ``first`` on."""
    place = {joint.name: i for i, joint in enumerate(structure.joints)}
    out: list[ComponentElement] = []
    for part in structure.components:
        joint = np.array([place[f"{part.name}/q{k + 1}"] for k in range(part.modal)], dtype=int)
        out.append(_component(part, first + np.arange(len(part.grids)), joint))
        first += len(part.grids)
    return tuple(out)


def _check_placed(model: Model) -> None:
    """Grids stand where their frames are, up to a shift of all of them."""
    for part, element in zip(model.structure.components, model.components, strict=True):
        drawn = points_in_world(model.points.of(element.point), model.drawn)
        apart = (drawn - drawn[0]) - (element.arms - element.arms[0])
        far = np.linalg.norm(apart, axis=1)
        worst = int(np.argmax(far))
        if far[worst] > APART * max(1.0, float(np.abs(element.arms).max())):
            raise ConfigError(
                f"grid {part.grids[worst]} stands {far[worst]:.4g} m from frame {part.frames[worst]!r} "
                f"that it is fixed to, seen from grid {part.grids[0]}",
                where=f"component {part.name!r}",
                hint="check the nodes' places, the component's axes, and which grid is fixed to which frame; "
                "a grid off its frame has its place there in offsets_m",
            )


def _component(part: Component, point: np.ndarray, joint: np.ndarray) -> ComponentElement:
    grids = 6 * len(point)
    k, m = (np.abs(np.diagonal(matrix))[grids:] for matrix in (part.stiffness, part.mass))
    # In metres of the whole component: modal coordinates come in any unit, steps and residuals in one.
    turn = np.diag(np.concatenate([np.ones(grids), np.sqrt(part.weight / (m + k / (2.0 * np.pi) ** 2))]))
    turn[:grids, :grids] = np.kron(np.eye(2 * len(point)), part.axes)
    K, M = (turn @ (0.5 * (matrix + matrix.T)) @ turn.T for matrix in (part.stiffness, part.mass))
    weights, whole = frame_weights(part), body_of(part)
    centre = weights[:, 0] @ part.positions / weights[:, 0].sum()
    return ComponentElement(
        point=point,
        joint=joint,
        basis=turn.T,
        stiffness=K,
        mass=M,
        arms=(part.positions - centre) @ part.axes.T,
        weights=weights,
        moment=whole.mass * part.axes @ (whole.cg - centre),
    )


def select_beams(beams: BeamProperties, rows: slice | np.ndarray) -> BeamProperties:
    """The properties of some of the elements."""
    if isinstance(rows, slice) and not rows.start and (rows.stop or 0) >= len(beams.length):
        return beams
    return BeamProperties(**{f.name: getattr(beams, f.name)[rows] for f in dataclasses.fields(beams)})


def _bodies(structure: Structure, index: dict[str, int]) -> list[tuple[int, Body]]:
    """Frame and body of everything that has one."""
    parts = (*structure.nodes, *structure.joints)
    own = [(index[p.name], p.body) for p in parts if p.body.mass != 0.0 or np.any(p.body.inertia)]
    return own + [(index[m.frame], m.body) for m in structure.masses]
