"""Modes turned with their article, so that two attitudes are compared in the article's axes.

A turn of the whole article changes none of its own modes, only the world axes in which shapes and mass are
written.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.sparse_of_parts import turned_blocks
from middeck.structure.gravity.tracking import Spectrum, spectrum_of
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.motion_as_a_whole import fit_rotation


def turn_modes(modes: Spectrum, roots: int, R: Float[np.ndarray, "3 3"]) -> Spectrum:
    """Modes of the article turned by ``R``: displacements and rotation vectors turn, joint angles do not."""
    joints = modes.mass.shape[0] - 6 * roots
    T, back = (turned_blocks(turn, 2 * roots, joints) for turn in (R, R.T))
    return Spectrum(modes.lam, T @ modes.shapes, sp.csr_array(T @ modes.mass @ back))


def turn_along(
    modes: Spectrum, model: Model, start: Configuration, end: Configuration
) -> tuple[Spectrum, Float[np.ndarray, "3 3"]]:
    """Modes at ``start`` turned with the article to its attitude at ``end``; and that rotation.

    It is the rotation of the rigid body that fits best by mass.
    """
    R = fit_rotation(model, start, end)
    return turn_modes(modes, model.tree.roots, R), R


def modes_at_rest(orbit: Modes, lab: Modes) -> tuple[Spectrum, Float[np.ndarray, "3 3"]]:
    """``orbit`` turned to the attitude of the article at rest in ``lab``; and that rotation."""
    start = orbit.equilibrium
    return turn_along(spectrum_of(orbit), start.model, start.config, lab.equilibrium.config)


def modes_as_drawn(modes: Modes) -> Spectrum:
    """``modes`` turned back with the article to how it was drawn."""
    model = modes.equilibrium.model
    return turn_along(spectrum_of(modes), model, modes.equilibrium.config, model.rest)[0]
