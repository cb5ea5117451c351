"""Total potential energy of a model in an environment: value, gradient, tangent; and the mass matrix.

All of it is analytic in the configuration, the model and the loads: complex ones give derivatives.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact, Int

from middeck.structure.article import JointState
from middeck.structure.elements.beam import beam_state, beam_weight
from middeck.structure.elements.beam_inertia import beam_mass
from middeck.structure.elements.devices import SpringLaw, SpringState, spring_state
from middeck.structure.elements.frames import (
    Configuration,
    Poses,
    frame_poses,
    points_in_world,
    pose_jacobian,
    pose_stiffness,
)
from middeck.structure.mesh import Model, select_beams
from middeck.values import record

# Elements whose derivatives are formed together: their arrays, 10 kB each, should stay in the cache.
CHUNK = 1024


@record
class Loads:
    """What the environment does: gravity [m/s^2], and springs from anchors (in W) to attach points.

    ``mass`` [kg] of each device moves with its attach point along the device only.
    """

    gravity: Inexact[np.ndarray, "3"]
    anchor: Inexact[np.ndarray, "device 3"]
    attach_point: Int[np.ndarray, " device"]
    law: SpringLaw
    mass: Inexact[np.ndarray, " device"]


@record
class Assembly:
    """The potential at one configuration.

    ``gradient`` and ``tangent`` are in the coordinates of the frame tree; ``jacobian`` takes them to poses.
    """

    energy: float
    gradient: Inexact[np.ndarray, " coordinate"]
    tangent: sp.csr_array
    jacobian: sp.csr_array
    tension: Inexact[np.ndarray, " device"]


class Inner(NamedTuple):
    """Forces inside a state: on the six deformations of each beam, and the pull of each own spring."""

    beam: np.ndarray
    spring: np.ndarray
    device: np.ndarray


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
    return Loads(np.zeros(3), np.zeros((0, 3)), none.astype(int), SpringLaw(none, none, none), none)


def assemble(
    model: Model,
    config: Configuration,
    loads: Loads,
    point_load: Inexact[np.ndarray, "pose 6"] | None = None,
) -> Assembly:
    """Energy and two derivatives at ``config``; ``point_load`` is a further energy gradient at the poses."""
    at = _poses_at(model, config)
    total = _gather(model, at, loads, None)
    gradient = total.gradient if point_load is None else total.gradient + point_load
    J = pose_jacobian(model.tree, model.points, at.poses)
    blocks = (*total.material, *total.geometric, *total.device)
    elastic = J.T @ _block_matrix(len(at.world), blocks) @ J
    turning = pose_stiffness(model.tree, model.points, at.poses, gradient)
    joint_energy, joint_gradient, hinges = _sprung_joints(model, config)
    g = J.T @ gradient.ravel() + joint_gradient
    K = _symmetric(_stiffened(sp.csr_array(elastic + turning), hinges))
    return Assembly(total.energy + joint_energy, g, K, J, total.tension)


def energy_gradient(
    model: Model, config: Configuration, loads: Loads, point_load: Inexact[np.ndarray, "pose 6"]
) -> Inexact[np.ndarray, " coordinate"]:
    """The gradient of `assemble` alone."""
    at = _poses_at(model, config)
    gradient = _gather(model, at, loads, None).gradient + point_load
    J = pose_jacobian(model.tree, model.points, at.poses)
    return J.T @ gradient.ravel() + _sprung_joints(model, config)[1]


def split_tangent(model: Model, geometry: Configuration, loads: Loads, inner: Inner) -> TangentParts:
    """The tangent at ``geometry`` under the forces ``inner``, which may be those of another configuration."""
    at = _poses_at(model, geometry)
    total = _gather(model, at, loads, inner)
    J = pose_jacobian(model.tree, model.points, at.poses)

    def assembled(blocks: Iterable[_Blocks]) -> sp.csr_array:
        return sp.csr_array(J.T @ _block_matrix(len(at.world), blocks) @ J)

    turning = pose_stiffness(model.tree, model.points, at.poses, total.gradient)
    hinges = _sprung_joints(model, geometry)[2]
    return TangentParts(
        _symmetric(_stiffened(assembled(total.material), hinges)),
        _symmetric(sp.csr_array(assembled(total.geometric) + turning)),
        _symmetric(assembled(total.device)),
    )


def device_tension(model: Model, config: Configuration, loads: Loads) -> Inexact[np.ndarray, " device"]:
    """The pull of each device at ``config``."""
    world = points_in_world(model.points, frame_poses(model.tree, config))
    return spring_state(loads.law, world[loads.attach_point] - loads.anchor).tension


def inner_forces(model: Model, config: Configuration, loads: Loads) -> Inner:
    """The forces at ``config``."""
    return _gather(model, _poses_at(model, config), loads, None).inner


def mass_matrix(model: Model, config: Configuration, loads: Loads | None = None) -> sp.csr_array:
    """Consistent mass of beams, bodies and, with ``loads``, devices in the coordinates of the frame tree."""
    at = _poses_at(model, config)
    blocks: list[_Blocks] = []
    for rows in _chunks(len(model.element_ends)):
        x, T = _element_poses(model, at, rows)
        blocks.append(_Blocks(model.element_ends[rows], beam_mass(select_beams(model.beams, rows), x, T)))
    R = at.poses.R[model.points.frame[model.body_point]]
    body = np.zeros((len(model.body_point), 6, 6), dtype=np.result_type(R, model.body_inertia))
    body[:, :3, :3] = model.body_mass[:, None, None] * np.eye(3)
    body[:, 3:, 3:] = R @ model.body_inertia @ np.swapaxes(R, 1, 2)
    blocks.append(_Blocks(model.body_point[:, None], body))
    if loads is not None and np.any(loads.mass):
        span = at.world[loads.attach_point] - loads.anchor
        along = span / np.sqrt(np.einsum("di,di->d", span, span))[:, None]
        moving = loads.mass[:, None, None] * along[:, :, None] * along[:, None, :]
        blocks.append(_Blocks(loads.attach_point[:, None], _translations(moving)))
    J = pose_jacobian(model.tree, model.points, at.poses)
    return _symmetric(sp.csr_array(J.T @ _block_matrix(len(at.world), blocks) @ J))


def element_poses(model: Model, config: Configuration) -> tuple[np.ndarray, np.ndarray]:
    """End positions (element, 2, 3) and triads (element, 2, 3, 3) of all beam elements."""
    return _element_poses(model, _poses_at(model, config), slice(None))


class _At(NamedTuple):
    poses: Poses
    world: np.ndarray


class _Blocks(NamedTuple):
    """Matrices of elements, and the poses that each of them joins."""

    ends: np.ndarray
    matrices: np.ndarray


class _Total(NamedTuple):
    """Sums over all elements, at the poses."""

    energy: float
    gradient: np.ndarray
    inner: Inner
    tension: np.ndarray
    material: list[_Blocks]
    geometric: list[_Blocks]
    device: list[_Blocks]


def _poses_at(model: Model, config: Configuration) -> _At:
    poses = frame_poses(model.tree, config)
    return _At(poses, points_in_world(model.points, poses))


def _gather(model: Model, at: _At, loads: Loads, inner: Inner | None) -> _Total:
    """All elements at their poses; ``inner`` takes the place of the forces inside them."""
    dtype = np.result_type(
        at.world, at.poses.R, loads.gravity, model.body_mass, model.beams.EA, loads.law.stiffness
    )
    gradient = np.zeros((len(at.world), 6), dtype=np.result_type(dtype, model.beams.length, loads.anchor))
    material: list[_Blocks] = []
    geometric: list[_Blocks] = []
    energy = 0.0
    forces: list[np.ndarray] = [np.zeros((0, 6))]
    for rows in _chunks(len(model.element_ends)):
        x, T = _element_poses(model, at, rows)
        beams, ends = select_beams(model.beams, rows), model.element_ends[rows]
        strain = beam_state(beams, x, T, None if inner is None else inner.beam[rows])
        weight = beam_weight(beams, x, T, loads.gravity)
        gradient[ends] += (strain.gradient + weight.gradient).reshape(-1, 2, 6)
        energy += np.sum(strain.energy + weight.energy)
        forces.append(strain.force)
        material.append(_Blocks(ends, strain.material))
        geometric.append(_Blocks(ends, strain.geometric + weight.hessian))
    energy -= model.body_mass @ (at.world[model.body_point] @ loads.gravity)
    gradient[model.body_point, :3] -= model.body_mass[:, None] * loads.gravity
    own = _own_springs(model, at, gradient, None if inner is None else inner.spring, material, geometric)
    device = spring_state(
        loads.law, at.world[loads.attach_point] - loads.anchor, None if inner is None else inner.device
    )
    np.add.at(gradient[:, :3], loads.attach_point, device.gradient)
    held = _Blocks(loads.attach_point[:, None], _translations(device.material + device.geometric))
    energy += np.sum(own.energy) + np.sum(device.energy)
    inside = Inner(np.concatenate(forces), own.tension, device.tension)
    return _Total(energy, gradient, inside, device.tension, material, geometric, [held])


def _own_springs(
    model: Model,
    at: _At,
    gradient: np.ndarray,
    tension: np.ndarray | None,
    material: list[_Blocks],
    geometric: list[_Blocks],
) -> SpringState:
    """The structure's own springs; adds to ``gradient`` and to both lists."""
    own = model.structure.springs
    law = SpringLaw(
        np.zeros(len(own)), np.array([s.stiffness for s in own]), np.array([s.free_length for s in own])
    )
    start, end = model.spring_ends.T
    state = spring_state(law, at.world[end] - at.world[start], tension)
    np.add.at(gradient[:, :3], end, state.gradient)
    np.add.at(gradient[:, :3], start, -state.gradient)
    for blocks, hessian in ((material, state.material), (geometric, state.geometric)):
        h = _translations(hessian)
        blocks.append(_Blocks(model.spring_ends, np.block([[h, -h], [-h, h]])))
    return state


