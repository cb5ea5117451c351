"""States of which each group belongs to its own poles, for systems whose states are mixed.

States mixed by a matrix of condition k cost an algorithm that squares them rounding of k^4, of which the
stored matrices hold k^2: laws for light modes were off by a thousandth at k = 1e3. Bases of invariant
subspaces come from ordered real Schur forms (Bavely and Stewart 1979, SIAM J. Numer. Anal. 16).
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float
from scipy.linalg import lapack

from middeck.systems.state_space.balancing import balance

MIXED = 30.0
"""Condition of unit bases, in balanced units, up to which the states stay as they are."""
INSEPARABLE = 1e8
"""Condition of the bases beyond which half the digits would be lost."""
APART, NOTHING = 1.01, 1e-6
"""Ratio of magnitudes from which poles are of two groups; magnitude, of the largest, that counts as zero."""


def modal_states(A: Float[np.ndarray, "state state"]) -> Float[np.ndarray, "state state"] | None:
    """T of x = T x_m, so that T^-1 A T is block diagonal, a block for each group of poles of one magnitude.

    None where the states are not mixed, and where no such T is well conditioned.

    >>> turn = np.array([[1.0, 100.0], [0.0, 1.0]])
    >>> T = modal_states(turn @ np.diag([-1.0, -2.0]) @ np.linalg.inv(turn))
    >>> np.round(np.linalg.solve(T, turn @ np.diag([-1.0, -2.0]) @ np.linalg.inv(turn)) @ T, 9)
    array([[-1.,  0.],
           [ 0., -2.]])
    """
    if len(A) < 2 or not np.all(np.isfinite(A)):
        return None
    balanced, unit = balance(A)
    if np.linalg.cond(np.linalg.eig(balanced)[1]) <= MIXED:
        return None
    form, vectors = cast("tuple[np.ndarray, np.ndarray]", sla.schur(balanced))
    T = np.hstack([_subspace(form, vectors, group) for group in _groups(form, vectors)])
    return unit[:, None] * T if MIXED < np.linalg.cond(T) < INSEPARABLE else None


def _groups(form: np.ndarray, vectors: np.ndarray) -> list[Bool[np.ndarray, " state"]]:
    """Eigenvalues of a Schur form, in its order, by magnitude: pairs and multiple ones stay together."""
    _, _, real, imaginary, *_ = cast("Any", lapack).dtrsen(
        np.zeros(len(form), np.int32), form, vectors, job="N"
    )
    size = np.hypot(real, imaginary)
    size = np.maximum(size, NOTHING * size.max())
    order = np.argsort(size, kind="stable")
    label = np.empty(len(form), int)
    label[order] = np.cumsum(np.append(0, size[order][1:] > APART * size[order][:-1]))
    return [label == group for group in range(label.max() + 1)]


def _subspace(
    form: np.ndarray, vectors: np.ndarray, group: Bool[np.ndarray, " state"]
) -> Float[np.ndarray, "state member"]:
    """An orthonormal basis of the states that belong to the eigenvalues of ``group``."""
    return cast("Any", lapack).dtrsen(group.astype(np.int32), form, vectors, job="N")[1][:, : group.sum()]
