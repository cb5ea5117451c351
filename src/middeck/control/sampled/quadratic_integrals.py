"""Integrals of a quadratic form along exp(A t), for the cost and noise of a sampled problem.

Van Loan (1978, IEEE TAC 23, "Computing integrals involving the matrix exponential") uses one exponential that
contains exp(-A T). Here a Gauss-Legendre rule integrates to rounding over a short interval, which is then
doubled by squaring the exponential; poles fast against the period do no harm.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.values import record

NODES = 10
"""Gauss points: for |A| h <= 1 the integrand is bounded by exp(2 |A| t) and the error by 2^20 / 20!^1.5."""


@record
class NoiseSpread:
    """Effect of white noise of intensity V on x' = A x + w over a time h.

    Attributes:
        transition: exp(A h).
        covariance: Covariance of the state, from rest: the integral of exp(A t) V exp(A' t).
        dwell: The integral of that covariance from 0 to h.
    """

    transition: Float[np.ndarray, "state state"]
    covariance: Float[np.ndarray, "state state"]
    dwell: Float[np.ndarray, "state state"]


def spread_noise(
    A: Float[np.ndarray, "state state"], V: Float[np.ndarray, "state state"], duration_s: float
) -> NoiseSpread:
    """The covariance of x' = A x + w, from rest, after ``duration_s``, and its integral until then.

    >>> walk = spread_noise(np.zeros((1, 1)), np.eye(1), 3.0)                # variances t, and t^2 / 2
    >>> round(walk.covariance.item(), 12), round(walk.dwell.item(), 12)
    (3.0, 4.5)
    """
    if not len(A):
        return NoiseSpread(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)))
    size = float(np.linalg.norm(A, 2)) * duration_s
    halvings = max(0, int(np.ceil(np.log2(size)))) if size > 0.0 else 0
    h = duration_s / 2.0**halvings
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    t = 0.5 * h * (nodes + 1.0)
    along = np.asarray(sla.expm(t[:, None, None] * A))
    # Noise of t ago has acted for t.
    each = 0.5 * h * weights[:, None, None] * (along @ V @ along.transpose(0, 2, 1))
    step = np.asarray(sla.expm(h * A))
    covariance, dwell = each.sum(axis=0), np.tensordot(h - t, each, axes=1)
    for _ in range(halvings):
        dwell = dwell + h * covariance + step @ dwell @ step.T
        covariance = covariance + step @ covariance @ step.T
        step, h = step @ step, 2.0 * h
    return NoiseSpread(step, (covariance + covariance.T) / 2.0, (dwell + dwell.T) / 2.0)


def integrate_along(
    A: Float[np.ndarray, "state state"], Q: Float[np.ndarray, "state state"], duration_s: float
) -> Float[np.ndarray, "state state"]:
    """The integral of exp(A' t) Q exp(A t): the cost x' Q x over ``duration_s`` is x(0)' (this) x(0)."""
    return spread_noise(A.T, Q, duration_s).covariance
