"""Torsion constants: of a solid polygon with two axes of symmetry, of thin walls (open, or closed cells)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

POWERS = 2 * np.arange(24)  # even ones, of the symmetries
POINTS = 60  # on each side
# Two points by number, and the thickness between them.
Wall = tuple[int, int, float]


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
    # An analytic f has the integral of f conj(z) dz / 2i around the section; r^2 has a quarter of it.
    psi = np.imag(np.sum(along * np.conj(point) * (powers @ factor))) / 2.0
    polar = np.imag(np.sum(along * np.conj(point) * np.abs(point) ** 2)) / 4.0
    return float(size**4 * (2.0 * psi - polar))


def twist_walls(
    points: Sequence[tuple[float, float]], walls: Sequence[Wall]
) -> tuple[Float[np.ndarray, "2"], float, float]:
    """Shear centre (y, z), and the torsion constants of cells (Bredt) and of the walls by themselves.

    The warping of unit twist is linear along each wall; what the walls of a cell cannot follow is its shear
    flow (Vlasov 1961).
    """
    at = np.array(points)
    start, end = (np.array([wall[k] for wall in walls]) for k in (0, 1))
    t = np.array([wall[2] for wall in walls])
    span = at[end] - at[start]
    length = np.linalg.norm(span, axis=1)
    swept = at[start, 0] * at[end, 1] - at[start, 1] * at[end, 0]
    B = np.zeros((len(walls), len(at)))
    B[np.arange(len(walls)), end], B[np.arange(len(walls)), start] = 1.0, -1.0
    root = np.sqrt(t / length)
    warping = np.linalg.lstsq(root[:, None] * B, root * swept, rcond=None)[0]
    slip = root * (B @ warping - swept)

    def integral(f: np.ndarray, g: np.ndarray) -> float:
        a, b, c, d = f[start], f[end], g[start], g[end]
        return float(np.sum(t * length * (2.0 * a * c + a * d + b * c + 2.0 * b * d)) / 6.0)

    one = np.ones(len(at))
    y, z = (x - integral(x, one) / integral(one, one) for x in at.T)
    yy, zz, yz = integral(y, y), integral(z, z), integral(y, z)
    centre = np.linalg.solve([[yz, -yy], [zz, -yz]], [integral(warping, y), integral(warping, z)])
    return centre, float(slip @ slip), float(np.sum(length * t**3) / 3.0)
