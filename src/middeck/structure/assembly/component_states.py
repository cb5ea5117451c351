"""Components at their places: states, and the coordinates that move them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import At, moved_since, poses_at
from middeck.structure.elements.component import ComponentElement, ComponentState, component_state
from middeck.structure.elements.frames import Configuration


def component_states(
    model: Model, config: Configuration, loads: Loads
) -> list[tuple[ComponentState, sp.csr_array]]:
    """States of the components, and the rows that take coordinates to those of each."""
    return component_states_at(model, poses_at(model, config), loads)


def component_states_at(model: Model, at: At, loads: Loads) -> list[tuple[ComponentState, sp.csr_array]]:
    """`component_states` at known poses."""
    if not model.components:
        return []
    J = model.pose_map.jacobian(at.poses)
    out: list[tuple[ComponentState, sp.csr_array]] = []
    for part in model.components:
        shift, turn = moved_since(model, at, part.point)
        modal = at.angle[part.joint]
        state = component_state(part, at.world[part.point], shift, turn, modal, loads.gravity)
        out.append((state, component_rows(model, J, part)))
    return out


def component_rows(model: Model, J: sp.csr_array, part: ComponentElement) -> sp.csr_array:
    """Motions of the grids' poses and of the modal coordinates per coordinate."""
    poses = (6 * part.point[:, None] + np.arange(6)).ravel()
    count = len(part.joint)
    unit = (np.ones(count), (np.arange(count), 6 * model.tree.roots + part.joint))
    modal = sp.coo_array(unit, shape=(count, model.tree.size))
    return sp.csr_array(sp.vstack([J[poses], modal]))