def _chunks(count: int) -> Iterable[slice]:
    return (slice(start, start + CHUNK) for start in range(0, count, CHUNK))


def _element_poses(model: Model, at: _At, rows: slice) -> tuple[np.ndarray, np.ndarray]:
    ends = model.element_ends[rows]
    R = at.poses.R[model.points.frame[ends]]
    return at.world[ends], R @ model.element_triad[rows, None]


def _translations(hessian: np.ndarray) -> np.ndarray:
    out = np.zeros((len(hessian), 6, 6), dtype=hessian.dtype)
    out[:, :3, :3] = hessian
    return out


def _block_matrix(poses: int, blocks: Iterable[_Blocks]) -> sp.csr_array:
    """Sum of element matrices over the poses."""
    rows: list[np.ndarray] = [np.zeros(0, np.int32)]
    columns: list[np.ndarray] = [np.zeros(0, np.int32)]
    values: list[np.ndarray] = [np.zeros(0)]
    for ends, matrices in blocks:
        index = (6 * ends[:, :, None] + np.arange(6)).reshape(len(ends), 6 * ends.shape[1]).astype(np.int32)
        at = np.flatnonzero(matrices)
        element, row, column = np.unravel_index(at, matrices.shape)
        rows.append(index[element, row])
        columns.append(index[element, column])
        values.append(matrices.ravel()[at])
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(sp.coo_array(entries, shape=(6 * poses, 6 * poses)))


def _symmetric(K: sp.csr_array) -> sp.csr_array:
    """Symmetric by construction; the mean removes the rounding."""
    return sp.csr_array(0.5 * (K + K.T))


def _sprung_joints(model: Model, config: Configuration) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy, gradient and the tangent's diagonal."""
    joints, none = model.structure.joints, np.zeros(6 * model.tree.roots)
    k = np.array([j.stiffness if j.state is JointState.SPRUNG else 0.0 for j in joints]) + 0.0
    turn = config.angle - np.array([j.target for j in joints])
    return 0.5 * np.sum(k * turn**2), np.concatenate([none, k * turn]), np.concatenate([none, k])


def _stiffened(K: sp.csr_array, diagonal: np.ndarray) -> sp.csr_array:
    return sp.csr_array(K + sp.diags_array(diagonal)) if np.any(diagonal) else K
