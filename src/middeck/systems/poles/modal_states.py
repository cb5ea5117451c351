"""States in groups that each belong to their own poles, for systems whose states are mixed.

States mixed by a matrix of condition k cost an algorithm that squares them rounding of k^4, of which the
stored matrices hold k^2: compensators for light modes were off by a thousandth at k = 1e3. Bases of invariant
subspaces come from ordered real Schur forms (Bavely and Stewart 1979, SIAM J. Numer. Anal. 16).
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.linalg as sla
import scipy.sparse.csgraph as csgraph
from jaxtyping import Bool, Complex, Float, Int
from scipy.linalg import lapack

from middeck.systems.poles.integrator_chains import integrating_chains
from middeck.systems.poles.rounding import ROUNDINGS, poles_with_rounding
from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.balancing import balance
from middeck.values import record

BLURRED = 1e-9
"""Least shift of a pole by rounding of the entries, over its decay, at which its states count as mixed."""
PARTED, MIXED = 1.1, 30.0
"""Conditions of unit bases, in balanced units: up to the first the states stay as they are; beyond the second
rounding of the entries may move a result. A free body that is hardly reached or seen loses its digits to
states mixed ever so little, by the square of its weight in them.
"""
INSEPARABLE = 1e8
"""Condition of the bases beyond which half the digits would be lost."""


@record
class ModalStates:
    """x = T x_m: T^-1 A T is block diagonal where it was mixed, a block for each group of poles that rounding
    does not tell apart; ``rate`` [rad/s] is their magnitude, NaN of a state that stays as it is.
    ``condition`` is the largest of T's parts, in balanced units. ``chains`` are states of integrators and
    their numbers by place in a chain (`integrating_chains`): T^-1 A T is strictly block upper triangular in
    these, and zero in the rest of their columns.
    """

    T: Float[np.ndarray, "state state"]
    rate: Float[np.ndarray, " state"]
    condition: float
    chains: tuple[tuple[Int[np.ndarray, " rest"], list[int]], ...] = ()


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
    chains: list[tuple[np.ndarray, list[int]]] = []
    for part in strong_components(A):
        balanced, unit = balance(A[np.ix_(part, part)])
        poles, moved = poles_with_rounding(balanced)
        if not np.any(moved > BLURRED * np.abs(np.real(poles))):
            continue
        groups = _groups(poles, moved)
        basis, sizes = _bases(balanced, poles, groups)
        turn, chain = integrating_chains(balanced)
        if at_rest := _is_slowest(sum(chain), groups):
            basis[:, : sum(chain)] = turn[:, : sum(chain)]
        if PARTED < (mixed := float(np.linalg.cond(basis))) < INSEPARABLE:
            T[np.ix_(part, part)], rate[part] = unit[:, None] * basis, sizes
            condition = max(condition, mixed)
            chains += [(part[: sum(chain)], chain)] if at_rest else []
    return ModalStates(T, rate, condition, tuple(chains)) if condition > 1.0 else None


def _is_slowest(count: int, groups: list[Bool[np.ndarray, " pole"]]) -> bool:
    """Whether so many poles are all of the first groups."""
    return count > 0 and count in np.cumsum([group.sum() for group in groups])


def _groups(
    poles: Complex[np.ndarray, " pole"], moved: Float[np.ndarray, " pole"]
) -> list[Bool[np.ndarray, " pole"]]:
    """Poles that rounding does not tell apart, both of a pair in one group; by magnitude."""
    # To first order a double pole moves without bound.
    reach = ROUNDINGS * np.minimum(moved, np.abs(poles))
    upper = np.real(poles) + 1j * np.abs(np.imag(poles))
    near = np.abs(upper[:, None] - upper) <= reach[:, None] + reach
    count, label = csgraph.connected_components(near, directed=False)
    return sorted((label == group for group in range(count)), key=lambda of: np.abs(poles[of]).max())


def _bases(
    A: np.ndarray, poles: np.ndarray, groups: list[Bool[np.ndarray, " pole"]]
) -> tuple[Float[np.ndarray, "state state"], Float[np.ndarray, " state"]]:
    """Orthonormal bases of the states that belong to each group, side by side, and its poles' magnitudes."""
    form, vectors = cast("tuple[np.ndarray, np.ndarray]", sla.schur(A))
    reorder = cast("Any", lapack).dtrsen
    _, _, real, imaginary, *_ = reorder(np.zeros(len(A), np.int32), form, vectors, job="N")
    nearest = np.argmin(np.abs((real + 1j * imaginary)[:, None] - poles), axis=1)
    chosen = [group[nearest] for group in groups]
    bases = [reorder(c.astype(np.int32), form, vectors, job="N")[1][:, : c.sum()] for c in chosen]
    sizes = [np.sort(np.hypot(real, imaginary)[c]) for c in chosen]
    return np.hstack(bases), np.concatenate(sizes)
