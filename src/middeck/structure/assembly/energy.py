"""Total potential energy of a model in an environment: value, gradient, tangent; and the mass matrix.

All of it is analytic in the configuration, the model and the loads: complex ones give derivatives.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact

from middeck.structure.assembly.beam_ends import (
    beam_chunks,
    carried_levers,
    tensioned_beams,
)
from middeck.structure.assembly.component_states import PlacedComponent, place_components
from middeck.structure.assembly.environment_loads import Inner, Loads
from middeck.structure.assembly.linked import link_part
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import (
    Placement,
    carried_turning,
    moved_since,
    poses_at,
    root_levers,
    symmetric,
)
from middeck.structure.assembly.springs import (
    at_attach_points,
    at_poses,
    device_springs,
    grounded,
    on_translations,
    own_bushings,
    own_springs,
    sprung_joints,
)
from middeck.structure.elements.beam import BeamState, beam_state, beam_weight
from middeck.structure.elements.bushings import BushingState
from middeck.structure.elements.component_element import ComponentState
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.motion_since_drawn import (
    Inside,
    Lever,
    add_pull,
    lever_jacobian,
    lever_stiffness,
    summed,
)
from middeck.structure.elements.sparse_of_parts import transposed_product
from middeck.values import record


@record(kw_only=True)
class Assembly:
    """The potential at one configuration.

    ``gradient`` and ``tangent`` are in the coordinates of the frame tree, the pull of links included (see
    `linked`); ``jacobian`` takes them to poses. ``strain`` of each beam element, on (stretch, y1, z1, y2, z2,
    twist), and its ``slope`` in the poses of its ends.
    """

    energy: float
    gradient: Inexact[np.ndarray, " coordinate"]
    tangent: sp.csr_array
    jacobian: sp.csr_array
    tension: Inexact[np.ndarray, " device"]
    strain: Inexact[np.ndarray, "element 6"]
    slope: Inexact[np.ndarray, "element 6 12"]


class TangentParts(NamedTuple):
    """The tangent as a sum, in the coordinates of the frame tree.

    ``material``: elastic strain of members, springs and joints at zero force. ``geometric``: all that is
    linear in the forces of members, springs, weight and (dead) device pulls. ``device``: the rest of what
    devices do, their stiffness along and their pull over length across them.
    """

    material: sp.csr_array
    geometric: sp.csr_array
    device: sp.csr_array


def assemble(
    model: Model, config: Configuration, loads: Loads, point_load: Inexact[np.ndarray, "pose 6"] | None = None
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
    links = root_levers(config)
    T, parts = lever_jacobian(links, model.tree.size), carried_turning(links, pull)
    back = T.T.tocsr()
    energy, gradient = outside.energy, back @ outside.gradient
    for state, links in _inside_parts(model, at, total, inner):
        energy = energy + float(np.sum(state.energy))
        add_pull(links, state.gradient + state.excess, gradient)
        parts += lever_stiffness(links, _by_ends(state.gradient), state.material + state.geometric)
    tangent = back @ outside.tangent @ T + summed(parts, model.tree.size)
    bare = dataclasses.replace(
        outside, energy=energy, gradient=gradient, tangent=symmetric(tangent), jacobian=outside.jacobian @ T
    )
    return _with_links(model, config, bare, in_world=False)


def is_unstrained(model: Model, config: Configuration, at: Assembly, loads: Loads) -> bool:
    """Whether nothing pulls anywhere in an article of members alone: its energy is a sum of squares then.

    Springs of joints pull where links hold them against one another.
    """
    tied = (model.spring_ends, model.bushing_ends, model.components, loads.attach_point, loads.ground.point)
    pulls = (loads.gravity, loads.push, model.beams.tension, at.strain, sprung_joints(model, config)[1])
    return not any(map(len, tied)) and not any(map(np.any, pulls))


def geometric_tangent(model: Model, config: Configuration, loads: Loads) -> sp.csr_array:
    """Geometric part of the tangent in carried coordinates: from forces, not from strain or devices."""
    at, since = poses_at(model, config), config.since_drawn
    carries = since is not None and since.carries
    total = _gather(model, at, loads, None, model.inside if carries else None)
    J = model.pose_map.jacobian(at.poses)
    forced = {**total.geometric, **_turning(model, at, total.gradient)}
    if len(loads.ground.point):
        forced["attach"] = at_poses(
            model, loads.ground.point, grounded(model, at, loads).geometric[:, 6:, 6:]
        )
    bare = model.pattern.matrix(J.data, forced)
    out = _with_components(bare, total.components, lambda state: state.geometric)
    gradient = J.T @ total.gradient.ravel() + total.modal + sprung_joints(model, config)[1]
    if since is not None and since.carries:
        links = root_levers(config)
        T, parts = lever_jacobian(links, model.tree.size), carried_turning(links, gradient)
        gradient = T.T @ gradient
        for state, links in _inside_parts(model, at, total):
            add_pull(links, state.gradient, gradient)
            parts += lever_stiffness(links, _by_ends(state.gradient), state.geometric)
        out = symmetric(sp.csr_array(T.T @ out @ T + summed(parts, model.tree.size)))
    if model.links is None:
        return out
    return symmetric(sp.csr_array(out + link_part(model, config, gradient, in_world=False)[1]))


def _by_ends(load: np.ndarray) -> np.ndarray:
    return load.reshape(len(load), -1, 6)


def _inside_parts(
    model: Model, at: Placement, total: _Total, inner: Inner | None = None
) -> Iterable[tuple[BeamState | BushingState, list[Lever]]]:
    """State of the beams inside carried parts, without their weight, and that of the bushings.

    With how their ends move as the common carriers see them.
    """
    beams, bushings = model.inside
    if len(beams.rows):
        parts = (np.concatenate(some) for some in zip(*total.apart, strict=True))
        yield BeamState(*parts), carried_levers(at, model.element_ends, beams)
    if len(bushings.rows):
        tied = own_bushings(model, at, inner, inside=True).of(bushings.rows)
        yield tied, carried_levers(at, model.bushing_ends, bushings)


def _assembled(
    model: Model, config: Configuration, at: Placement, total: _Total, point_load: np.ndarray | None
) -> Assembly:
    gradient = total.gradient if point_load is None else total.gradient + point_load
    J = model.pose_map.jacobian(at.poses)
    blocks = {name: total.material[name] + part for name, part in total.geometric.items()}
    blocks |= {"attach": total.device, **_turning(model, at, gradient)}
    joint_energy, joint_gradient, hinges = sprung_joints(model, config)
    g = transposed_product(J, (gradient + total.excess).ravel()) + total.modal + joint_gradient
    bare = model.pattern.matrix(J.data, blocks, hinges)
    K = _with_components(bare, total.components, lambda state: state.material + state.geometric)
    return Assembly(
        energy=total.energy + joint_energy,
        gradient=g,
        tangent=K,
        jacobian=J,
        tension=total.tension,
        strain=total.beams.strain,
        slope=total.beams.slope,
    )


def _turning(model: Model, at: Placement, gradient: np.ndarray) -> dict[str, np.ndarray]:
    return {"turning": model.pose_map.second_order(at.poses, gradient)}


def energy_gradient(
    model: Model, config: Configuration, loads: Loads, point_load: Inexact[np.ndarray, "pose 6"]
) -> Inexact[np.ndarray, " coordinate"]:
    """The gradient of `assemble` alone."""
    at = poses_at(model, config)
    total = _gather(model, at, loads, None)
    J = model.pose_map.jacobian(at.poses)
    return (
        transposed_product(J, (total.gradient + point_load).ravel())
        + total.modal
        + sprung_joints(model, config)[1]
    )


def split_tangent(model: Model, geometry: Configuration, loads: Loads, inner: Inner) -> TangentParts:
    """The tangent at ``geometry`` under the forces ``inner``, which may be those of another configuration."""
    at = poses_at(model, geometry)
    total = _gather(model, at, loads, inner)
    values = model.pose_map.jacobian_values(at.poses)
    material = model.pattern.matrix(values, total.material, sprung_joints(model, geometry)[2])
    geometric = model.pattern.matrix(values, {**total.geometric, **_turning(model, at, total.gradient)})
    return TangentParts(
        _with_components(material, total.components, lambda state: state.material),
        _with_components(geometric, total.components, lambda state: state.geometric),
        model.pattern.matrix(values, {"attach": total.device}),
    )


def inner_forces(model: Model, config: Configuration, loads: Loads) -> Inner:
    """The forces at ``config``."""
    return _gather(model, poses_at(model, config), loads, None).inner


def _with_components(
    matrix: sp.csr_array, parts: Sequence[PlacedComponent], of: Callable[[ComponentState], np.ndarray]
) -> sp.csr_array:
    for _, _, state, rows in parts:
        matrix = symmetric(sp.csr_array(matrix + rows.T @ of(state) @ rows))
    return matrix


NO_BEAMS = BeamState(
    *(np.zeros((0, *size)) for size in ((), (6,), (12,), (12,), (12, 12), (12, 12), (6,), (6, 12)))
)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Total:
    """Sums over all elements, at the poses, and matrices by groups of elements; devices by attach points.

    ``excess`` is what the elements' own forces add to the gradient where others have taken their place;
    ``modal`` is the part of the gradient that components have in their modal coordinates. ``apart`` are the
    states of beams inside carried parts, which are not in the sums.
    """

    energy: float
    gradient: np.ndarray
    excess: np.ndarray
    modal: np.ndarray
    components: list[PlacedComponent]
    inner: Inner
    tension: np.ndarray
    material: dict[str, np.ndarray]
    geometric: dict[str, np.ndarray]
    device: np.ndarray
    beams: BeamState
    apart: list[BeamState]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Members:
    """Elements of members at their poses, with their weight, and the weight of bodies.

    ``apart`` are states of the elements inside carried parts.
    """

    energy: Any
    gradient: np.ndarray
    excess: np.ndarray
    beams: BeamState
    apart: list[BeamState]


def _gather(
    model: Model, at: Placement, loads: Loads, inner: Inner | None, inside: Inside | None = None
) -> _Total:
    """All elements at their poses; ``inner`` takes the place of the forces inside them.

    Of those ``inside`` carried parts only the weight counts.
    """
    members = _gather_members(model, at, loads, inner, inside)
    energy, gradient, excess, beams = members.energy, members.gradient, members.excess, members.beams
    start, end = model.spring_ends.T
    own = own_springs(model, at, None if inner is None else inner.spring)
    for total, pull in ((gradient, own.gradient), (excess, own.excess)):
        np.add.at(total[:, :3], end, pull)
        np.add.at(total[:, :3], start, -pull)
    device = device_springs(model, at, loads, None if inner is None else inner.device)
    np.add.at(gradient[:, :3], loads.attach_point, device.gradient)
    np.add.at(excess[:, :3], loads.attach_point, device.excess)
    held = at_attach_points(model, loads, device.material + device.geometric)
    between, ground = own_bushings(model, at, inner), grounded(model, at, loads, inner)
    if inside is not None:
        for part in between:
            part[inside.bushings.rows] = 0.0
    np.add.at(gradient, model.bushing_ends, between.gradient.reshape(-1, 2, 6))
    np.add.at(excess, model.bushing_ends, between.excess.reshape(-1, 2, 6))
    if len(loads.ground.point):
        np.add.at(gradient, loads.ground.point, ground.gradient[:, 6:])
        np.add.at(excess, loads.ground.point, ground.excess[:, 6:])
        held = held + at_poses(model, loads.ground.point, (ground.material + ground.geometric)[:, 6:, 6:])
    energy += np.sum(own.energy) + np.sum(device.energy)
    energy += np.sum(between.energy) + np.sum(ground.energy) + _push(model, at, loads, gradient)
    modal, parts = np.zeros(model.tree.size, gradient.dtype), place_components(model, at, loads)
    for _, part, state, _ in parts:
        grids = 6 * len(part.point)
        energy += state.energy
        np.add.at(gradient, part.point, state.gradient[:grids].reshape(-1, 6))
        modal[6 * model.tree.roots + part.joint] += state.gradient[grids:]
    return _Total(
        energy=energy,
        gradient=gradient,
        excess=excess,
        modal=modal,
        components=parts,
        inner=Inner(
            beam=beams.force,
            spring=own.tension,
            device=device.tension,
            bushing=between.force,
            ground=ground.force,
        ),
        tension=device.tension,
        material={"element": beams.material, "spring": _between(own.material), "bushing": between.material},
        geometric={
            "element": beams.geometric,
            "spring": _between(own.geometric),
            "bushing": between.geometric,
        },
        device=held,
        beams=beams,
        apart=members.apart,
    )


def _gather_members(
    model: Model, at: Placement, loads: Loads, inner: Inner | None, inside: Inside | None
) -> _Members:
    dtype = np.result_type(
        *(at.world, at.poses.R, loads.gravity, model.body_mass, model.beams.stiffness, loads.law.stiffness),
        *(loads.push, loads.ground.stiffness, *(b.stiffness for b in model.structure.bushings)),
    )
    gradient = np.zeros((len(at.world), 6), dtype=np.result_type(dtype, model.beams.length, loads.anchor))
    excess = np.zeros_like(gradient)
    energy = 0.0
    states, apart = [NO_BEAMS], list[BeamState]()
    for rows, untensioned, (x, T, known) in beam_chunks(model, at):
        beams, ends = tensioned_beams(untensioned, loads), model.element_ends[rows]
        strain = beam_state(beams, x, T, None if inner is None else inner.beam[rows], known)
        if inside is not None:
            own = inside.beams.rows
            apart.append(_taken(strain, own[(rows.start <= own) & (own < rows.stop)] - rows.start))
        weight = beam_weight(beams, x, T, loads.gravity)
        gradient[ends] += (strain.gradient + weight.gradient).reshape(-1, 2, 6)
        excess[ends] += strain.excess.reshape(-1, 2, 6)
        energy += np.sum(strain.energy + weight.energy)
        energy -= (beams.rho_A * beams.length) @ (at.world[ends[:, 0]] - x[:, 0]) @ loads.gravity
        states.append(strain._replace(geometric=strain.geometric + weight.hessian))
    energy -= model.body_mass @ (at.world[model.body_point] @ loads.gravity)
    gradient[model.body_point, :3] -= model.body_mass[:, None] * loads.gravity
    every = BeamState(*(np.concatenate(parts) for parts in zip(*states, strict=True)))
    return _Members(energy=energy, gradient=gradient, excess=excess, beams=every, apart=apart)


def _taken(state: BeamState, some: np.ndarray) -> BeamState:
    """The state of ``some`` elements, what they add to sums being zero in ``state`` then."""
    out = BeamState(*(part[some] for part in state))
    for part in (state.energy, state.gradient, state.excess, state.material, state.geometric):
        part[some] = 0.0
    return out


def _between(hessian: np.ndarray) -> np.ndarray:
    """Matrices of the difference of two translations, on both poses."""
    h = on_translations(hessian)
    out = np.empty((len(h), 12, 12), h.dtype)
    out[:, :6, :6] = out[:, 6:, 6:] = h
    out[:, :6, 6:] = out[:, 6:, :6] = -h
    return out


def _push(model: Model, at: Placement, loads: Loads, gradient: np.ndarray) -> float:
    """Energy of dead loads, whose force and moment are added to ``gradient``.

    A moment of fixed direction has no potential, and adds nothing to it.
    """
    if not len(loads.push):
        return 0.0
    np.add.at(gradient, model.load_point, -loads.push)
    return -np.sum(loads.push[:, :3] * moved_since(model, at, model.load_point)[0])
