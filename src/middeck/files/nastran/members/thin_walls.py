"""Thin walls joined at their middle lines: shear centre and torsion constant, of open walls and of cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

# Two points by number, and the thickness between them.
Wall = tuple[int, int, float]


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
