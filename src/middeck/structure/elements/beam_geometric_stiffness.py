"""Geometric stiffness of a beam element: second derivatives of its deformations under forces that are held.

Axial force, moments and torque of an element that is loaded, by its weight for one, stiffen it or soften it.
Derived from the invariants of `beam_deformations`, without approximation.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np
from jaxtyping import Inexact

from middeck.structure.elements.beam_deformations import (
    LENGTH,
    ONE,
    TWIST,
    TWO,
    A,
    Array,
    B,
    Deformation,
    Invariants,
)
from middeck.structure.elements.rotations import IDENTITY, skew, symmetric_double_cross


def geometric_stiffness(
    deformation: Deformation, force: Inexact[np.ndarray, "element 6"]
) -> Inexact[np.ndarray, "element 12 12"]:
    """Second derivative of force . deformation, ``force`` held, in the pose coordinates."""
    s = deformation.invariants
    bent = np.einsum("ek,ekij->eij", force, deformation.second)
    out = np.asarray(s.slope.mT @ bent @ s.slope)
    weight = np.einsum("ek,eki->ei", force, deformation.first)
    _add_chord_block(out, (weight[:, LENGTH] / s.span)[:, None, None] * _across(s.chord))
    # Three direction cosines, weighted, are the one of the weighted sum of the triad.
    one, two = (np.matvec(s.T[:, end], weight[:, rows]) for end, rows in ((0, A), (1, B)))
    add_cosine_hessian(out, s.chord, s.span, ((one, ONE), (two, TWO)))
    _add_twist_hessian(out, s, weight[:, TWIST])
    return out


def add_cosine_hessian(
    out: Array, e: Array, span: Array, vectors: Sequence[tuple[Array, slice | None]]
) -> None:
    """Add the Hessian of e . vector for each vector, with the coordinates that turn it (fixed: None)."""
    P = _across(e)
    total = reduce(np.add, (vector for vector, _ in vectors))
    c = np.einsum("ei,ei->e", e, total)
    outer = (total - c[:, None] * e)[:, :, None] * e[:, None, :]
    _add_chord_block(out, -(outer + outer.mT + c[:, None, None] * P) / (span**2)[:, None, None])
    for vector, rotation in vectors:
        if rotation is None:
            continue
        out[:, rotation, rotation] += symmetric_double_cross(e, vector)
        mixed = skew(vector) @ P / span[:, None, None]
        for a, sign in ((0, -1.0), (6, 1.0)):
            out[:, rotation, a : a + 3] += sign * mixed
            out[:, a : a + 3, rotation] += sign * mixed.mT


def _add_chord_block(out: Array, H: Array) -> None:
    """Add a second derivative in the chord x2 - x1 to both end positions."""
    for a, sign_a in ((0, -1.0), (6, 1.0)):
        for b, sign_b in ((0, -1.0), (6, 1.0)):
            out[:, a : a + 3, b : b + 3] += sign_a * sign_b * H


def _add_twist_hessian(out: Array, s: Invariants, weight: Array) -> None:
    """Add the Hessian of weight * atan2(sine, cosine)."""
    S, C = s.sine, s.cosine
    r2 = S.value**2 + C.value**2
    W = (weight * C.value / r2)[:, None, None] * S.W - (weight * S.value / r2)[:, None, None] * C.W
    trace = np.trace(W, axis1=1, axis2=2)[:, None, None] * IDENTITY
    same = 0.5 * (W + W.mT) - trace
    out[:, ONE, ONE] += same
    out[:, TWO, TWO] += same
    out[:, TWO, ONE] += trace - W.mT
    out[:, ONE, TWO] += trace - W
    f_SS = -2.0 * weight * S.value * C.value / r2**2
    f_SC = weight * (S.value**2 - C.value**2) / r2**2
    left = f_SS[:, None] * S.slope + f_SC[:, None] * C.slope
    right = f_SC[:, None] * S.slope - f_SS[:, None] * C.slope
    out += S.slope[:, :, None] * left[:, None, :] + C.slope[:, :, None] * right[:, None, :]


def _across(e: Array) -> Array:
    """Projection normal to unit vectors."""
    return IDENTITY - e[:, :, None] * e[:, None, :]
