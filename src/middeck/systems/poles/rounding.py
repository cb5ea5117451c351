"""Shifts of a system's poles by rounding of its matrices.

States mixed by a matrix of condition k multiply the rounding of each entry by k at the poles. From 1e7 on no
algorithm finds on which side of the axis they lie: that was lost when the matrices were stored.
"""

from __future__ import annotations

import functools
from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.systems.poles.integrator_chains import NONE, NONE_SAMPLED, integrating_chains, strictly_upper
from middeck.systems.poles.state_units import balance_states
from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import LinearSystem

EPS = float(np.finfo(float).eps)
LIGHTEST, VAGUE = 1e-6, 1e-6
"""Distance from the axis [rad/s] below which many plants leave a root undecided; and the share of its decay
by which rounding moves a pole that is known."""

ROUNDINGS = 10.0
"""Uncertainties of a pole by rounding within which it may be on the other side of a limit."""

KEPT = 64
"""Systems whose result of `is_vague` is kept: many results are asked of one loop."""

Poles = tuple[Complex[np.ndarray, " pole"], Float[np.ndarray, " pole"]]


def poles_with_rounding(A: np.ndarray) -> Poles:
    """Eigenvalues, and the first-order shift of each by rounding of every entry."""
    values, left, right = _eigenvectors(A)
    return values, _moves(left, right, EPS * np.abs(left) * (np.abs(A) @ np.abs(right)))


def farthest_pole(A: np.ndarray) -> float:
    """Largest magnitude that a pole may have: `ROUNDINGS` beyond the computed one.

    Of each strongly connected component alone: sections in series may repeat a pole exactly.
    """
    parts = [balance(A[np.ix_(part, part)])[0] for part in strong_components(A)]
    reach = [np.abs(poles) + ROUNDINGS * moved for poles, moved in map(poles_with_rounding, parts)]
    return max((float(each.max()) for each in reach), default=0.0)


@functools.lru_cache(maxsize=KEPT)
def is_vague(system: LinearSystem, share: float = VAGUE) -> bool:
    """Whether rounding of its matrices moves a pole by more than this ``share`` of its decay or growth."""
    if not len(system.A):
        return False
    A = balance_states(system).A
    poles, rounding = poles_with_rounding(A)
    # A double pole moves by the root.
    moved = np.minimum(rounding, np.sqrt(EPS * np.linalg.norm(A) * np.abs(poles)))
    decay = np.abs(np.real(poles)) if system.period_s is None else np.abs(np.abs(poles) - 1.0)
    return bool(np.any((decay >= LIGHTEST) & (moved > share * decay)))


def moving_poles(system: LinearSystem) -> tuple[Poles, list[int]]:
    """Poles other than integrators (z = 1), with their rounding; and the numbers of these by their place in a
    chain (`integrating_chains`).

    In strongly mixed states slow poles, too, are taken for integrators. The entries left out as rounding then
    move the others far, and are counted with theirs; where some of them are known not to be at rest, nothing
    is known of any.
    """
    A = balance_states(system).A
    rest, none = (0.0, NONE) if system.period_s is None else (1.0, NONE_SAMPLED)
    turn, sizes = integrating_chains(A - rest * np.eye(len(A)), least=none)
    n = sum(sizes)
    values, moved = poles_with_rounding(A)
    if not n:
        return (values, moved), sizes
    if n > np.sum(np.abs(values - rest) <= ROUNDINGS * moved + LIGHTEST):
        return (values, np.full(len(A), np.inf)), sizes
    turned = turn.T @ A @ turn - rest * np.eye(len(A))
    chain = strictly_upper(turned[:n, :n], sizes)
    rounding = EPS * np.abs(turn.T) @ np.abs(A) @ np.abs(turn)
    rounding[n:, :n] += np.abs(turned[n:, :n])
    values, left, right = _eigenvectors(turned[n:, n:])
    least = EPS * float(np.linalg.norm(A))
    away = np.where(np.abs(values) < least, least, values)
    ahead = [
        np.linalg.solve(p * np.eye(n) - chain, turned[:n, n:] @ x) for p, x in zip(away, right.T, strict=True)
    ]
    whole = np.vstack([np.reshape(ahead, (-1, n)).T, right])
    return (values + rest, _moves(left, right, np.abs(left) * (rounding[n:] @ np.abs(whole)))), sizes


def _eigenvectors(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    values, left, right = cast("tuple[np.ndarray, ...]", sla.eig(A, left=True, right=True))
    return values.astype(complex), left, right


def _moves(left: np.ndarray, right: np.ndarray, products: np.ndarray) -> Float[np.ndarray, " pole"]:
    aligned, moved = np.abs(np.sum(np.conj(left) * right, axis=0)), np.sum(products, axis=0)
    return np.divide(moved, aligned, out=np.full(len(moved), np.inf), where=aligned > 0.0)
