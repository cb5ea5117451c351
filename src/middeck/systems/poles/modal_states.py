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

from middeck.systems.poles.rounding import poles_with_rounding
from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.balancing import balance
from middeck.values import record

BLURRED = 1e-9
"""Of its decay, by which rounding of the entries moves a pole of mixed states (of light ones from 300 on)."""
MIXED = 30.0
"""Condition of unit bases, in balanced units, up to which the states stay as they are."""
INSEPARABLE = 1e8
"""Condition of the bases beyond which half the digits would be lost."""
APART, NOTHING = 1.01, 1e-6
"""Ratio of magnitudes from which poles are of two groups; magnitude, of the largest, that counts as zero."""


@record
class ModalStates:
    """x = T x_m: T^-1 A T is block diagonal where it was mixed, a block for each group of poles of one
    magnitude; ``rate`` [rad/s] is that of each state, NaN where it stays as it is. ``condition`` is the
    largest of T's parts, in balanced units.
    """

    T: Float[np.ndarray, "state state"]
    rate: Float[np.ndarray, " state"]
    condition: float


def modal_states(A: Float[np.ndarray, "state state"]) -> ModalStates | None:
    """The states of every strongly connected part of ``A`` that are mixed; None for none.

    >>> turn = np.array([[1.0, 1e4], [1.0, 1e4 + 1.0]])
    >>> found = modal_states(turn @ np.diag([-1.0, -2.0]) @ np.linalg.inv(turn))
    >>> found.rate.round(6).tolist()
    [1.0, 2.0]
    """
    if not np.all(np.isfinite(A)):
        return None
    T, rate, condition = np.eye(len(A)), np.full(len(A), np.nan), 1.0
    for part in strong_components(A):
        within = A[np.ix_(part, part)]
        unit, basis = _unmixed(within)
        if MIXED < (mixed := float(np.linalg.cond(basis))) < INSEPARABLE:
            T[np.ix_(part, part)], condition = unit[:, None] * basis, max(condition, mixed)
            rate[part] = np.sort(np.abs(np.linalg.eigvals(within)))
    return ModalStates(T, rate, condition) if condition > 1.0 else None


def _unmixed(A: np.ndarray) -> tuple[Float[np.ndarray, " state"], Float[np.ndarray, "state state"]]:
    """Balanced units, and bases of all groups side by side; unit ones where rounding moves no pole far."""
    balanced, unit = balance(A)
    poles, moved = poles_with_rounding(balanced)
    if not np.any(moved > BLURRED * np.abs(np.real(poles))):
        return unit, np.eye(len(A))
    form, vectors = cast("tuple[np.ndarray, np.ndarray]", sla.schur(balanced))
    return unit, np.hstack([_subspace(form, vectors, group) for group in _groups(form, vectors)])


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
