"""What of a mode's omega^2 may be no more than rounding, or made by what Newton left unbalanced."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.eigen import Eigenpairs
from middeck.structure.mesh import Model
from middeck.structure.statics import dynamic_coordinates, static_coordinates


def rounding(
    model: Model, pairs: Eigenpairs, gradient: Float[np.ndarray, " coordinate"]
) -> Float[np.ndarray, " mode"]:
    """Largest |omega^2| [1/s^2] of each mode that counts as zero, at a state that leaves ``gradient``.

    A force or moment g_k left at a frame adds g_k d2x_k to the tangent, and d2x_k is made of the motions of
    that frame and of those that carry it alone: a light rotor does not feel what its bearing lacks.
    """
    tree = model.tree
    own = np.zeros((tree.size, pairs.shapes.shape[1]))
    own[dynamic_coordinates(model)] = pairs.shapes**2
    left = np.where(static_coordinates(model), np.abs(gradient), 0.0)
    at_roots = 6 * tree.roots
    moved = own[:at_roots].reshape(tree.roots, 6, -1).max(axis=1)
    force = left[:at_roots].reshape(tree.roots, 6).sum(axis=1)
    noise = pairs.noise + force @ moved
    carried = list(moved)
    for joint, parent in enumerate(tree.parent):
        carried.append(np.maximum(carried[parent], own[at_roots + joint]))
        noise += left[at_roots + joint] * carried[-1]
    return noise
