"""Where a mode keeps its elastic energy."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Inexact

from middeck.structure.article import JointState
from middeck.structure.assembly import element_poses
from middeck.structure.elements.beam import beam_deformations, beam_stiffness
from middeck.structure.elements.beam_kinematics import PHI, STRETCH, Y1, Y2, Z1, Z2
from middeck.structure.elements.frames import frame_poses, points_in_world, pose_jacobian
from middeck.structure.equilibrium import Equilibrium

PARTS = ("axial", "torsion", "bending y-z", "bending x-z", "bending x-y", "spring", "joint", "slide")
BENDING = slice(2, 5)


def strain_energy(
    equilibrium: Equilibrium, shapes: Float[np.ndarray, "coordinate mode"]
) -> Float[np.ndarray, "mode part"]:
    """Elastic energy [J] of each mode in `PARTS`, without the work of preloads (the geometric stiffness).

    Bending about an own axis of a member counts for the plane across the world axis nearest to it.
    """
    model = equilibrium.model
    poses = frame_poses(model.tree, equilibrium.config)
    changes = pose_jacobian(model.tree, model.points, poses) @ shapes
    changes = changes.reshape(-1, 6, shapes.shape[1])
    energy = np.zeros((shapes.shape[1], len(PARTS)))
    if len(model.element_ends):
        energy[:, :5] = _member_energy(equilibrium, changes)
    if len(model.spring_ends):
        start, end = model.spring_ends.T
        world = points_in_world(model.points, poses)
        span = world[end] - world[start]
        length = np.linalg.norm(span, axis=1)
        along = span / np.where(length > 0.0, length, 1.0)[:, None]
        apart = changes[end, :3] - changes[start, :3]
        stretch = np.einsum("si,sim->sm", along, apart) ** 2
        stretch[length == 0.0] = np.sum(apart[length == 0.0] ** 2, axis=1)  # the same in all directions
        energy[:, 5] = 0.5 * np.array([s.stiffness for s in model.structure.springs]) @ stretch
    joints = model.structure.joints
    stiffness = np.array([j.stiffness if j.state is JointState.SPRUNG else 0.0 for j in joints])
    moves = shapes[6 * model.tree.roots :] ** 2
    for part, of_it in ((6, ~model.tree.slides), (7, model.tree.slides)):
        energy[:, part] = 0.5 * stiffness[of_it] @ moves[of_it]
    return energy


def member_energy(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode member"]:
    """Elastic energy [J] of each mode in each member of the structure, in its order; analytic."""
    model = equilibrium.model
    poses = frame_poses(model.tree, equilibrium.config)
    changes = pose_jacobian(model.tree, model.points, poses) @ shapes
    energy = np.zeros((len(model.structure.members), shapes.shape[1]), changes.dtype)
    if len(model.element_ends):
        density = _element_energy(equilibrium, changes.reshape(-1, 6, shapes.shape[1]))
        np.add.at(energy, model.element_member, density.sum(axis=1))
    return energy.T


def _element_energy(equilibrium: Equilibrium, changes: np.ndarray) -> Float[np.ndarray, "element 6 mode"]:
    """By deformation of the element; changes are those of all poses."""
    model = equilibrium.model
    x, T = element_poses(model, equilibrium.config)
    _, slope = beam_deformations(model.beams, x, T)
    ends = changes[model.element_ends].reshape(len(x), 12, -1)
    deformation = np.einsum("eia,eam->eim", slope, ends)
    return 0.5 * deformation * np.einsum("eij,ejm->eim", beam_stiffness(model.beams), deformation)


def _member_energy(equilibrium: Equilibrium, changes: np.ndarray) -> Float[np.ndarray, "mode 5"]:
    model = equilibrium.model
    density = _element_energy(equilibrium, changes)
    energy = np.zeros((changes.shape[2], 5))
    energy[:, 0], energy[:, 1] = density[:, STRETCH].sum(axis=0), density[:, PHI].sum(axis=0)
    for own, rows in ((1, [Y1, Y2]), (2, [Z1, Z2])):
        axis = np.argmax(np.abs(model.element_triad[:, :, own]), axis=1)
        bending = density[:, rows].sum(axis=1)
        np.add.at(energy[:, BENDING].T, axis, bending)
    return energy
