"""Total potential energy of a model in an environment: value, gradient, tangent; and the mass matrix.

All of it is analytic in the configuration, the model and the loads: complex ones give derivatives.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact, Int

from middeck.structure.assembly.inside import Inside, Within
from middeck.structure.assembly.linked import link_part
from middeck.structure.assembly.mesh import Model, select_beams
from middeck.structure.assembly.places import (
    At,
    carried_turning,
    drawn_places,
    moved_since,
    poses_at,
    symmetric,
    transport,
)
from middeck.structure.elements.beam import (
    BeamProperties,
    BeamState,
    beam_deformations,
    beam_state,
    beam_weight,
    tensioned,
)
from middeck.structure.elements.beam_inertia import beam_mass
from middeck.structure.elements.beam_kinematics import EndStrain, end_strain
from middeck.structure.elements.bushings import NO_BUSHINGS, BushingState, bushing_state
from middeck.structure.elements.component import (
    ComponentElement,
    ComponentState,
    component_mass,
    component_state,
)
from middeck.structure.elements.devices import (
    NO_SPRINGS,
    SpringLaw,
    SpringState,
    predicted_tension,
    spring_squares,
    spring_state,
)
from middeck.structure.elements.frames import (
    Configuration,
    PosePoints,
    frame_poses,
    points_in_world,
)
from middeck.structure.elements.since_drawn import (
    Lever,
    add_pull,
    lever_stiffness,
    levers,
    move_ends,
    seen_from,
    summed,
)
from middeck.structure.model.article import JointState
from middeck.values import record

# Elements whose derivatives are formed together: their arrays, 10 kB each, should stay in the cache.
CHUNK = 1024


@record(kw_only=True)
class Ground:
    """Bushings from attach points to the ground: poses, stiffness and, as columns, axes in W."""

    point: Int[np.ndarray, " ground"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    stiffness: Inexact[np.ndarray, "ground 6 6"] = field(default_factory=lambda: np.zeros((0, 6, 6)))
    axes: Inexact[np.ndarray, "ground 3 3"] = field(default_factory=lambda: np.zeros((0, 3, 3)))


@record(kw_only=True)
class Loads:
    """Loads of the environment: gravity [m/s^2], and springs from anchors (in W) to attach points.

    ``mass`` [kg] of each device moves with its attach point along the device only. ``push`` is the force [N]
    and moment [N m] in W of each load of the article, none of them where it is empty. ``tension`` is the part
    of the members' tension as drawn that acts.
    """

    gravity: Inexact[np.ndarray, "3"]
    anchor: Inexact[np.ndarray, "device 3"]
    attach_point: Int[np.ndarray, " device"]
    law: SpringLaw
    mass: Inexact[np.ndarray, " device"]
    push: Inexact[np.ndarray, "load 6"] = field(default_factory=lambda: np.zeros((0, 6)))
    ground: Ground = field(default_factory=Ground)
    tension: float = 1.0


@record(kw_only=True)
class Assembly:
    """The potential at one configuration.

    ``gradient`` and ``tangent`` are in the coordinates of the frame tree, the pull of links included (see
    `linked`); ``jacobian`` takes them to poses.
    """

    energy: float
    gradient: Inexact[np.ndarray, " coordinate"]
    tangent: sp.csr_array
    jacobian: sp.csr_array
    tension: Inexact[np.ndarray, " device"]


class Inner(NamedTuple):
    """Internal forces: on the six deformations of each beam and bushing, and the tension of each spring."""

    beam: np.ndarray
    spring: np.ndarray
    device: np.ndarray
    bushing: np.ndarray
    ground: np.ndarray


class TangentParts(NamedTuple):
    """The tangent as a sum, in the coordinates of the frame tree.

    ``material``: elastic strain of members, springs and joints at zero force. ``geometric``: all that is
    linear in the forces of members, springs, weight and (dead) device pulls. ``device``: the rest of what
    devices do, their stiffness along and their pull over length across them.
    """

    material: sp.csr_array
    geometric: sp.csr_array
    device: sp.csr_array


def no_loads() -> Loads:
    """Orbit: no gravity, no devices."""
    none = np.zeros(0)
    return Loads(
        gravity=np.zeros(3),
        anchor=np.zeros((0, 3)),
        attach_point=none.astype(int),
        law=SpringLaw(none, none, none),
        mass=none,
    )


def assemble(
    model: Model,
    config: Configuration,
    loads: Loads,
    point_load: Inexact[np.ndarray, "pose 6"] | None = None,
) -> Assembly:
    """Energy and two derivatives at ``config``; ``point_load`` is a further energy gradient at the poses."""
    at = poses_at(model, config)
    bare = _assembled(model, config, at, _gather(model, at, loads, None), point_load)
    return _with_links(model, config, bare, in_world=True)


def _with_links(model: Model, config: Configuration, bare: Assembly, *, in_world: bool) -> Assembly:
    if model.links is None:
        return bare
    pull, bent = link_part(model, config, bare.gradient, in_world=in_world)
    return dataclasses.replace(
        bare, gradient=bare.gradient + pull, tangent=symmetric(sp.csr_array(bare.tangent + bent))
    )


def assemble_carried(
    model: Model,
    config: Configuration,
    loads: Loads,
    point_load: Inexact[np.ndarray, "pose 6"] | None = None,
    inner: Inner | None = None,
) -> Assembly:
    """`assemble` in carried coordinates (see `since_drawn`): soft motions keep their digits.

    ``inner`` replaces the internal forces in the tangent.

    Only the motion of its ends relative to their common carrier enters the rows of a member inside a carried
    part, so that no large terms cancel there.
    """
    since = config.since_drawn
    if since is None or not since.carries:
        at = poses_at(model, config)
        bare = _assembled(model, config, at, _gather(model, at, loads, inner), point_load)
        return _with_links(model, config, bare, in_world=False)
    at = poses_at(model, config)
    total = _gather(model, at, loads, inner, model.inside)
    outside = _assembled(model, config, at, total, point_load)
    pull = outside.gradient - outside.jacobian.T @ total.excess.ravel()
    T, parts = transport(config, model.tree), carried_turning(model, at, since, pull)
    back = T.T.tocsr()
    energy, gradient = outside.energy, back @ outside.gradient
    for state, links in _inside_parts(model, at, total, inner):
        energy = energy + float(np.sum(state.energy))
        add_pull(links, state.gradient + state.excess, gradient)
        parts += lever_stiffness(links, _by_ends(state.gradient), state.material + state.geometric)
    tangent = back @ outside.tangent @ T + summed(parts, model.tree.size)
    bare = Assembly(
        energy=energy,
        gradient=gradient,
        tangent=symmetric(tangent),
        jacobian=outside.jacobian @ T,
        tension=outside.tension,
    )
    return _with_links(model, config, bare, in_world=False)


def geometric_tangent(model: Model, config: Configuration, loads: Loads) -> sp.csr_array:
    """Geometric part of the tangent in carried coordinates: from forces, without strain and devices."""
    at, since = poses_at(model, config), config.since_drawn
    carries = since is not None and since.carries
    total = _gather(model, at, loads, None, model.inside if carries else None)
    J = model.pose_map.jacobian(at.poses)
    forced = {**total.geometric, **_turning(model, at, total.gradient)}
    if len(loads.ground.point):
        forced["attach"] = _at_poses(
            model, loads.ground.point, _grounded(model, at, loads).geometric[:, 6:, 6:]
        )
    bare = model.pattern.matrix(J.data, forced)
    out = _with_components(bare, total.components, lambda state: state.geometric)
    gradient = J.T @ total.gradient.ravel() + total.modal + _sprung_joints(model, config)[1]
    if since is not None and since.carries:
        T, parts = transport(config, model.tree), carried_turning(model, at, since, gradient)
        gradient = T.T @ gradient
        for state, links in _inside_parts(model, at, total):
            add_pull(links, state.gradient, gradient)
            parts += lever_stiffness(links, _by_ends(state.gradient), state.geometric)
        out = symmetric(sp.csr_array(T.T @ out @ T + summed(parts, model.tree.size)))
    if model.links is None:
        return out
    return symmetric(sp.csr_array(out + link_part(model, config, gradient, in_world=False)[1]))


def strain_energies(
    model: Model, config: Configuration, loads: Loads, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode mode"]:
    """The rest of the tangent, applied to ``shapes`` in carried coordinates: a sum of squared strains.

    Nothing cancels but within a strain, so that it rounds by the square of the rounding of the shapes.
    """
    at = poses_at(model, config)
    motion, ends, tied = _motions(model, config, at, shapes)
    out = np.zeros((shapes.shape[1], shapes.shape[1]))
    for rows in _chunks(len(model.element_ends)):
        x, T, known = _element_ends(model, at, rows)
        beams = select_beams(model.beams, rows)
        _, slope = beam_deformations(beams, x, T, known)
        strain = slope @ ends[rows]
        out += np.einsum("eim,ein->mn", strain, beams.stiffness @ strain)
    start, end = model.spring_ends.T
    stretched = _own_span(model, at)
    hung = _device_span(model, at, loads)
    out += spring_squares(own_law(model), *stretched, motion[end, :3] - motion[start, :3], along_only=True)
    out += spring_squares(loads.law, *hung, motion[loads.attach_point, :3])
    out += _own_bushings(model, at, inside=True).squares(tied)
    out += _grounded(model, at, loads).squares(_on_ground(motion[loads.ground.point]))
    for state, rows in component_states(model, config, loads):
        out += state.squares(rows @ (transport(config, model.tree) @ shapes))
    hinges = _sprung_joints(model, config)[2]
    return out + shapes.T @ (hinges[:, None] * shapes)


def predict_forces(
    model: Model, config: Configuration, loads: Loads, q: Inexact[np.ndarray, " coordinate"]
) -> Inner:
    """Forces after a step ``q`` in carried coordinates, to first order."""
    at = poses_at(model, config)
    motion, ends, tied = (m[..., 0] for m in _motions(model, config, at, q[:, None]))
    forces = [np.zeros((0, 6))]
    for rows in _chunks(len(model.element_ends)):
        x, T, known = _element_ends(model, at, rows)
        beams = _tensioned_beams(model, loads, rows)
        value, slope = beam_deformations(beams, x, T, known)
        strain = value + (slope @ ends[rows][:, :, None])[:, :, 0]
        forces.append(tensioned(beams, (beams.stiffness @ strain[:, :, None])[:, :, 0]))
    start, end = model.spring_ends.T
    own = predicted_tension(own_law(model), *_own_span(model, at), motion[end, :3] - motion[start, :3])
    device = predicted_tension(loads.law, *_device_span(model, at, loads), motion[loads.attach_point, :3])
    between = _own_bushings(model, at, inside=True).predicted(tied)
    ground = _grounded(model, at, loads).predicted(_on_ground(motion[loads.ground.point]))
    return Inner(np.concatenate(forces), own, device, between, ground)


def _motions(
    model: Model, config: Configuration, at: At, shapes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motions (pose, 6, mode), and (.., 12, mode) of the ends of beams and bushings that carriers see."""
    count = shapes.shape[1]
    J = model.pose_map.jacobian(at.poses)
    motion = (J @ (transport(config, model.tree) @ shapes)).reshape(len(at.world), 6, count)
    ends = motion[model.element_ends].reshape(len(model.element_ends), 12, count)
    tied = motion[model.bushing_ends].reshape(len(model.bushing_ends), 12, count)
    for moved, poses, part in (
        (ends, model.element_ends, model.inside.beams),
        (tied, model.bushing_ends, model.inside.bushings),
    ):
        if len(part.rows) and at.since is not None:
            moved[part.rows] = move_ends(_levers(at, poses, part), shapes)
    return motion, ends, tied


