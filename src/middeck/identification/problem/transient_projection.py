"""Project each experiment's own transient out of weighted rows of real numbers.

The transient of an experiment is in none of the others, so that its linear unknowns are eliminated column by
column (with one QR factorisation where all columns have one weight) before those of the model are solved for.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import lapack

# Numbers of LAPACK's workspace for each column: more than any of its blocks has columns.
ROOM = 64


class TransientProjection:
    """Projection on the complement of the transients ``B``, in the norm of ``weight``."""

    def __init__(
        self, B: Complex[np.ndarray, "column line"], weight: Float[np.ndarray, "line experiment"]
    ) -> None:
        self._weight = weight
        self._factors: list[tuple[np.ndarray, np.ndarray]] = []
        if len(B):
            once = bool(np.all(weight == weight[:, :1]))
            found = [factors(_real(B * w)) for w in (weight[:, :1] if once else weight).T]
            self._factors = found * weight.shape[1] if once else found

    def coincident(self, share: float) -> bool:
        """Whether some column of B is a combination of the rest, up to ``share``."""
        return any(
            bool(np.abs(np.diag(R)).min() <= share * np.abs(np.diag(R)).max()) for _, R in self._factors
        )

    def removed(self, rows: Complex[np.ndarray, "row line experiment"]) -> Float[np.ndarray, "row number"]:
        """Weighted rows without their parts along the transients."""
        if not self._factors:
            return as_real(rows * self._weight)
        each = [_real(rows[:, :, k] * self._weight[:, k]) for k in range(rows.shape[2])]
        left = [x - (x @ Q) @ Q.T for x, (Q, _) in zip(each, self._factors, strict=True)]
        return left[0] if len(left) == 1 else np.hstack(left)

    def leverage(self) -> Float[np.ndarray, "experiment number"]:
        """Share of each real number that its transient follows, whatever it is."""
        return np.array([np.sum(Q**2, axis=1) for Q, _ in self._factors])

    def unknowns(
        self, left: Complex[np.ndarray, "line experiment"]
    ) -> Float[np.ndarray, "experiment column"]:
        """The transients that come closest to ``left``."""
        if not self._factors:
            return np.zeros((left.shape[1], 0))
        targets = _real((left * self._weight).T)
        return np.array(
            [solve_triangle(R, Q.T @ y) for y, (Q, R) in zip(targets, self._factors, strict=True)]
        )


def as_real(rows: Complex[np.ndarray, "row line column"]) -> Float[np.ndarray, "row number"]:
    """Real and imaginary parts side by side, without a copy."""
    _, lines, columns = rows.shape
    return np.ascontiguousarray(rows).reshape(len(rows), lines * columns).view(float)


def _real(rows: Complex[np.ndarray, "row line"]) -> Float[np.ndarray, "row number"]:
    return np.ascontiguousarray(rows).view(float)


def factors(
    columns: Float[np.ndarray, "column number"],
) -> tuple[Float[np.ndarray, "number column"], Float[np.ndarray, "column column"]]:
    """Q and R of the columns, given as rows; ``columns`` is overwritten."""
    # NumPy would turn them over, twice as long as the factorisation of few columns takes; SciPy's checks take
    # as long as it does.
    least, room = min(columns.shape), ROOM * len(columns)
    reflected, tau, *_ = cast("Any", lapack).dgeqrf(columns.T, lwork=room, overwrite_a=True)
    R = np.triu(reflected[:least])
    return cast("Any", lapack).dorgqr(reflected[:, :least], tau, lwork=room, overwrite_a=True)[0], R


def solve_triangle(
    R: Float[np.ndarray, "column column"], right: Float[np.ndarray, " column"]
) -> Float[np.ndarray, " column"]:
    """R^-1 of a right side, for R upper triangular without a zero on its diagonal."""
    return cast("Any", lapack).dtrtrs(R.T, right, lower=1, trans=1)[0]  # as its numbers lie, without a copy
