"""Elastic energy of a mode by parts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Inexact

from middeck.structure.assembly.beam_ends import element_poses
from middeck.structure.assembly.springs import bushing_states
from middeck.structure.elements.beam import beam_deformations
from middeck.structure.elements.beam_deformations import PHI, STRETCH, Y1, Y2, Z1, Z2
from middeck.structure.elements.frames import points_in_world
from middeck.structure.elements.springs_and_cables import spring_state
from middeck.structure.model.article import JointState
from middeck.structure.rest.equilibrium import Equilibrium

PARTS = (
    "axial",
    "torsion",
    "bending y-z",
    "bending x-z",
    "bending x-y",
    "spring",
    "joint",
    "slide",
    "bushing",
    "component",
)
BENDING = slice(2, 5)
CHUNK = 128


def strain_energy(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode part"]:
    """Elastic energy [J] of each mode in `PARTS`, without the work of preloads (the geometric stiffness).

    Bending about an own axis of a member counts for the plane across the world axis nearest to it. Analytic.
    """
    changes = equilibrium.moves(shapes)
    bent = _member_energy(equilibrium, changes)
    springs, joints, bushings, components = _tie_energies(equilibrium, shapes, changes)
    slides = equilibrium.model.tree.slides
    ties = (springs, joints[:, ~slides], joints[:, slides], bushings, components)
    return np.column_stack([bent, *(tie.sum(axis=1) for tie in ties)])


def part_energy(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode part"]:
    """Elastic energy [J] by member, spring, joint, bushing and component, in the order of the structure."""
    changes = equilibrium.moves(shapes)
    ties = _tie_energies(equilibrium, shapes, changes)
    return np.hstack([_each_member(equilibrium, changes), *ties])


def _tie_energies(
    equilibrium: Equilibrium, shapes: np.ndarray, changes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Energy (mode, item) of each spring, of each joint, of each bushing and of each component."""
    model = equilibrium.model
    joints = model.structure.joints
    k = np.array([s.stiffness for s in model.structure.springs]) + 0.0
    of_joints = np.array([j.stiffness if j.state is JointState.SPRUNG else 0.0 for j in joints]) + 0.0
    world = points_in_world(model.points, equilibrium.poses)
    start, end = model.spring_ends.T
    span = world[end] - world[start]
    length = np.sqrt(np.sum(span * span, axis=1))
    along = span / np.where(length == 0.0, 1.0, length)[:, None]
    apart = changes[end, :3] - changes[start, :3]
    stretch = np.einsum("si,sim->sm", along, apart) ** 2
    stretch[length == 0.0] = np.sum(apart[length == 0.0] ** 2, axis=1)  # the same in all directions
    between, _ = bushing_states(model, equilibrium.config, equilibrium.loads)
    ends = changes[model.bushing_ends].reshape(len(model.bushing_ends), 12, shapes.shape[1])
    parts = [0.5 * np.diagonal(c.state.squares(c.rows @ shapes)) for c in equilibrium.components]
    return (
        0.5 * (k[:, None] * stretch).T,
        0.5 * (of_joints[:, None] * shapes[6 * model.tree.roots :] ** 2).T,
        0.5 * np.einsum("bim,bij,bjm->mb", ends, between.material, ends),
        np.array(parts).reshape(len(parts), shapes.shape[1]).T,
    )


def strain_share(
    equilibrium: Equilibrium,
    lam: Inexact[np.ndarray, " mode"],
    shapes: Inexact[np.ndarray, "coordinate mode"],
) -> Inexact[np.ndarray, " mode"]:
    """Part of the restoring energy of mass-normalised modes of omega^2 = ``lam`` that is strain; analytic.

    What else restores is the devices and, where it is positive, the work of weight and preload: energy that
    compression takes away restores nothing, so that shares lie between 0 and 1 whatever its size. Zero at
    lam = 0, where there is nothing to share.
    """
    elastic = strain_energy(equilibrium, shapes).sum(axis=1)
    device = _positive(device_energy(equilibrium, shapes))
    whole = elastic + device + _positive(0.5 * lam - elastic - device)
    real = (np.real(whole) > 0.0) & (np.real(lam) != 0.0)
    return np.divide(elastic, whole, out=np.zeros_like(whole), where=real)


def _positive(x: np.ndarray) -> np.ndarray:
    return np.where(np.real(x) > 0.0, x, 0.0)