def _levers(at: At, ends: np.ndarray, part: Within) -> list[Lever]:
    return levers(part.chain, at.poses.p, at.world[ends[part.rows]])


def _by_ends(load: np.ndarray) -> np.ndarray:
    return load.reshape(len(load), -1, 6)


def _inside_parts(
    model: Model, at: At, total: _Total, inner: Inner | None = None
) -> Iterable[tuple[BeamState | BushingState, list[Lever]]]:
    """State of the beams inside carried parts, without their weight, and that of the bushings.

    With how their ends move as the common carriers see them.
    """
    beams, bushings = model.inside
    if len(beams.rows):
        parts = (np.concatenate(some) for some in zip(*total.apart, strict=True))
        yield BeamState(*parts), _levers(at, model.element_ends, beams)
    if len(bushings.rows):
        tied = _own_bushings(model, at, inner, inside=True).of(bushings.rows)
        yield tied, _levers(at, model.bushing_ends, bushings)


def carried_mass(model: Model, config: Configuration, loads: Loads | None = None) -> sp.csr_array:
    """`mass_matrix` in carried coordinates."""
    M, since = mass_matrix(model, config, loads), config.since_drawn
    if since is None or not since.carries:
        return M
    T = transport(config, model.tree)
    return symmetric(sp.csr_array(T.T @ M @ T))


