"""The constraint of relative degree two: the residues of each path add up to zero."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.problem.layout import Layout, Point
from middeck.identification.problem.terms import linear_of_terms


class ZeroSum:
    """Linear unknowns x of an output under the constraint C x = 0, at one theta."""

    def __init__(self, layout: Layout, point: Point) -> None:
        self._layout = layout
        self._C = _ties(layout, point)
        # Orthonormal: what is free is as well conditioned as all was.
        self._free = np.linalg.svd(self._C)[2][len(self._C) :] if len(self._C) else None

    def free(self, rows: Float[np.ndarray, "column number"]) -> Float[np.ndarray, "free number"]:
        """The columns' combinations that are free."""
        return rows if self._free is None else self._free @ rows

    def whole(self, y: Float[np.ndarray, " free"]) -> Float[np.ndarray, " column"]:
        """x from the factors of those combinations."""
        return y if self._free is None else y @ self._free

    def moved(self, x: Float[np.ndarray, " column"], rows: np.ndarray) -> np.ndarray | float:
        """What x gains on ``rows`` [column, ...] as it moves with theta (delays apart) to stay tied.

        Its free part is projected out later, so that any such move will do.
        """
        if self._free is None:
            return 0.0
        return np.tensordot(-_tie_slopes(self._layout, x) @ np.linalg.pinv(self._C).T, rows, axes=1)


def _ties(layout: Layout, point: Point) -> Float[np.ndarray, "tie column"]:
    """What must vanish, as a matrix on the linear unknowns of an output: the sum of residues of each path."""
    if not layout.options.zero_sum:
        return np.zeros((0, layout.columns))
    C = np.zeros((layout.inputs, layout.columns))
    pairs = layout.pairs * layout.copies
    b = point.b[:pairs]
    C[:, 0 : 2 * pairs : 2] = 2.0 * np.real(b).T
    C[:, 1 : 2 * pairs : 2] = -2.0 * np.imag(b).T
    C[:, 2 * pairs : layout.mode_columns] = np.real(point.b[pairs:]).T
    return C


def _tie_slopes(layout: Layout, x: Float[np.ndarray, " column"]) -> Float[np.ndarray, "unknown tie"]:
    """Derivative of `_ties` times ``x`` by theta: only b is in it."""
    found = np.zeros((layout.size - layout.delays[0] * layout.delays[1], layout.inputs))
    c = linear_of_terms(layout, x)
    for k, (m, i, part) in enumerate(layout.free_b):
        weight = 2.0 if layout.pair[m] else 1.0
        found[len(layout.pair) + layout.pairs + k, i] = weight * (-c[m].imag if part else c[m].real)
    return found
