"""Total potential energy of a model in an environment: value, gradient, tangent; and the mass matrix."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.structure.article import JointState
from middeck.structure.beam import beam_mass, beam_state, beam_weight
from middeck.structure.devices import SpringLaw, spring_state
from middeck.structure.frames import (
    Configuration,
    Poses,
    frame_poses,
    points_in_world,
    pose_jacobian,
    pose_stiffness,
)
from middeck.structure.mesh import Model
from middeck.values import record


@record
class Loads:
    """What the environment does: gravity [m/s^2], and springs from anchors (in W) to attach points."""

    gravity: Float[np.ndarray, "3"]
    anchor: Float[np.ndarray, "device 3"]
    attach_point: Int[np.ndarray, " device"]
    law: SpringLaw


@record
class Assembly:
    """The potential at one configuration.

    ``gradient`` and ``tangent`` are in the coordinates of the frame tree; ``jacobian`` takes them to poses.
    """

    energy: float
    gradient: Float[np.ndarray, " coordinate"]
    tangent: sp.csr_array
    jacobian: sp.csr_array
    tension: Float[np.ndarray, " device"]


def no_loads() -> Loads:
    """Orbit: no gravity, no devices."""
    none = np.zeros(0)
    return Loads(np.zeros(3), np.zeros((0, 3)), none.astype(int), SpringLaw(none, none, none))


def assemble(
    model: Model,
    config: Configuration,
    loads: Loads,
    point_load: Float[np.ndarray, "pose 6"] | None = None,
) -> Assembly:
    """Energy and two derivatives at ``config``; ``point_load`` is a further energy gradient at the poses."""
    poses = frame_poses(model.tree, config)
    world = points_in_world(model.points, poses)
    gradient = np.zeros((len(world), 6)) if point_load is None else np.array(point_load)
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    energy = _beams(model, poses, world, loads, gradient, blocks)
    energy -= float(model.body_mass @ (world[model.body_point] @ loads.gravity))
    gradient[model.body_point, :3] -= model.body_mass[:, None] * loads.gravity
    tension, more = _springs(model, world, loads, gradient, blocks)
    J = pose_jacobian(model.tree, model.points, poses)
    elastic = J.T @ _block_matrix(len(world), blocks) @ J
    turning = pose_stiffness(model.tree, model.points, poses, gradient)
    joint_energy, joint_gradient, joint_stiffness = _sprung_joints(model, config)
    g = J.T @ gradient.ravel()
    g[6 * model.tree.roots :] += joint_gradient
    hinges = sp.diags_array(np.concatenate([np.zeros(6 * model.tree.roots), joint_stiffness]))
    K = elastic + turning + hinges
    # Symmetric by construction; the mean removes the rounding.
    return Assembly(energy + more + joint_energy, g, sp.csr_array(0.5 * (K + K.T)), J, tension)


def mass_matrix(model: Model, config: Configuration) -> sp.csr_array:
    """Consistent mass of beams and bodies in the coordinates of the frame tree."""
    poses = frame_poses(model.tree, config)
    world = points_in_world(model.points, poses)
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    if len(model.element_ends):
        x, T = _element_poses(model, poses, world)
        blocks.append((model.element_ends, beam_mass(model.beams, x, T)))
    R = poses.R[model.points.frame[model.body_point]]
    body = np.zeros((len(model.body_point), 6, 6))
    body[:, :3, :3] = model.body_mass[:, None, None] * np.eye(3)
    body[:, 3:, 3:] = R @ model.body_inertia @ np.swapaxes(R, 1, 2)
    blocks.append((model.body_point[:, None], body))
    J = pose_jacobian(model.tree, model.points, poses)
    M = J.T @ _block_matrix(len(world), blocks) @ J
    return sp.csr_array(0.5 * (M + M.T))


def _element_poses(model: Model, poses: Poses, world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    R = poses.R[model.points.frame[model.element_ends]]
    return world[model.element_ends], R @ model.element_triad[:, None]


def element_poses(model: Model, config: Configuration) -> tuple[np.ndarray, np.ndarray]:
    """End positions (element, 2, 3) and triads (element, 2, 3, 3) of all beam elements."""
    poses = frame_poses(model.tree, config)
    return _element_poses(model, poses, points_in_world(model.points, poses))


def _beams(
    model: Model,
    poses: Poses,
    world: np.ndarray,
    loads: Loads,
    gradient: np.ndarray,
    blocks: list[tuple[np.ndarray, np.ndarray]],
) -> float:
    if not len(model.element_ends):
        return 0.0
    x, T = _element_poses(model, poses, world)
    strain, weight = beam_state(model.beams, x, T), beam_weight(model.beams, x, T, loads.gravity)
    np.add.at(gradient, model.element_ends, (strain.gradient + weight.gradient).reshape(-1, 2, 6))
    blocks.append((model.element_ends, strain.hessian + weight.hessian))
    return float(np.sum(strain.energy + weight.energy))


def _springs(
    model: Model,
    world: np.ndarray,
    loads: Loads,
    gradient: np.ndarray,
    blocks: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, float]:
    """Anchored devices, then the structure's own springs; returns device tensions and the energy."""
    energy = 0.0
    tension = np.zeros(0)
    if len(loads.attach_point):
        state = spring_state(loads.law, world[loads.attach_point] - loads.anchor)
        np.add.at(gradient[:, :3], loads.attach_point, state.gradient)
        blocks.append((loads.attach_point[:, None], _translations(state.hessian)))
        energy, tension = float(np.sum(state.energy)), state.tension
    if len(model.spring_ends):
        own = model.structure.springs
        law = SpringLaw(
            np.zeros(len(own)),
            np.array([s.stiffness for s in own]),
            np.array([s.free_length for s in own]),
        )
        start, end = model.spring_ends.T
        state = spring_state(law, world[end] - world[start])
        np.add.at(gradient[:, :3], end, state.gradient)
        np.add.at(gradient[:, :3], start, -state.gradient)
        h = _translations(state.hessian)
        blocks.append((model.spring_ends, np.block([[h, -h], [-h, h]])))
        energy += float(np.sum(state.energy))
    return tension, energy


def _translations(hessian: np.ndarray) -> np.ndarray:
    out = np.zeros((len(hessian), 6, 6))
    out[:, :3, :3] = hessian
    return out


def _block_matrix(poses: int, blocks: list[tuple[np.ndarray, np.ndarray]]) -> sp.csr_array:
    """Sum of element matrices; each entry of ``blocks`` is (poses of each element, their matrices)."""
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    for ends, matrices in blocks:
        index = (6 * ends[:, :, None] + np.arange(6)).reshape(len(ends), 6 * ends.shape[1])
        rows.append(np.broadcast_to(index[:, :, None], matrices.shape).ravel())
        columns.append(np.broadcast_to(index[:, None, :], matrices.shape).ravel())
        values.append(matrices.ravel())
    if not values:
        return sp.csr_array((6 * poses, 6 * poses))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(sp.coo_array(entries, shape=(6 * poses, 6 * poses)))


def _sprung_joints(model: Model, config: Configuration) -> tuple[float, np.ndarray, np.ndarray]:
    joints = model.structure.joints
    k = np.array([j.stiffness if j.state is JointState.SPRUNG else 0.0 for j in joints])
    turn = config.angle - np.array([j.target for j in joints])
    return float(0.5 * np.sum(k * turn**2)), k * turn, k