def _assembled(
    model: Model, config: Configuration, at: At, total: _Total, point_load: np.ndarray | None
) -> Assembly:
    gradient = total.gradient if point_load is None else total.gradient + point_load
    J = model.pose_map.jacobian(at.poses)
    blocks = {name: total.material[name] + part for name, part in total.geometric.items()}
    blocks |= {"attach": total.device, **_turning(model, at, gradient)}
    joint_energy, joint_gradient, hinges = _sprung_joints(model, config)
    g = J.T @ (gradient + total.excess).ravel() + total.modal + joint_gradient
    bare = model.pattern.matrix(J.data, blocks, hinges)
    K = _with_components(bare, total.components, lambda state: state.material + state.geometric)
    return Assembly(
        energy=total.energy + joint_energy, gradient=g, tangent=K, jacobian=J, tension=total.tension
    )


def _turning(model: Model, at: At, gradient: np.ndarray) -> dict[str, np.ndarray]:
    return {"turning": model.pose_map.second_order(at.poses, gradient)}


def energy_gradient(
    model: Model, config: Configuration, loads: Loads, point_load: Inexact[np.ndarray, "pose 6"]
) -> Inexact[np.ndarray, " coordinate"]:
    """The gradient of `assemble` alone."""
    at = poses_at(model, config)
    total = _gather(model, at, loads, None)
    gradient = model.pose_map.jacobian(at.poses).T @ (total.gradient + point_load).ravel()
    return gradient + total.modal + _sprung_joints(model, config)[1]


