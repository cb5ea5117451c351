"""From two Gramian factors to fewer states: the square-root method (Tombs and Postlethwaite 1987, Int. J.
Control 46; the coordinates are Moore's, 1981, IEEE TAC 26)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.reduction.gramian import GramianFactors
from middeck.control.reduction.result import Rest
from middeck.errors import ConfigError
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

EQUAL = 1e-9
"""Relative difference below which singular values count as equal and their states are not separated."""


@record
class Balance:
    """``left.T @ right`` is the identity; states in order of their singular values ``hankel``."""

    left: Float[np.ndarray, "state balanced"]
    right: Float[np.ndarray, "state balanced"]
    hankel: Float[np.ndarray, " value"]


def balance(factors: GramianFactors) -> Balance:
    """Coordinates in which both Gramians are equal and diagonal; states of rounding size are left out."""
    U, s, Vt = np.linalg.svd(factors.see.T @ factors.reach)
    minimal = int(np.count_nonzero(s > len(s) * np.finfo(float).eps * s.max(initial=0.0)))
    root = np.sqrt(s[:minimal])
    return Balance(factors.see @ U[:, :minimal] / root, factors.reach @ Vt[:minimal].T / root, s)


def project(system: StateSpace, coordinates: Balance, order: int, rest: Rest) -> StateSpace:
    """The first ``order`` states of the balanced system, the others truncated or residualised."""
    left, right = coordinates.left, coordinates.right
    A, B, C = left.T @ system.A @ right, left.T @ system.B, system.C @ right
    k = min(order, len(A))
    if rest == "truncate" or k == len(A):
        return StateSpace(A[:k, :k], B[:k], C[:, :k], system.D)
    # 0 = A21 x + A22 x2 + B2 u (Fernando and Nicholson 1982, IEEE TAC 27).
    still = -np.linalg.solve(A[k:, k:], np.hstack([A[k:, :k], B[k:]]))
    S, F = still[:, :k], still[:, k:]
    return StateSpace(
        A[:k, :k] + A[:k, k:] @ S, B[:k] + A[:k, k:] @ F, C[:, :k] + C[:, k:] @ S, system.D + C[:, k:] @ F
    )


def settle_order(hankel: Float[np.ndarray, " value"], order: int | None, bound: float | None) -> int:
    """Decaying states to keep: ``order``, or as few as ``bound`` allows; equal values stay together."""
    if (order is None) == (bound is None):
        raise ConfigError("a reduction needs an order or a bound, not both", hint="order=8, or bound=1e-3")
    if bound is not None:
        if not bound > 0.0:
            raise ConfigError(
                f"bound = {bound} on the error", hint="positive, relative to the sizes of the ports"
            )
        left_out = 2.0 * np.append(np.cumsum(hankel[::-1])[::-1], 0.0)
        return int(np.argmax(left_out <= bound))
    k = min(int(order or 0), len(hankel))
    while 0 < k < len(hankel) and hankel[k - 1] - hankel[k] <= EQUAL * hankel[k - 1]:
        k -= 1
    return k


def bound_of(hankel: Float[np.ndarray, " value"], order: int) -> float:
    """2 (sum of the singular values left out) >= largest gain of the error (Enns 1984; Glover 1984).

    >>> bound_of(np.array([3.0, 0.5, 0.25]), 1)
    1.5
    """
    return 2.0 * float(np.sum(hankel[order:]))


def check_order(order: int | None, kept: int, whole: int) -> int | None:
    """Order left for the decaying part; refuses an order below the number of states to be kept."""
    if order is None:
        return None
    if order < max(kept, 0) or order < 0:
        raise ConfigError(
            f"order {order} does not fit: {kept} states do not decay and are kept as they are",
            hint=f"an order from {kept} to {whole}",
        )
    return order - kept
