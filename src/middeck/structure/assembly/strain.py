"""Strain of a model by motions of its coordinates, to first order."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Inexact

from middeck.structure.assembly.beam_ends import (
    beam_chunks,
    carried_levers,
    tensioned_beams,
)
from middeck.structure.assembly.component_states import place_components
from middeck.structure.assembly.energy import Assembly
from middeck.structure.assembly.environment_loads import Inner, Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import Placement, poses_at, transport
from middeck.structure.assembly.springs import (
    device_span,
    grounded,
    on_ground,
    own_bushings,
    own_law,
    own_span,
    sprung_joints,
)
from middeck.structure.elements.beam import beam_deformations, tensioned
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.springs_and_cables import predicted_tension, spring_squares


def strain_energies(
    model: Model, config: Configuration, loads: Loads, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode mode"]:
    """The tangent at rest, applied to ``shapes`` in carried coordinates: a sum of squared strains.

    Nothing cancels but within a strain, so that it rounds by the square of the rounding of the shapes.
    """
    at = poses_at(model, config)
    jacobian = model.pose_map.jacobian(at.poses) @ transport(config, model.tree)
    motion, ends, tied = _motions(model, at, jacobian, shapes)
    out = np.zeros((shapes.shape[1], shapes.shape[1]))
    for rows, beams, place in beam_chunks(model, at):
        strain = beam_deformations(beams, *place)[1] @ ends[rows]
        out += np.einsum("eim,ein->mn", strain, beams.stiffness @ strain)
    start, end = model.spring_ends.T
    stretched = own_span(model, at)
    hung = device_span(model, at, loads)
    out += spring_squares(own_law(model), *stretched, motion[end, :3] - motion[start, :3], along_only=True)
    out += spring_squares(loads.law, *hung, motion[loads.attach_point, :3])
    out += own_bushings(model, at, inside=True).squares(tied)
    out += grounded(model, at, loads).squares(on_ground(motion[loads.ground.point]))
    for _, _, state, rows in place_components(model, at, loads):
        out += state.squares(rows @ (transport(config, model.tree) @ shapes))
    hinges = sprung_joints(model, config)[2]
    return out + shapes.T @ (hinges[:, None] * shapes)


def member_strains(
    model: Model, config: Configuration
) -> tuple[Inexact[np.ndarray, "element 6"], Inexact[np.ndarray, "element 6 6"]]:
    """(stretch, y1, z1, y2, z2, twist) of each beam element, and its stiffness on them."""
    at = poses_at(model, config)
    strain = [beam_deformations(beams, *place)[0] for _, beams, place in beam_chunks(model, at)]
    return np.concatenate([np.zeros((0, 6)), *strain]), model.beams.stiffness


def strain_pull(
    model: Model, config: Configuration, strain: Inexact[np.ndarray, "element 6 field"]
) -> Inexact[np.ndarray, "coordinate field"]:
    """The load, in the coordinates of the frame tree, for additional strains of the elements, a column a
    field."""
    at = poses_at(model, config)
    poses = np.zeros((len(at.world), 6, strain.shape[2]))
    for rows, beams, place in beam_chunks(model, at):
        slope = beam_deformations(beams, *place)[1]
        force = np.swapaxes(slope, 1, 2) @ (beams.stiffness @ strain[rows])
        np.add.at(poses, model.element_ends[rows], force.reshape(len(force), 2, 6, -1))
    return model.pose_map.jacobian(at.poses).T @ poses.reshape(-1, strain.shape[2])


def predict_forces(
    model: Model, config: Configuration, loads: Loads, q: Inexact[np.ndarray, " coordinate"], before: Assembly
) -> Inner:
    """Forces after a step ``q`` in carried coordinates from ``config``, of the assembly ``before``.

    To first order.
    """
    at = poses_at(model, config)
    motion, ends, tied = (m[..., 0] for m in _motions(model, at, before.jacobian, q[:, None]))
    strain = before.strain + np.matvec(before.slope, ends)
    beams = tensioned_beams(model.beams, loads)
    force = tensioned(beams, np.matvec(beams.stiffness, strain))
    start, end = model.spring_ends.T
    own = predicted_tension(own_law(model), *own_span(model, at), motion[end, :3] - motion[start, :3])
    device = predicted_tension(loads.law, *device_span(model, at, loads), motion[loads.attach_point, :3])
    between = own_bushings(model, at, inside=True).predicted(tied)
    ground = grounded(model, at, loads).predicted(on_ground(motion[loads.ground.point]))
    return Inner(beam=force, spring=own, device=device, bushing=between, ground=ground)


def _motions(
    model: Model, at: Placement, jacobian: sp.csr_array, shapes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motions (pose, 6, mode), and (.., 12, mode) of the ends of beams and bushings that carriers see.

    ``jacobian`` takes carried coordinates to poses.
    """
    count = shapes.shape[1]
    motion = (jacobian @ shapes).reshape(len(at.world), 6, count)
    ends = motion[model.element_ends].reshape(len(model.element_ends), 12, count)
    tied = motion[model.bushing_ends].reshape(len(model.bushing_ends), 12, count)
    for moved, poses, part in (
        (ends, model.element_ends, model.inside.beams),
        (tied, model.bushing_ends, model.inside.bushings),
    ):
        if len(part.rows) and at.since is not None:
            levers = carried_levers(at, poses, part)
            moved[part.rows] = sum(link.motion @ shapes[np.maximum(link.coordinates, 0)] for link in levers)
    return motion, ends, tied