def split_tangent(model: Model, geometry: Configuration, loads: Loads, inner: Inner) -> TangentParts:
    """The tangent at ``geometry`` under the forces ``inner``, which may be those of another configuration."""
    at = poses_at(model, geometry)
    total = _gather(model, at, loads, inner)
    values = model.pose_map.jacobian_values(at.poses)
    material = model.pattern.matrix(values, total.material, _sprung_joints(model, geometry)[2])
    geometric = model.pattern.matrix(values, {**total.geometric, **_turning(model, at, total.gradient)})
    return TangentParts(
        _with_components(material, total.components, lambda state: state.material),
        _with_components(geometric, total.components, lambda state: state.geometric),
        model.pattern.matrix(values, {"attach": total.device}),
    )


def device_tension(model: Model, config: Configuration, loads: Loads) -> Inexact[np.ndarray, " device"]:
    """The pull of each device at ``config``."""
    drawn, change = _device_span(model, poses_at(model, config), loads)
    return spring_state(loads.law, drawn + change, None, (drawn, change)).tension


def inner_forces(model: Model, config: Configuration, loads: Loads) -> Inner:
    """The forces at ``config``."""
    return _gather(model, poses_at(model, config), loads, None).inner


def mass_matrix(model: Model, config: Configuration, loads: Loads | None = None) -> sp.csr_array:
    """Consistent mass of beams, bodies and, with ``loads``, devices in the coordinates of the frame tree."""
    at = poses_at(model, config)
    elements = [np.zeros((0, 12, 12))]
    for rows in _chunks(len(model.element_ends)):
        x, T, _ = _element_ends(model, at, rows)
        elements.append(beam_mass(select_beams(model.beams, rows), x, T))
    R = at.poses.R[model.points.frame[model.body_point]]
    body = np.zeros((len(model.body_point), 6, 6), dtype=np.result_type(R, model.body_inertia))
    body[:, :3, :3] = model.body_mass[:, None, None] * np.eye(3)
    body[:, 3:, 3:] = R @ model.body_inertia @ np.swapaxes(R, 1, 2)
    blocks = {"element": np.concatenate(elements), "body": body}
    if loads is not None and np.any(loads.mass):
        span = at.world[loads.attach_point] - loads.anchor
        along = span / np.sqrt(np.einsum("di,di->d", span, span))[:, None]
        moving = loads.mass[:, None, None] * along[:, :, None] * along[:, None, :]
        blocks["attach"] = _at_attach_points(model, loads, moving)
    mass = model.pattern.matrix(model.pose_map.jacobian_values(at.poses), blocks)
    for part in model.components:
        rows = _component_rows(model, model.pose_map.jacobian(at.poses), part)
        own = component_mass(part, *moved_since(model, at, part.point))
        mass = symmetric(sp.csr_array(mass + rows.T @ own @ rows))
    return mass


