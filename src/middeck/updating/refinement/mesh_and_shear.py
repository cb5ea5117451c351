"""Errors of a model by missing shear and elements: of one sign, shared by all modes.

Members of a shear flexibility F yield under the shear forces V of the modes, to first order by
phi_i'dK phi_j = - sum of L V_i'F V_j over the elements: an element's forces stay as they are where it gives
way, since its ends are free to follow. The error of the mesh is that of `estimate_mesh_error`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.elements.beam_deformations import Y1, Y2, Z1, Z2
from middeck.structure.elements.section_stiffness import TURNS, section_forms
from middeck.structure.model.finer_mesh import TUBE_SHEAR, refine_mesh
from middeck.structure.modes.mesh_error import estimate_mesh_error
from middeck.structure.modes.motions.strain_shares import member_deformations
from middeck.structure.modes.solve import Modes


def left_out(modes: Modes, index: Int[np.ndarray, " mode"]) -> Float[np.ndarray, "mode mode"]:
    """phi_i'dK phi_j [rad^2/s^2] of ``modes[index]``: what endless elements, and shear, would change.

    Shear is that of tubes, in members without a shear stiffness of their own. A mode for which the mesh has
    no shape lacks as much by the mesh as the worst of the others.
    """
    beams, structure = modes.equilibrium.model.beams, modes.equilibrium.model.structure
    lam, mesh = modes.omega[index] ** 2, estimate_mesh_error(modes, int(index.max(initial=-1)) + 1)[index]
    mesh = np.where(np.isfinite(mesh), mesh, np.max(mesh[np.isfinite(mesh)], initial=0.0))
    drawn, softer = (
        section_forms([s for m in one.members for s in m.sections]).F
        for one in (structure, refine_mesh(structure, 1, TUBE_SHEAR))
    )
    yields = TURNS @ (softer - drawn) @ TURNS.T / beams.length[:, None, None]
    force = beams.stiffness @ member_deformations(modes.equilibrium, modes.shapes[:, index])
    moments = force[:, [Y1, Z1]] + force[:, [Y2, Z2]]  # shear force times length
    return -np.einsum("eim,ein->mn", moments, yields @ moments) - np.diag(2.0 * lam * mesh)
