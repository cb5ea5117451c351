"""Mass of beam elements, consistent or partly lumped, rotary and polar inertia included."""

from __future__ import annotations

import numpy as np
from jaxtyping import Inexact

from middeck.structure.elements.beam import BeamProperties
from middeck.structure.elements.beam_deformations import chord
from middeck.structure.elements.rotations import cross

Array = np.ndarray
# Points and weights on (0, 1), exact for products of cubics.
GAUSS, WEIGHT = (
    (np.polynomial.legendre.leggauss(4)[0] + 1.0) / 2.0,
    np.polynomial.legendre.leggauss(4)[1] / 2.0,
)


def beam_mass(
    beams: BeamProperties, x: Inexact[np.ndarray, "element 2 3"], T: Inexact[np.ndarray, "element 2 3 3"]
) -> Inexact[np.ndarray, "element 12 12"]:
    """Mass of each element, rotary and polar inertia included, on the current chord.

    The mass per element is that of the undeformed state; the chord's own length makes rigid rotations of a
    stretched element exact.
    """
    e, span = chord(x)
    y = T[:, 0, :, 1] + T[:, 1, :, 1]
    y = _unit(y - np.sum(y * e, axis=1)[:, None] * e)
    frame = np.stack([e, y, cross(e, y)], axis=-1)
    turn = np.einsum("eij,pq->epiqj", frame, np.eye(4)).reshape(-1, 12, 12)
    return turn @ _local_mass(beams, span) @ np.swapaxes(turn, 1, 2)


def _local_mass(beams: BeamProperties, span: Array) -> Array:
    """Gauss quadrature of shape functions."""
    n, count = len(span), len(GAUSS)
    dtype = np.result_type(
        span, beams.length, beams.rho_A, beams.rho_I_y, beams.rho_I_z, beams.shear_y, beams.mass_centre_y
    )
    N = np.zeros((n, count, 6, 12), dtype)  # displacement and rotation fields at the points
    for axis in (0, 3):
        N[:, :, axis, axis], N[:, :, axis, axis + 6] = 1.0 - GAUSS, GAUSS
    L = span[:, None]
    # COUPLED, alone lumped along and not straight, is the mass of a bar rigid in shear.
    shears = beams.straight | (beams.lumped[:, 0] == 0.0)
    v, slope = transverse_shapes(GAUSS, L, (shears * beams.shear_y)[:, None])
    N[:, :, 1, [1, 5, 7, 11]], N[:, :, 5, [1, 5, 7, 11]] = np.moveaxis(v, 1, 2), np.moveaxis(slope, 1, 2)
    v, slope = transverse_shapes(GAUSS, L, (shears * beams.shear_z)[:, None])
    sign = np.array([1.0, -1.0, 1.0, -1.0])  # w' = -theta_y
    N[:, :, 2, [2, 4, 8, 10]] = np.moveaxis(v, 1, 2) * sign
    N[:, :, 4, [2, 4, 8, 10]] = np.moveaxis(slope, 1, 2) * -sign
    N[beams.straight, :, 1:3] = 0.0
    for axis in (1, 2):
        N[beams.straight, :, axis, axis], N[beams.straight, :, axis, axis + 6] = 1.0 - GAUSS, GAUSS
    _add_slant(N, shears[:, None, None] * beams.slant, L)
    # Fields at the mass centre: the sections turn about the node line.
    N[:, :, 0] += _tall(beams.mass_centre_z) * N[:, :, 4] - _tall(beams.mass_centre_y) * N[:, :, 5]
    N[:, :, 1] -= _tall(beams.mass_centre_z) * N[:, :, 3]
    N[:, :, 2] += _tall(beams.mass_centre_y) * N[:, :, 3]
    density = np.stack(
        [beams.rho_A] * 3 + [beams.rho_I_y + beams.rho_I_z, beams.rho_I_y, beams.rho_I_z], axis=1
    )
    weighted = N * (beams.length[:, None, None] * WEIGHT[:, None] * density[:, None])[:, :, :, None]
    mass = np.swapaxes(weighted.reshape(n, -1, 12), 1, 2) @ N.reshape(n, -1, 12)
    # Goes from between the ends to either.
    lumped = beams.lumped[:, [0, 1, 1]] * (beams.rho_A * beams.length / 6.0)[:, None]
    for i in range(3):
        for j, k, sign in ((i, i, 1.0), (i + 6, i + 6, 1.0), (i, i + 6, -1.0), (i + 6, i, -1.0)):
            mass[:, j, k] += sign * lumped[:, i]
    return mass


def _add_slant(N: Array, slant: Array, L: Array) -> None:
    """Deflection and rotation by the shear that mean strains bring: without it, the chord leans less."""
    ends = np.zeros((4, 12))
    ends[[0, 1, 2, 3], [0, 3, 4, 5]], ends[[0, 1, 2, 3], [6, 9, 10, 11]] = -1.0, 1.0
    shear = -(slant @ ends / L[:, :, None])[:, None]
    for across, about in ((1, 5), (2, 4)):
        lean = 0.5 * L[:, :, None] * (N[:, :, :, across] - N[:, :, :, across + 6])
        lean[:, :, across] += L * (GAUSS - 0.5)
        for field in (across, about):
            N[:, :, field] += lean[:, :, field, None] * shear[:, :, across - 1]


def transverse_shapes(xi: float | Array, L: Array, shear: Array) -> tuple[Array, Array]:
    """Deflection v and section rotation for (v1, theta1, v2, theta2); cubic for shear = 0 (Friedman 1993)."""
    f, xi2, xi3 = 1.0 / (1.0 + shear), xi**2, xi**3
    v = [
        f * (2 * xi3 - 3 * xi2 - shear * xi + 1 + shear),
        f * L * (xi3 - (2 + shear / 2) * xi2 + (1 + shear / 2) * xi),
        f * (-2 * xi3 + 3 * xi2 + shear * xi),
        f * L * (xi3 - (1 - shear / 2) * xi2 - shear / 2 * xi),
    ]
    slope = [
        f * 6 / L * (xi2 - xi),
        f * (3 * xi2 - (4 + shear) * xi + 1 + shear),
        -f * 6 / L * (xi2 - xi),
        f * (3 * xi2 - (2 - shear) * xi),
    ]
    return np.stack(v, axis=1), np.stack(slope, axis=1)


def _tall(a: Array) -> Array:
    return a[:, None, None]


def _unit(v: Array) -> Array:
    return v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