def component_states(
    model: Model, config: Configuration, loads: Loads
) -> list[tuple[ComponentState, sp.csr_array]]:
    """States of the components, and the rows that take coordinates to those of each."""
    return _component_states(model, poses_at(model, config), loads)


def _component_states(model: Model, at: At, loads: Loads) -> list[tuple[ComponentState, sp.csr_array]]:
    if not model.components:
        return []
    J = model.pose_map.jacobian(at.poses)
    out: list[tuple[ComponentState, sp.csr_array]] = []
    for part in model.components:
        shift, turn = moved_since(model, at, part.point)
        modal = at.angle[part.joint]
        state = component_state(part, at.world[part.point], shift, turn, modal, loads.gravity)
        out.append((state, _component_rows(model, J, part)))
    return out


def _component_rows(model: Model, J: sp.csr_array, part: ComponentElement) -> sp.csr_array:
    """Motions of the grids' poses and of the modal coordinates per coordinate."""
    poses = (6 * part.point[:, None] + np.arange(6)).ravel()
    count = len(part.joint)
    unit = (np.ones(count), (np.arange(count), 6 * model.tree.roots + part.joint))
    modal = sp.coo_array(unit, shape=(count, model.tree.size))
    return sp.csr_array(sp.vstack([J[poses], modal]))


def _with_components(
    matrix: sp.csr_array,
    parts: Sequence[tuple[ComponentState, sp.csr_array]],
    of: Callable[[ComponentState], np.ndarray],
) -> sp.csr_array:
    for state, rows in parts:
        matrix = symmetric(sp.csr_array(matrix + rows.T @ of(state) @ rows))
    return matrix


def element_poses(model: Model, config: Configuration) -> tuple[np.ndarray, np.ndarray]:
    """End positions (element, 2, 3) and triads (element, 2, 3, 3) of all beam elements."""
    return _element_poses(model, poses_at(model, config), slice(None))


class _Total(NamedTuple):
    """Sums over all elements, at the poses, and matrices by groups of elements; devices by attach points.

    ``excess`` is what the elements' own forces add to the gradient where others have taken their place;
    ``modal`` is the part of the gradient that components have in their modal coordinates. ``apart`` are the
    states of beams inside carried parts, which are not in the sums.
    """

    energy: float
    gradient: np.ndarray
    excess: np.ndarray
    modal: np.ndarray
    components: list[tuple[ComponentState, sp.csr_array]]
    inner: Inner
    tension: np.ndarray
    material: dict[str, np.ndarray]
    geometric: dict[str, np.ndarray]
    device: np.ndarray
    apart: list[BeamState]