def lossy_shares(
    equilibrium: Equilibrium,
    lam: Inexact[np.ndarray, " mode"],
    shapes: Inexact[np.ndarray, "coordinate mode"],
) -> Inexact[np.ndarray, "2 mode"]:
    """Shares of strain, and of all else that holds the article, in the energy omega^2 / 2; analytic.

    What else holds is the strain of devices and, where it is positive, the work of weight and preload. Energy
    that weight or preload takes away has no loss, and takes none from what strains: the sum is then above
    one, without bound as omega goes to zero. Zero at lam = 0, as in `strain_share`.
    """
    elastic = strain_energy(equilibrium, shapes).sum(axis=1)
    device = device_strain(equilibrium, shapes)
    parts = np.array([elastic, device + _positive(0.5 * lam - elastic - device)])
    swings = np.broadcast_to(np.real(lam) > 0.0, parts.shape)
    return np.divide(parts, 0.5 * lam, out=np.zeros_like(parts), where=swings)


def device_energy(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, " mode"]:
    """Energy [J] of each mode in devices, springs and bushings to the ground; analytic."""
    return _device_energies(equilibrium, shapes).sum(axis=0)


def device_strain(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, " mode"]:
    """The part of `device_energy` that is elastic, without the work of their pull; analytic."""
    return _device_energies(equilibrium, shapes)[0]


def _device_energies(equilibrium: Equilibrium, shapes: np.ndarray) -> Inexact[np.ndarray, "2 mode"]:
    """Energy [J] in devices, springs and bushings to the ground by their strain, then by their pull."""
    model, loads = equilibrium.model, equilibrium.loads
    places, moves = points_in_world(model.points, equilibrium.poses), equilibrium.moves(shapes)
    state = spring_state(loads.law, places[loads.attach_point] - loads.anchor)
    moved = moves[loads.attach_point, :3]
    energy = 0.5 * np.einsum("dim,kdij,djm->km", moved, np.array([state.material, state.geometric]), moved)
    if not len(loads.ground.point):
        return energy
    ground = bushing_states(model, equilibrium.config, loads)[1]
    K = np.array([ground.material, ground.geometric])[:, :, 6:, 6:]
    moved = moves[loads.ground.point]
    return energy + 0.5 * np.einsum("bim,kbij,bjm->km", moved, K, moved)


def member_energy(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode member"]:
    """Elastic energy [J] of each mode in each member of the structure, in its order; analytic."""
    return _each_member(equilibrium, equilibrium.moves(shapes))


def member_deformations(
    equilibrium: Equilibrium, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "element 6 mode"]:
    """(stretch, y1, z1, y2, z2, twist) of each beam element in each mode."""
    model, changes = equilibrium.model, equilibrium.moves(shapes)
    _, slope = beam_deformations(model.beams, *element_poses(model, equilibrium.config))
    return slope @ changes[model.element_ends].reshape(len(slope), 12, shapes.shape[1])


def _each_member(equilibrium: Equilibrium, changes: np.ndarray) -> np.ndarray:
    model = equilibrium.model
    energy = np.zeros((len(model.structure.members), changes.shape[2]), changes.dtype)
    for rows, density in _element_energies(equilibrium, changes):
        np.add.at(energy, model.element_member[rows], density.sum(axis=1))
    return energy.T


def _element_energies(equilibrium: Equilibrium, changes: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Elements by the hundred, whose arrays stay in the cache, and the energy of each of their deformations.

    That is (element, 6, mode); ``changes`` are those of all poses.
    """
    model = equilibrium.model
    x, T = element_poses(model, equilibrium.config)
    _, slope = beam_deformations(model.beams, x, T)
    for start in range(0, len(x), CHUNK):
        rows = slice(start, start + CHUNK)
        ends = changes[model.element_ends[rows]].reshape(len(slope[rows]), 12, changes.shape[2])
        deformation = slope[rows] @ ends
        yield rows, 0.5 * deformation * (model.beams.stiffness[rows] @ deformation)


def _member_energy(equilibrium: Equilibrium, changes: np.ndarray) -> Inexact[np.ndarray, "mode 5"]:
    model = equilibrium.model
    axes = [np.argmax(np.abs(model.element_triad[:, :, own]), axis=1) for own in (1, 2)]
    energy = np.zeros((changes.shape[2], 5), np.result_type(changes, model.beams.stiffness))
    for rows, density in _element_energies(equilibrium, changes):
        energy[:, 0] += density[:, STRETCH].sum(axis=0)
        energy[:, 1] += density[:, PHI].sum(axis=0)
        for axis, bent in zip(axes, ([Y1, Y2], [Z1, Z2]), strict=True):
            np.add.at(energy[:, BENDING].T, axis[rows], density[:, bent].sum(axis=1))
    return energy
