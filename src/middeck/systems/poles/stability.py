"""Stability by eigenvalues.

A frequency integral stays finite for an unstable system, so no norm decides stability. Rounding splits a
defective multiple eigenvalue (the double one of a free body) to both sides of the axis, by the root of
rounding; the mean of the group is accurate to rounding and replaces it (Kato 1976, section II.2; Bavely and
Stewart 1979, SIAM J. Numer. Anal. 16).
"""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float
from scipy.sparse.csgraph import connected_components

from middeck.systems.poles.integrator_chains import NONE, NONE_SAMPLED, integrating_chains
from middeck.systems.poles.state_units import balance_states
from middeck.systems.poles.strong_components import component_poles
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, poles

GROWTH_LIMIT = 1e-8
"""Largest real part [rad/s] that still counts as stable: above rounding at an undamped pole, far below any
growth that an experiment could show (a factor e in three years)."""
SLOWEST = 1e-7
"""Size of the fastest pole [rad/s] below which rounding of integrators looks like a slow loop."""
ROUNDINGS = 100.0
"""Growth, in roundings of a pole's frequency or rate, that counts as none."""
MIXED = 1e4
"""The same of a sampled loop that is slow: a pole at one moves by as many where states are mixed."""
JOINED = 10.0
"""Change of A, in roundings, within which eigenvalues near zero that may coincide count as one."""
CROWDED = 2e-6
"""Distance from zero, relative to A, to which rounding may move a double eigenvalue: ten times its root."""


def growth_limit(period_s: float | None = None) -> float:
    """`GROWTH_LIMIT`; for a sampled system the rounding of its eigenvalues, if larger.

    >>> growth_limit(1e-3) == GROWTH_LIMIT, growth_limit(1e-8) > GROWTH_LIMIT
    (True, True)
    """
    return max(GROWTH_LIMIT, ROUNDINGS * float(np.finfo(float).eps) / period_s) if period_s else GROWTH_LIMIT


def growth_limits(
    rates: Complex[np.ndarray, " state"], period_s: float | None = None
) -> Float[np.ndarray, " state"]:
    """`growth_limit` of each pole [rad/s], or the rounding of its own frequency, if larger.

    >>> growth_limits(np.array([-1.0 + 2.0j, 1e9j])) > 2e-8
    array([False,  True])
    """
    return np.maximum(growth_limit(period_s), ROUNDINGS * np.finfo(float).eps * np.abs(np.imag(rates)))


def rest_limits(
    rates: Complex[np.ndarray, " state"], period_s: float | None = None
) -> Float[np.ndarray, " state"]:
    """Least decay of each pole [rad/s] that is no rounding: `growth_limits`, less for a loop that is slow.

    >>> rest_limits(np.array([-1.0 + 2.0j])) == GROWTH_LIMIT, rest_limits(np.array([1e-6j])) < 1e-13
    (array([ True]), array([ True]))
    """
    limits = growth_limits(rates, period_s)
    size = float(np.abs(rates[np.isfinite(rates)]).max(initial=0.0))
    if size < SLOWEST:
        return limits
    known = MIXED * float(np.finfo(float).eps) / period_s if period_s else 0.0
    return np.minimum(limits, max(GROWTH_LIMIT * size, known))


def growth_rates(system: StateSpace | SampledStateSpace) -> Complex[np.ndarray, " state"]:
    """Poles in rad/s; those of a sampled system are mapped by log(p)/T (a pole at zero to -inf).

    Poles at zero (z = 1) that rounding has split are replaced by their mean.

    >>> growth_rates(StateSpace([[-2.0]], [[1.0]], [[1.0]], [[0.0]])).real
    array([-2.])
    """
    period_s = system.period_s
    rates = _rates(system, _joined(balance_states(system).A, poles(system), sampled=period_s is not None))
    if none_grows(rates, period_s):
        return rates
    # Rounding splits equal light modes of a cascade to both sides of the axis; each component alone is not
    # split.
    alone = _rates(system, component_poles(system.A))
    return alone if none_grows(alone, period_s) else rates


def _rates(system: StateSpace | SampledStateSpace, p: np.ndarray) -> Complex[np.ndarray, " state"]:
    if system.period_s is None:
        return p
    size = np.abs(p)
    rate = np.full(len(p), -np.inf)
    np.log(size, out=rate, where=size > 0.0)
    rates = np.empty(len(p), dtype=complex)
    rates.real, rates.imag = rate / system.period_s, np.angle(p) / system.period_s
    return rates


def _joined(A: np.ndarray, values: np.ndarray, *, sampled: bool) -> Complex[np.ndarray, " state"]:
    """The eigenvalues of a balanced matrix, with those split by rounding replaced by their mean."""
    if not len(A):
        return values
    size = float(np.linalg.norm(A))
    rest = 1.0 if sampled else 0.0
    if np.sum(np.abs(values - rest) < CROWDED * size) < 2:  # no two that rounding may have split
        return values
    least = NONE_SAMPLED if sampled else NONE
    turn, sizes = integrating_chains(A - rest * np.eye(len(A)), least=least)
    if len(sizes) > 1:  # a chain of integrators, which rounding spreads; one alone is known to rounding
        n = sum(sizes)
        others = (turn.T @ A @ turn)[n:, n:]
        return np.append(
            np.full(n, rest, dtype=complex), _joined(others, np.linalg.eigvals(others), sampled=sampled)
        )
    found, left, right = cast("tuple[np.ndarray, ...]", sla.eig(A, left=True, right=True))
    found = found.astype(complex)
    aligned = np.abs(np.sum(np.conj(left) * right, axis=0))
    known = JOINED * np.finfo(float).eps * size / np.maximum(aligned, np.finfo(float).eps)
    # Only where zero lies within the uncertainty: never a slow mode.
    at_rest = np.abs(found - rest) < np.minimum(CROWDED * size, 2.0 * known)
    known = np.where(at_rest, known, 0.0)
    together = np.abs(found[:, None] - found) <= 2.0 * np.minimum(known[:, None], known)
    count, label = cast("tuple[int, np.ndarray]", connected_components(together, directed=False))
    for k in np.flatnonzero(np.bincount(label, minlength=count) > 1):
        found[label == k] = np.mean(found[label == k])
    return found


def decays(system: StateSpace) -> bool:
    """Whether all poles decay."""
    return bool(np.all(np.real(growth_rates(system)) < 0.0))


def none_grows(rates: Complex[np.ndarray, " state"], period_s: float | None = None) -> bool:
    """True where no pole [rad/s] grows faster than `growth_limits`; ``period_s`` for a sampled system.

    >>> none_grows(np.array([-1.0 + 2.0j, -1.0 - 2.0j]))
    True
    """
    return bool(np.all(np.real(rates) <= growth_limits(rates, period_s)))


def all_decay(rates: Complex[np.ndarray, " state"], period_s: float | None = None) -> bool:
    """True where every pole [rad/s] decays by more than rounding: none grows, and none stays on the axis.

    >>> all_decay(np.array([-1.0 + 2.0j])), all_decay(np.array([2.0j]))
    (True, False)
    """
    return bool(np.all(np.real(rates) < -rest_limits(rates, period_s)))
