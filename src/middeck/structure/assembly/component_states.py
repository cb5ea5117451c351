"""Components at their places: states, and the coordinates that move them."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import Placement, moved_since
from middeck.structure.elements.component_element import ComponentElement, ComponentState, component_state
from middeck.structure.model.component import Component


class PlacedComponent(NamedTuple):
    """A component as given and as laid out, its state, and the rows from all coordinates to its own."""

    part: Component
    element: ComponentElement
    state: ComponentState
    rows: sp.csr_array


def place_components(model: Model, at: Placement, loads: Loads) -> list[PlacedComponent]:
    """The components at their places in the model."""
    if not model.components:
        return []
    J = model.pose_map.jacobian(at.poses)
    out: list[PlacedComponent] = []
    for part, element in zip(model.structure.components, model.components, strict=True):
        moved, modal = moved_since(model, at, element.point), at.angle[element.joint]
        state = component_state(element, at.world[element.point], *moved, modal, loads.gravity)
        out.append(PlacedComponent(part, element, state, component_rows(model, J, element)))
    return out


def component_rows(model: Model, J: sp.csr_array, part: ComponentElement) -> sp.csr_array:
    """Motions of the grids' poses and of the modal coordinates per coordinate."""
    poses = (6 * part.point[:, None] + np.arange(6)).ravel()
    count = len(part.joint)
    unit = (np.ones(count), (np.arange(count), 6 * model.tree.roots + part.joint))
    modal = sp.coo_array(unit, shape=(count, model.tree.size))
    return sp.csr_array(sp.vstack([J[poses], modal]))
