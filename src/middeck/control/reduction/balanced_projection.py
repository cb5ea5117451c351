"""From two Gramian factors to fewer states: the square-root method (Tombs and Postlethwaite 1987, Int. J.
Control 46; the coordinates are Moore's, 1981, IEEE TAC 26), with ports in units of typical sizes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.reduction.gramian import GramianFactors
from middeck.errors import ConfigError
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

EQUAL = 1e-9
"""Relative difference below which singular values count as equal and their states are not separated."""


Sizes = Float[np.ndarray, " port"]


@record
class BalancedStates:
    """``left.T @ right`` is the identity; states in order of their singular values ``hankel``."""

    left: Float[np.ndarray, "state balanced"]
    right: Float[np.ndarray, "state balanced"]
    hankel: Float[np.ndarray, " value"]


def balance(factors: GramianFactors) -> BalancedStates:
    """Coordinates in which both Gramians are equal and diagonal; states of rounding size are left out."""
    U, s, Vt = np.linalg.svd(factors.see.T @ factors.reach)
    minimal = int(np.count_nonzero(s > len(s) * np.finfo(float).eps * s.max(initial=0.0)))
    root = np.sqrt(s[:minimal])
    return BalancedStates(factors.see @ U[:, :minimal] / root, factors.reach @ Vt[:minimal].T / root, s)


def project(system: StateSpace, coordinates: BalancedStates, order: int) -> StateSpace:
    """The first ``order`` states of the balanced system, the others truncated."""
    left, right = coordinates.left[:, :order], coordinates.right[:, :order]
    return StateSpace(left.T @ system.A @ right, left.T @ system.B, system.C @ right, system.D)


def settle_order(hankel: Float[np.ndarray, " value"], order: int) -> int:
    """Decaying states to keep: ``order``, or fewer, since equal values stay together."""
    k = min(order, len(hankel))
    while 0 < k < len(hankel) and hankel[k - 1] - hankel[k] <= EQUAL * hankel[k - 1]:
        k -= 1
    return k


def bound_of(hankel: Float[np.ndarray, " value"], order: int) -> float:
    """2 (sum of the singular values left out) >= largest gain of the error (Enns 1984; Glover 1984).

    >>> bound_of(np.array([3.0, 0.5, 0.25]), 1)
    1.5
    """
    return 2.0 * float(np.sum(hankel[order:]))


def check_order(order: int, kept: int, whole: int) -> int:
    """Order left for the decaying part; refuses an order below the number of states to be kept."""
    if order < kept:
        raise ConfigError(
            f"order {order} does not fit: {kept} states do not decay and are kept as they are",
            hint=f"an order from {kept} to {whole}",
        )
    return order - kept


def in_sizes(system: StateSpace, input_size: Sizes, output_size: Sizes) -> StateSpace:
    """The system with its ports scaled to their sizes."""
    u, y = input_size, output_size[:, None]
    return StateSpace(system.A, system.B * u, system.C / y, system.D * u / y)


def out_of_sizes(system: StateSpace, input_size: Sizes, output_size: Sizes) -> StateSpace:
    """The system with its ports scaled back to their units."""
    return in_sizes(system, 1.0 / input_size, 1.0 / output_size)
