"""The variance of each line of a measured response, by the source of its scatter."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import gammainccinv

from middeck.identification.spectra.excess_variance import BY_CHANCE, NEIGHBOURS, averaged
from middeck.systems.plants.response import ResponseCovariance
from middeck.values import record as frozen


@frozen(kw_only=True)
class ResponseScatter:
    """A measured response with the sources of its scatter.

    Attributes:
        H: Estimate on the excited lines ``frequency_hz``.
        noise: Variance of H from the scatter over periods: what does not repeat. None without several
            periods.
        total: Variance of H with all that scatters it: noise and the part of nonlinear distortion that
            changes with the signal (Pintelon and Schoukens 2012, ch. 4), estimated from the scatter over
            experiments or from residuals of local models and averages. None if neither is known.
        noise_dof, total_dof: Complex degrees of freedom nu of the two at each line: 2 nu (estimate / truth)
            is chi-square distributed with 2 nu degrees of freedom, where noise is normal. Several lines of a
            local model share their data, so these do not add up over lines.
        noise_covariance, total_covariance: C[line, output, output]: of the outputs' noise that is not
            response to the inputs.
        inverse_power: R[line, input, input]: E[dH_oi conj(dH_pj)] = C_op R_ij. For local rational models
            this holds on the diagonal, and off it with the correlation of the outputs' noise.
        line_inverse_power: R of each line's own data, for uses that take lines as independent. None if they
            are. Neighbouring lines of local models share their data, and ``inverse_power`` is smaller by the
            number of lines that are shared.
        warnings: How periods were corrected that were not steady.
        changes: Warnings on gains and delays that change over the periods.
        commanded: Whether the inputs repeat to the last digits, as commands do and measured ones do not.

    Variances are of the complex number: real and imaginary part together.
    """

    frequency_hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, "line output input"]
    noise: Float[np.ndarray, "line output input"] | None = None
    total: Float[np.ndarray, "line output input"] | None = None
    noise_dof: Float[np.ndarray, " line"] | None = None
    total_dof: Float[np.ndarray, " line"] | None = None
    noise_covariance: Complex[np.ndarray, "line output output"] | None = None
    total_covariance: Complex[np.ndarray, "line output output"] | None = None
    inverse_power: Complex[np.ndarray, "line input input"]
    line_inverse_power: Complex[np.ndarray, "line input input"] | None = None
    warnings: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()
    commanded: bool = False

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
    outputs, inputs = (np.maximum(np.real(np.linalg.diagonal(x)), 0.0) for x in (covariance, inverse_power))
    return outputs[:, :, None] * inputs[:, None, :]


def trusted(
    found: ResponseScatter,
) -> tuple[Float[np.ndarray, "line output input"] | None, ResponseCovariance | None]:
    """The variance for a fit whose lines count as independent, total where known, and its covariance.

    A sum over lines of |H - model|^2 / variance then has as much information as the data. Neighbouring
    estimates of a local model err together: their own, smaller variances would count it several times.
    """
    covariance = found.noise_covariance if found.total is None else _with_noise(found)
    if covariance is None:
        return None, None
    R, own = found.inverse_power, found.line_inverse_power
    if own is None or found.total is None:
        return variance_of(covariance, R), ResponseCovariance(covariance, R)
    # The smaller of the two counts the lines that share data; a denominator adds its own variance.
    least = np.minimum(*(np.real(np.linalg.diagonal(x)) for x in (R, own)))
    known = np.real(np.linalg.diagonal(covariance))[:, :, None] * least[:, None, :]
    more = np.sqrt(np.max(found.total / np.maximum(known, np.finfo(float).tiny), axis=2, initial=1.0))
    covariance = covariance * more[:, :, None] * more[:, None, :]
    return variance_of(covariance, own), ResponseCovariance(covariance, own)


def _with_noise(found: ResponseScatter) -> Complex[np.ndarray, "line output output"] | None:
    """The total covariance; where it is significantly below the noise's, the missing noise is added.

    The scatter over a few experiments may be smaller by chance than their noise. Free motion that has not
    decayed differs between experiments too.
    """
    total, noise = found.total_covariance, found.noise_covariance
    if total is None or noise is None or found.total_dof is None:
        return total
    seen, least = (np.real(averaged(np.linalg.diagonal(x))) for x in (total, noise))
    known = found.total_dof[:, None] * min(2 * NEIGHBOURS + 1, len(total))
    most = seen * gammainccinv(known, BY_CHANCE) / known
    lacks = np.sqrt(np.clip(1.0 - most / np.maximum(least, np.finfo(float).tiny), 0.0, 1.0))
    return total + lacks[:, :, None] * noise * lacks[:, None, :]
