"""The mass matrix of a model in a configuration."""

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.beam_ends import beam_chunks
from middeck.structure.assembly.component_states import component_rows
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import moved_since, poses_at, symmetric, transport
from middeck.structure.assembly.springs import at_attach_points
from middeck.structure.elements.beam_inertia import beam_mass
from middeck.structure.elements.component_element import component_mass
from middeck.structure.elements.frames import Configuration


def mass_matrix(model: Model, config: Configuration, loads: Loads | None = None) -> sp.csr_array:
    """Consistent mass of beams, bodies and, with ``loads``, devices in the coordinates of the frame tree."""
    at = poses_at(model, config)
    elements = [np.zeros((0, 12, 12)), *(beam_mass(c.beams, *c.ends[:2]) for c in beam_chunks(model, at))]
    R = at.poses.R[model.points.frame[model.body_point]]
    body = np.zeros((len(model.body_point), 6, 6), dtype=np.result_type(R, model.body_inertia))
    body[:, :3, :3] = model.body_mass[:, None, None] * np.eye(3)
    body[:, 3:, 3:] = R @ model.body_inertia @ np.swapaxes(R, 1, 2)
    blocks = {"element": np.concatenate(elements), "body": body}
    if loads is not None and np.any(loads.mass):
        span = at.world[loads.attach_point] - loads.anchor
        along = span / np.sqrt(np.einsum("di,di->d", span, span))[:, None]
        moving = loads.mass[:, None, None] * along[:, :, None] * along[:, None, :]
        blocks["attach"] = at_attach_points(model, loads, moving)
    mass = model.pattern.matrix(model.pose_map.jacobian_values(at.poses), blocks)
    for part in model.components:
        rows = component_rows(model, model.pose_map.jacobian(at.poses), part)
        own = component_mass(part, *moved_since(model, at, part.point))
        mass = symmetric(sp.csr_array(mass + rows.T @ own @ rows))
    return mass


def carried_mass(model: Model, config: Configuration, loads: Loads | None = None) -> sp.csr_array:
    """`mass_matrix` in carried coordinates."""
    M, since = mass_matrix(model, config, loads), config.since_drawn
    if since is None or not since.carries:
        return M
    T = transport(config, model.tree)
    return symmetric(sp.csr_array(T.T @ M @ T))


def drawn_mass(model: Model) -> sp.csr_array:
    """`carried_mass` as drawn, without devices; found once."""
    return model.rest.once("mass", model, lambda: carried_mass(model, model.rest))
