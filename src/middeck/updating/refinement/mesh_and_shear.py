"""What a model leaves out that more elements and shear would bring in: errors of modes that no test saw."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.finer import TUBE_SHEAR, refine_mesh
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.residuals.surveys import SetUp, pair
from middeck.updating.unknowns.unknowns import change

FINER = 2


def left_out(
    there: SetUp, x: Float[np.ndarray, " unknown"], modes: Modes, index: Int[np.ndarray, " mode"]
) -> Float[np.ndarray, " mode"]:
    """By how much ln f of ``modes[index]`` moves with twice the elements, and shear where there was none.

    Both grow with frequency. What a refinement takes up of them at the modes that a test saw, it does not at
    higher ones. A mode that is not found again has the largest of the others.
    """
    structure, environment = change(*there, x)
    fine = solve_modes(solve_equilibrium(refine_mesh(structure, FINER, TUBE_SHEAR), environment))
    moving = [i for i, kind in enumerate(fine.kind) if kind != "rigid"]
    known = measure_modes(fine, chosen=moving[: len(index)])
    place = {int(i): int(j) for i, j in pair(modes, known)}
    found = [place.get(i) for i in index.tolist()]
    hz = np.array([np.nan if j is None else known.frequency_hz[j] for j in found])
    moved = np.log(hz / modes.frequency_hz[index])
    return np.where(np.isfinite(moved), moved, np.nanmax(np.abs(moved), initial=0.0))
