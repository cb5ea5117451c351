"""Saint-Venant's torsion constant of a solid polygon with two axes of symmetry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

POWERS = 2 * np.arange(24)  # even ones, of the symmetries
POINTS = 60  # on each side


def torsion_of_polygon(corners: Sequence[complex]) -> float:
    """Torsion constant of the polygon, counterclockwise about its centre at 0.

    The conjugate warping psi is harmonic, and half the square of the radius on the boundary (Timoshenko and
    Goodier 1970, article 107); J is the integral of 2 psi - r^2. Powers of the position are fitted there, and
    integrals over the section follow from its boundary.

    >>> round(torsion_of_polygon([0.5 + 0.5j, -0.5 + 0.5j, -0.5 - 0.5j, 0.5 - 0.5j]), 6)
    0.140577
    """
    at = np.array(corners)
    size = float(np.abs(at).max())
    x, weight = np.polynomial.legendre.leggauss(POINTS)
    start, step = at / size, np.roll(at, -1) / size - at / size
    point = (start[:, None] + 0.5 * (1.0 + x) * step[:, None]).ravel()
    along = (0.5 * weight * step[:, None]).ravel()
    powers = point[:, None] ** POWERS
    root = np.sqrt(np.abs(along))
    factor = np.linalg.lstsq(root[:, None] * powers.real, root * 0.5 * np.abs(point) ** 2, rcond=None)[0]
    # Of f analytic the integral over the section is that of f conj(z) dz / 2i around it; of r^2, a quarter.
    psi = np.imag(np.sum(along * np.conj(point) * (powers @ factor))) / 2.0
    polar = np.imag(np.sum(along * np.conj(point) * np.abs(point) ** 2)) / 4.0
    return float(size**4 * (2.0 * psi - polar))
