"""What a model leaves out that more elements and shear would bring in, to first order.

A model that is drawn without shear errs by one sign, most in the highest modes, and all its modes err
together. Members of a shear flexibility F yield under the shear forces V of the modes: phi_i'dK phi_j = - sum
of L V_i'F V_j over the elements, by their flexibilities, since forces hardly change where one element gives
way and its neighbours do not hold it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.elements.beam import beam_properties
from middeck.structure.model.finer import TUBE_SHEAR, refine_mesh
from middeck.structure.modes.doubts.mesh_error import estimate_mesh_error
from middeck.structure.modes.motions.strain import member_deformations
from middeck.structure.modes.solve import Modes


def left_out(modes: Modes, index: Int[np.ndarray, " mode"]) -> Float[np.ndarray, "mode mode"]:
    """phi_i'dK phi_j [rad^2/s^2] of ``modes[index]``, dK what more elements, and shear where there was none, do.

    That of more elements is known of each mode by itself. A mode that the mesh has no shape for has as much
    of it as the worst of the others.
    """
    beams, structure = modes.equilibrium.model.beams, modes.equilibrium.model.structure
    lam, mesh = modes.omega[index] ** 2, estimate_mesh_error(modes, int(index.max(initial=-1)) + 1)[index]
    mesh = np.where(np.isfinite(mesh), mesh, np.max(mesh[np.isfinite(mesh)], initial=0.0))
    sections = [s for m in refine_mesh(structure, 1, TUBE_SHEAR).members for s in m.sections]
    softer = beam_properties(sections, beams.length).stiffness
    some = np.any(softer != beams.stiffness, axis=(1, 2))
    force = (beams.stiffness @ member_deformations(modes.equilibrium, modes.shapes[:, index]))[some]
    yields = np.linalg.pinv(softer[some]) - np.linalg.pinv(beams.stiffness[some])
    return -np.einsum("eim,ein->mn", force, yields @ force) - np.diag(2.0 * lam * mesh)
