"""A measured response, and what scatters it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.systems.response import ResponseCovariance
from middeck.values import record as frozen


@frozen
class ResponseScatter:
    """A measured response with what scatters it.

    Parameters
    ----------
    H:
        Estimate on the excited lines ``frequency_hz``.
    noise:
        Variance of H from the scatter over periods: what does not repeat. None without several periods.
    total:
        Variance of H with all that scatters it: noise and the part of nonlinear distortion that changes with
        the signal (Pintelon and Schoukens 2012, ch. 4). From the scatter over experiments, or from what local
        models and averages leave. None where neither can tell.
    noise_dof, total_dof:
        Complex degrees of freedom nu of the two at each line: 2 nu (estimate / truth) is chi-square
        distributed with 2 nu degrees of freedom, where noise is normal. Several lines of a local model share
        their data, so these do not add up over lines.
    noise_covariance, total_covariance:
        C[line, output, output]: of the outputs' noise that is not response to the inputs.
    inverse_power:
        R[line, input, input]: E[dH_oi conj(dH_pj)] = C_op R_ij. Of local rational models it holds on the
        diagonal, and off it with the correlation of the outputs' noise.

    Variances are of the complex number: real and imaginary part together.
    """

    frequency_hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, "line output input"]
    noise: Float[np.ndarray, "line output input"] | None
    total: Float[np.ndarray, "line output input"] | None
    noise_dof: Float[np.ndarray, " line"] | None
    total_dof: Float[np.ndarray, " line"] | None
    noise_covariance: Complex[np.ndarray, "line output output"] | None
    total_covariance: Complex[np.ndarray, "line output output"] | None
    inverse_power: Complex[np.ndarray, "line input input"]

    @property
    def distortion(self) -> Float[np.ndarray, "line output input"] | None:
        """The part of ``total`` that noise does not explain: stochastic nonlinear distortion."""
        if self.noise is None or self.total is None:
            return None
        return np.maximum(self.total - self.noise, 0.0)


def variance_of(
    covariance: Complex[np.ndarray, "line output output"],
    inverse_power: Complex[np.ndarray, "line input input"],
) -> Float[np.ndarray, "line output input"]:
    """C_oo R_ii of each line."""
    outputs, inputs = (np.maximum(np.real(np.einsum("kaa->ka", x)), 0.0) for x in (covariance, inverse_power))
    return outputs[:, :, None] * inputs[:, None, :]


def trusted(
    found: ResponseScatter,
) -> tuple[Float[np.ndarray, "line output input"] | None, ResponseCovariance | None]:
    """The variance a weighted fit should use, total where it is known, and the covariance with it."""
    variance, covariance = (
        (found.noise, found.noise_covariance)
        if found.total is None
        else (found.total, found.total_covariance)
    )
    if variance is None or covariance is None:
        return None, None
    # A denominator adds to the variance of local rational models: outputs' noise is scaled up to it.
    known = variance_of(covariance, found.inverse_power)
    scale = np.sqrt(variance.sum(axis=2) / np.maximum(known.sum(axis=2), np.finfo(float).tiny))
    together = scale[:, :, None] * covariance * scale[:, None, :]
    return variance, ResponseCovariance(together, found.inverse_power)
