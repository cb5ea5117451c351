"""The centre line of a beam element between its two end poses, by the element's own shape functions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Inexact

from middeck.structure.elements.beam import BeamProperties


def beam_curve(
    beams: BeamProperties,
    x: Inexact[np.ndarray, "element 2 3"],
    T: Inexact[np.ndarray, "element 2 3 3"],
    at: Float[np.ndarray, " station"] | Float[np.ndarray, "element station"],
) -> Inexact[np.ndarray, "element station 3"]:
    """Points of every element at the fractions ``at`` of its length, alike or its own; analytic.

    Cubic, with the section normals of both ends; under shear as Przemieniecki 1968. With s the
    chord, l its length and t a normal, an end adds N (l t - s), N that of its rotation in each own plane. A
    rod goes straight in a plane where it has no stiffness to bend.
    """
    chord = x[:, 1] - x[:, 0]
    span = np.sqrt(np.sum(chord * chord, axis=1))
    shear = np.stack([np.zeros_like(beams.shear_y), beams.shear_y, beams.shear_z], axis=1)[:, None]
    stiff = np.stack([0.0 * beams.EI_z, beams.EI_z, beams.EI_y], axis=1)
    bends = (~beams.straight[:, None] | (stiff > 0.0))[:, None]
    s = np.atleast_2d(at)[..., None]
    first = bends * s * (1.0 - s) * (1.0 - s + 0.5 * shear) / (1.0 + shear)
    second = bends * s * (s - 1.0) * (s + 0.5 * shear) / (1.0 + shear)
    points = x[:, None, 0] + s * chord[:, None]
    for end, weight in ((0, first), (1, second)):
        lean = span[:, None] * T[:, end, :, 0] - chord
        own = np.einsum("eik,ei->ek", T[:, end], lean)
        points = points + np.einsum("eik,esk,ek->esi", T[:, end], weight, own)
    return points