def _gather(model: Model, at: At, loads: Loads, inner: Inner | None, inside: Inside | None = None) -> _Total:
    """All elements at their poses; ``inner`` takes the place of the forces inside them.

    Of those ``inside`` carried parts only the weight counts.
    """
    dtype = np.result_type(
        *(at.world, at.poses.R, loads.gravity, model.body_mass, model.beams.stiffness, loads.law.stiffness),
        *(loads.push, loads.ground.stiffness, *(b.stiffness for b in model.structure.bushings)),
    )
    gradient = np.zeros((len(at.world), 6), dtype=np.result_type(dtype, model.beams.length, loads.anchor))
    excess = np.zeros_like(gradient)
    material = [np.zeros((0, 12, 12))]
    geometric = [np.zeros((0, 12, 12))]
    energy = 0.0
    forces: list[np.ndarray] = [np.zeros((0, 6))]
    apart: list[BeamState] = []
    for rows in _chunks(len(model.element_ends)):
        x, T, known = _element_ends(model, at, rows)
        beams, ends = _tensioned_beams(model, loads, rows), model.element_ends[rows]
        strain = beam_state(beams, x, T, None if inner is None else inner.beam[rows], known)
        if inside is not None:
            own = inside.beams.rows
            apart.append(_taken(strain, own[(rows.start <= own) & (own < rows.stop)] - rows.start))
        weight = beam_weight(beams, x, T, loads.gravity)
        gradient[ends] += (strain.gradient + weight.gradient).reshape(-1, 2, 6)
        excess[ends] += strain.excess.reshape(-1, 2, 6)
        energy += np.sum(strain.energy + weight.energy)
        energy -= (beams.rho_A * beams.length) @ (at.world[ends[:, 0]] - x[:, 0]) @ loads.gravity
        forces.append(strain.force)
        material.append(strain.material)
        geometric.append(strain.geometric + weight.hessian)
    energy -= model.body_mass @ (at.world[model.body_point] @ loads.gravity)
    gradient[model.body_point, :3] -= model.body_mass[:, None] * loads.gravity
    own = _own_springs(model, at, (gradient, excess), None if inner is None else inner.spring)
    drawn, change = _device_span(model, at, loads)
    device = spring_state(loads.law, drawn + change, None if inner is None else inner.device, (drawn, change))
    np.add.at(gradient[:, :3], loads.attach_point, device.gradient)
    np.add.at(excess[:, :3], loads.attach_point, device.excess)
    held = _at_attach_points(model, loads, device.material + device.geometric)
    between, ground = _own_bushings(model, at, inner), _grounded(model, at, loads, inner)
    if inside is not None:
        for part in between:
            part[inside.bushings.rows] = 0.0
    np.add.at(gradient, model.bushing_ends, between.gradient.reshape(-1, 2, 6))
    np.add.at(excess, model.bushing_ends, between.excess.reshape(-1, 2, 6))
    if len(loads.ground.point):
        np.add.at(gradient, loads.ground.point, ground.gradient[:, 6:])
        np.add.at(excess, loads.ground.point, ground.excess[:, 6:])
        held = held + _at_poses(model, loads.ground.point, (ground.material + ground.geometric)[:, 6:, 6:])
    energy += np.sum(own.energy) + np.sum(device.energy)
    energy += np.sum(between.energy) + np.sum(ground.energy) + _push(model, at, loads, gradient)
    forces_inside = Inner(np.concatenate(forces), own.tension, device.tension, between.force, ground.force)
    modal, parts = np.zeros(model.tree.size, gradient.dtype), _component_states(model, at, loads)
    for part, (state, _) in zip(model.components, parts, strict=True):
        grids = 6 * len(part.point)
        energy += state.energy
        np.add.at(gradient, part.point, state.gradient[:grids].reshape(-1, 6))
        modal[6 * model.tree.roots + part.joint] += state.gradient[grids:]
    return _Total(
        energy,
        gradient,
        excess,
        modal,
        parts,
        forces_inside,
        device.tension,
        {
            "element": np.concatenate(material),
            "spring": _between(own.material),
            "bushing": between.material,
        },
        {
            "element": np.concatenate(geometric),
            "spring": _between(own.geometric),
            "bushing": between.geometric,
        },
        held,
        apart,
    )


def _tensioned_beams(model: Model, loads: Loads, rows: slice | np.ndarray) -> BeamProperties:
    """Some of the elements, with as much of their tension as acts."""
    beams = select_beams(model.beams, rows)
    if loads.tension == 1.0:
        return beams
    return dataclasses.replace(beams, tension=loads.tension * beams.tension)


def _taken(state: BeamState, some: np.ndarray) -> BeamState:
    """The state of ``some`` elements, what they add to sums being zero in ``state`` then."""
    out = BeamState(*(part[some] for part in state))
    for part in (state.energy, state.gradient, state.excess, state.material, state.geometric):
        part[some] = 0.0
    return out


