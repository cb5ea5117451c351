"""Standard deviations of frequency, damping and delay: the Cramer-Rao bound at the fit."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.identification.terms import Layout, unpack
from middeck.values import record


@record
class Uncertainty:
    """Standard deviations, as far as the residual behaves as random noise of the weights' variance.

    Parameters
    ----------
    natural_hz, damping:
        Of the natural frequency [Hz] and the damping ratio of each mode.
    delay_s:
        Of the delay of each output [s]; zero where no delay was fitted.
    """

    natural_hz: Float[np.ndarray, " mode"]
    damping: Float[np.ndarray, " mode"]
    delay_s: Float[np.ndarray, " output"]


def bound(
    layout: Layout, theta: Float[np.ndarray, " unknown"], gram: Float[np.ndarray, "unknown unknown"]
) -> Uncertainty:
    """The bound from the normal equations of theta with all other unknowns projected out.

    A weight is one over the standard deviation of a complex number, whose real and imaginary parts have half
    its variance each, so that the covariance is half the inverse of ``gram``.
    """
    covariance = 0.5 * _inverse(gram)
    modes, pairs = len(layout.pair), int(np.sum(layout.pair))
    poles = unpack(layout, theta).poles
    sigma, omega = -np.real(poles), np.imag(poles)
    size = np.abs(poles)
    # By log sigma and log omega_d: d size and d (sigma / size).
    frequency = np.zeros((modes, len(theta)))
    damping = np.zeros((modes, len(theta)))
    frequency[np.arange(modes), np.arange(modes)] = sigma**2 / size
    damping[np.arange(modes), np.arange(modes)] = sigma * omega**2 / size**3
    first = np.arange(pairs)
    frequency[first, modes + first] = omega[:pairs] ** 2 / size[:pairs]
    damping[first, modes + first] = -sigma[:pairs] * omega[:pairs] ** 2 / size[:pairs] ** 3
    tail = (
        np.diag(covariance)[len(theta) - layout.outputs :] if layout.with_delay else np.zeros(layout.outputs)
    )
    return Uncertainty(
        _deviation(frequency, covariance) / (2.0 * np.pi), _deviation(damping, covariance), np.sqrt(tail)
    )


def _inverse(gram: np.ndarray) -> np.ndarray:
    size = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    return size[:, None] * np.linalg.pinv(gram * size[:, None] * size, hermitian=True) * size


def _deviation(slope: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", slope, covariance, slope), 0.0))
