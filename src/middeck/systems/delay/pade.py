"""Delays: the Pade approximation in a form that stays well conditioned at any useful order."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.errors import ConfigError
from middeck.systems.state_space.statespace import StateSpace, gain_system


def pade(delay_s: float, order: int) -> StateSpace:
    """The diagonal Pade approximation of exp(-s tau) as a state space of ``order`` states.

    With x = s tau / 2, exp(-2x) = (1 - tanh x) / (1 + tanh x), and cutting Lambert's continued fraction
    tanh x = 1/(1/x + 1/(3/x + 1/(5/x + ...))) after ``order`` terms gives the diagonal Pade approximation
    (Perron 1957, ch. 5). In p = 1/x that fraction is a lossless ladder: a skew tridiagonal matrix with the
    entries 1/sqrt(4 k^2 - 1), damped in its first state. Its inverse is the A used here: no polynomial, no
    root, and a condition number below the square of the order (the companion form: 1e19 at order 6).

    Args:
        delay_s: Delay tau [s], zero or more; a delay of zero has no states.
        order: Number of states, one or more.

    Raises `ConfigError` for a negative or non-finite delay, or an order below one.

    >>> from middeck.systems.plants.response import statespace_response
    >>> G = statespace_response(pade(0.01, 3), np.array([100.0]))[0, 0, 0]
    >>> bool(abs(G - np.exp(-1j)) < 1e-5)   # one radian of phase; Pade 3 errs by tau^7 omega^7 / 100800
    True
    """
    if not (np.isfinite(delay_s) and delay_s >= 0.0):
        raise ConfigError(f"a delay of {delay_s} s cannot be built", hint="a finite delay of zero or more")
    if order < 1:
        raise ConfigError(f"a Pade order of {order} cannot be built", hint="an order of 1 or more, often 3")
    if delay_s == 0.0:
        return gain_system(np.ones((1, 1)))
    k = np.arange(1, order)
    rungs = 1.0 / np.sqrt(4.0 * k**2 - 1.0)
    ladder = np.diag(rungs, 1) - np.diag(rungs, -1)
    ladder[0, 0] = -1.0
    # (1 - F)/(1 + F) = 1 - 2 e1' (p I - ladder)^-1 e1, then p = 1/x = 2 / (s tau).
    M = np.linalg.inv(ladder)
    scale = 2.0 / delay_s
    share = np.sqrt(2.0 * scale)
    return StateSpace(scale * M, share * M[:, :1], share * M[:1], np.array([[1.0 + 2.0 * M[0, 0]]]))


def evaluate_pade(
    delay_s: float, order: int, s: Complex[np.ndarray, " point"]
) -> Complex[np.ndarray, " point"]:
    """The response of `pade` at complex frequencies ``s`` [rad/s], by its continued fraction.

    Costs ``order`` divisions a point, against a Schur form for the state space.

    >>> lag = evaluate_pade(0.01, 3, np.array([100.0j]))[0]
    >>> bool(abs(lag - np.exp(-1j)) < 1e-5)
    True
    """
    if delay_s == 0.0:
        return np.ones(len(s), dtype=complex)
    x = 0.5 * delay_s * s
    square = x**2
    with np.errstate(divide="ignore", invalid="ignore"):
        # tanh x = x / (1 + x^2 / (3 + x^2 / (5 + ...))), from the last term forwards.
        below = np.full(len(s), 2.0 * order - 1.0, dtype=complex)
        for odd in range(2 * order - 3, 0, -2):
            below = odd + square / below
        return (below - x) / (below + x)