def _own_springs(
    model: Model, at: At, gradients: tuple[np.ndarray, np.ndarray], tension: np.ndarray | None
) -> SpringState:
    """The structure's own springs; adds to the gradient and to its excess."""
    if not model.structure.springs:
        return NO_SPRINGS
    start, end = model.spring_ends.T
    drawn, change = _own_span(model, at)
    state = spring_state(own_law(model), drawn + change, tension, (drawn, change))
    for gradient, own in zip(gradients, (state.gradient, state.excess), strict=True):
        np.add.at(gradient[:, :3], end, own)
        np.add.at(gradient[:, :3], start, -own)
    return state


def _between(hessian: np.ndarray) -> np.ndarray:
    """Matrices of the difference of two translations, on both poses."""
    h = _translations(hessian)
    out = np.empty((len(h), 12, 12), h.dtype)
    out[:, :6, :6] = out[:, 6:, 6:] = h
    out[:, :6, 6:] = out[:, 6:, :6] = -h
    return out


def _at_attach_points(model: Model, loads: Loads, hessian: np.ndarray) -> np.ndarray:
    """Matrices of devices on translations, summed at their attach points."""
    return _at_poses(model, loads.attach_point, _translations(hessian))


def _at_poses(model: Model, points: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    """Matrices on attach points, summed where there are several."""
    place = np.zeros(len(model.points.frame), dtype=int)
    place[model.attach_point] = np.arange(len(model.attach_point))
    out = np.zeros((len(model.attach_point), 6, 6), dtype=hessian.dtype)
    np.add.at(out, place[points], hessian)
    return out


def bushing_states(model: Model, config: Configuration, loads: Loads) -> tuple[BushingState, BushingState]:
    """States of the structure's own bushings, and of those to the ground."""
    at = poses_at(model, config)
    return _own_bushings(model, at), _grounded(model, at, loads)


def _own_bushings(model: Model, at: At, inner: Inner | None = None, *, inside: bool = False) -> BushingState:
    """Bushings of the structure; those ``inside`` carried parts with the digits that their carriers see."""
    own = model.structure.bushings
    if not own:
        return NO_BUSHINGS
    start, end = model.bushing_ends.T
    (begin, begun), (finish, finished) = (moved_since(model, at, pose) for pose in (start, end))
    span, change = at.world[end] - at.world[start], finish - begin
    turn = np.stack([begun, finished], axis=1)
    axes = np.tile(np.eye(3), (len(own), 1, 1))
    if inside and at.since is not None and at.since.carries:
        rows = model.inside.bushings.rows
        outer = model.inside.bushings.outer[rows]
        ends = model.bushing_ends[rows]
        frame, offset = model.points.frame[ends], model.points.offset[ends]
        seen = seen_from(at.since, frame.ravel(), offset.reshape(-1, 3), np.repeat(outer, 2))
        shift, turn[rows] = seen[0].reshape(-1, 2, 3), seen[1].reshape(-1, 2, 3, 3)
        change[rows] = shift[:, 1] - shift[:, 0]
        drawn = at.since.drawn[frame] + offset
        span[rows] = drawn[:, 1] - drawn[:, 0] + change[rows]
        axes[rows] = at.poses.R[outer]
    state = bushing_state(
        np.array([b.stiffness for b in own]).reshape(-1, 6, 6),
        np.array([b.axes for b in own]).reshape(-1, 3, 3),
        span,
        change,
        turn,
        None if inner is None else inner.bushing.copy(),  # cleared by `_gather`
    )
    return state.turned(axes) if inside else state


def _grounded(model: Model, at: At, loads: Loads, inner: Inner | None = None) -> BushingState:
    """Bushings to the ground, which is the first of their frames and does not move."""
    point = loads.ground.point
    if not len(point):
        return NO_BUSHINGS
    change, turn = moved_since(model, at, point)
    still = np.stack([np.zeros_like(turn), turn], axis=1)
    force = None if inner is None else inner.ground
    return bushing_state(loads.ground.stiffness, loads.ground.axes, change, change, still, force)


def _on_ground(motion: np.ndarray) -> np.ndarray:
    """Motions of poses beside that of the ground: none."""
    return np.concatenate([np.zeros_like(motion), motion], axis=1)


def _push(model: Model, at: At, loads: Loads, gradient: np.ndarray) -> float:
    """Energy of dead loads, whose force and moment are added to ``gradient``.

    A moment of fixed direction has no potential, and adds nothing to it.
    """
    if not len(loads.push):
        return 0.0
    np.add.at(gradient, model.load_point, -loads.push)
    return -np.sum(loads.push[:, :3] * moved_since(model, at, model.load_point)[0])


def _chunks(count: int) -> Iterable[slice]:
    return (slice(start, start + CHUNK) for start in range(0, count, CHUNK))


def _element_poses(model: Model, at: At, rows: slice | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    ends = model.element_ends[rows]
    R = at.poses.R[model.points.frame[ends]]
    return at.world[ends], R @ model.element_triad[rows, None]


def _element_ends(
    model: Model, at: At, rows: slice | np.ndarray
) -> tuple[np.ndarray, np.ndarray, EndStrain | None]:
    """End positions, which may count from the first end, triads, and the strain where it is known."""
    x, T = _element_poses(model, at, rows)
    if at.since is None:
        return x, T, None
    ends = model.element_ends[rows]
    frame, offset = model.points.frame[ends], model.points.offset[ends]
    shift, turn = at.motion[0][frame], at.motion[1][frame]
    shift = shift + (turn @ offset[..., None])[..., 0]
    triad, length = model.element_triad[rows], model.beams.length[rows]
    local = np.zeros_like(shift)
    local[:, 1] = length[:, None] * triad[:, :, 0] + shift[:, 1] - shift[:, 0]
    if at.since.carries:
        outer = model.inside.beams.outer[rows]
        some = np.flatnonzero(outer >= 0)
        seen = (frame[some].ravel(), offset[some].reshape(-1, 3), np.repeat(outer[some], 2))
        near, turned = seen_from(at.since, *seen)
        shift[some], turn[some] = near.reshape(-1, 2, 3), turned.reshape(-1, 2, 3, 3)
        drawn = length[some, None] * triad[some, :, 0]
        R = at.poses.R[outer[some]]
        local[some, 1] = (R @ (drawn + shift[some, 1] - shift[some, 0])[:, :, None])[:, :, 0]
    return local, T, end_strain(length, triad, shift, turn)


def pose_shift(model: Model, config: Configuration, pose: np.ndarray) -> Inexact[np.ndarray, "pose 3"]:
    """How far poses have moved since they were drawn."""
    drawn, change = drawn_places(model, poses_at(model, config), pose)
    here = PosePoints(model.points.frame[pose], model.points.offset[pose])
    return change + (drawn - points_in_world(here, frame_poses(model.tree, model.rest)))


def own_law(model: Model) -> SpringLaw:
    """Law of the structure's own springs."""
    own = model.structure.springs
    return SpringLaw(
        np.zeros(len(own)), np.array([s.stiffness for s in own]), np.array([s.free_length for s in own])
    )


def _own_span(model: Model, at: At) -> tuple[np.ndarray, np.ndarray]:
    """End minus start of the structure's own springs as drawn, and its change since."""
    (start, start_moved), (end, end_moved) = (drawn_places(model, at, p) for p in model.spring_ends.T)
    return end - start, end_moved - start_moved


def _device_span(model: Model, at: At, loads: Loads) -> tuple[np.ndarray, np.ndarray]:
    """The same for devices, from anchor to attach point."""
    drawn, change = drawn_places(model, at, loads.attach_point)
    return drawn - loads.anchor, change


def _translations(hessian: np.ndarray) -> np.ndarray:
    out = np.zeros((len(hessian), 6, 6), dtype=hessian.dtype)
    out[:, :3, :3] = hessian
    return out


def _sprung_joints(model: Model, config: Configuration) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy, gradient and the tangent's diagonal."""
    joints, none = model.structure.joints, np.zeros(6 * model.tree.roots)
    k = np.array([j.stiffness if j.state is JointState.SPRUNG else 0.0 for j in joints]) + 0.0
    turn = config.angle - np.array([j.target for j in joints])
    return 0.5 * np.sum(k * turn**2), np.concatenate([none, k * turn]), np.concatenate([none, k])
