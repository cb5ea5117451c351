"""Weights of a fit: the measured variance, and a variance for the model's error.

A variance from few periods has few degrees of freedom, and lines that are quiet by chance would dominate the
fit. It is therefore averaged over neighbouring lines, except where fewer lines have significantly more: noise
of a measured input and motion from disturbances peak where the response does. For whole periods the noise of
the outputs is averaged; the part that each line's inputs let into its response is known (`_inverse_power`).

A model of limited order, or a slightly nonlinear article, leaves more than this variance. The excess is one
further variance e P with one share e for all lines and outputs (with a share for each, a fit could give up an
output and then weigh it less), solved from

    sum |r|^2 / (v + e P) = number of lines   (Paule and Mandel 1982).

P is the mean square response of the output, or for the logarithmic cost |H|^2 of each line, which gives peaks
and antiresonances equal weight. Where the excess is large, the measured variance counts for a tenth only
(`ExcessVariance.even`), so that a line of mostly noise still weighs less.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float
from scipy.special import gammainccinv

from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Half width of the average over lines.
NEIGHBOURS = 10
# Half widths tried after it: noise that an article filters peaks where it does, within a line or two.
NARROWER = (3, 1, 0)
# Probability that a line's own variance is taken by chance.
BY_CHANCE = 1e-3
# Share of the variance that still weighs lines of a model that leaves more than it: the quietest lines would
# otherwise rule what the model follows, and where a structure is loudest its distortion is, too.
EVEN = 0.1
# Scatter of the logarithm of a variance below which it is taken as known: that of 100 degrees of freedom.
NO_SCATTER = 0.01
# `FrequencyResponse.alike` of lines that share nothing, as those of whole periods.
INDEPENDENT = 1.0
# Smallest variance, as a share of the mean square response: rounding of double precision data.
ROUNDING = 1e-22


@record(kw_only=True)
class ExcessVariance:
    """Sources of a residual: measured variance v, and the size P of what a model must follow.

    ``relative``: P is the size of each line, not of the output. If the residual is noise alone, |r|^2 / v
    has a ``mean`` above one, as v has few degrees of freedom, and over all lines the relative deviation
    ``chance``. ``alike`` lines have much the same noise and count as one.
    """

    variance: Float[np.ndarray, "output line input"]
    size: Float[np.ndarray, "output line input"]
    relative: bool = False
    chance: float = 0.0
    mean: float = 1.0
    alike: float = 1.0

    def at(self, share: float) -> Float[np.ndarray, "output line input"]:
        """v + share P."""
        return self.variance + share * self.size

    @property
    def even(self) -> ExcessVariance:
        """The same with most of the variance left out: for a model that does not reach it.

        A relative spread stays: without its variance, lines that are all noise would weigh most.
        """
        return self if self.relative else dataclasses.replace(self, variance=EVEN * self.variance)


def by_output(x: np.ndarray) -> np.ndarray:
    """[line, output, input] as fits have it, [output, line, input]: each output is a problem of its own."""
    return np.swapaxes(x, 0, 1)


def averaged(x: np.ndarray) -> np.ndarray:
    """Complex numbers of each line (first axis), averaged over neighbours."""
    width = min(2 * NEIGHBOURS + 1, len(x))
    re, im = (
        scipy.ndimage.uniform_filter1d(p, width, axis=0, mode="mirror") for p in (np.real(x), np.imag(x))
    )
    return re + 1j * im


def averaged_covariance(
    C: Complex[np.ndarray, "line channel channel"], degrees: float
) -> Complex[np.ndarray, "line channel channel"]:
    """C, known on each line with so many ``degrees``: correlations of the average, variances of `_smooth`."""
    found = averaged(C)
    own = _smooth(np.real(np.linalg.diagonal(C)).T[:, :, None], degrees)[:, :, 0].T
    wide = np.real(np.linalg.diagonal(found))
    more = np.sqrt(own / np.maximum(wide, np.finfo(float).tiny))
    return more[:, :, None] * found * more[:, None, :]


def spread_of(measured: FrequencyResponse, *, relative: bool) -> ExcessVariance:
    """Variance averaged over neighbouring lines, and the size of the output or (relative) of the line."""
    H = by_output(measured.H)
    power = np.broadcast_to(np.mean(np.abs(H) ** 2, axis=(1, 2), keepdims=True), H.shape)
    degrees = line_degrees(measured)
    variance = ROUNDING * power
    if measured.variance is not None:
        own = _inverse_power(measured)
        even = by_output(measured.variance / own)
        variance = variance + by_output(own) * _smooth(even, degrees, measured.alike or 1.0)
    # |r|^2 / E |r|^2 scatters by one, and v, a gamma variate, by one over the root of its degrees.
    alike = measured.alike or 1.0
    chance = np.sqrt((1.0 + 1.0 / degrees) * alike / H.size)
    size = np.abs(H) ** 2 if relative else power
    mean = inverse_bias(averaged_degrees(measured))
    return ExcessVariance(
        variance=variance, size=size, relative=relative, chance=float(chance), mean=mean, alike=alike
    )


def _inverse_power(measured: FrequencyResponse) -> Float[np.ndarray, "line 1 input"]:
    """The exactly known factor of each line's variance, by which inputs drive it; one where lines are alike.

    Experiments of random phases can hardly tell some lines' inputs apart: what varies by this factor is no
    scatter of the estimated noise, and an average over lines would make those lines seem as good as others.
    """
    if measured.covariance is None or measured.alike != INDEPENDENT:
        return np.ones((len(measured.H), 1, measured.H.shape[2]))
    return np.real(np.linalg.diagonal(measured.covariance.inverse_power))[:, None, :]


def _smooth(v: Float[np.ndarray, "output line input"], degrees: float, alike: float = 1.0) -> np.ndarray:
    """An average over lines, no less than fewer of them show beyond chance."""
    smooth = wide = _mean_of_lines(v, NEIGHBOURS)
    for half in (h for h in NARROWER if degrees < np.inf):
        # Gamma variates: what fewer lines say, where it is more than chance.
        known = degrees * max((2 * half + 1) / alike, 1.0)
        chance = float(gammainccinv(known, BY_CHANCE)) / known
        near = _mean_of_lines(v, half)
        smooth = np.where(near > chance * wide, np.maximum(near, smooth), smooth)
    # A variance as well known on each line stands where it is more, as that of a local model is at a peak.
    return np.maximum(smooth, v) if degrees >= 2 * NEIGHBOURS + 1 else smooth


def _mean_of_lines(v: Float[np.ndarray, "output line input"], half: int) -> np.ndarray:
    half = min(half, v.shape[1] - 1)
    padded = np.pad(v, ((0, 0), (half, half), (0, 0)), mode="reflect")
    total: np.ndarray = np.cumsum(np.pad(padded, ((0, 0), (1, 0), (0, 0))), axis=1)
    width = 2 * half + 1
    # Differences of sums can round below zero.
    return np.maximum(total[:, width:] - total[:, :-width], 0.0) / width


def line_degrees(measured: FrequencyResponse) -> float:
    """Complex degrees of freedom of the variance on one line, from its scatter between neighbours.

    An estimate of nu complex degrees scatters as a gamma variate of shape nu, whose logarithm has the
    variance trigamma(nu) = 1 / nu + 1 / (2 nu^2) + ... Infinite for a variance that does not scatter. Lines
    that are alike do not scatter: those are compared that stand so far apart.
    """
    lag = int(np.ceil(measured.alike or 1.0))
    if measured.variance is None or len(measured.H) <= lag:
        return float("inf")
    even = measured.variance / _inverse_power(measured)
    known = np.log(np.maximum(even[:, :, 0], np.finfo(float).tiny))
    scatter = 0.5 * float(np.mean((known[lag:] - known[:-lag]) ** 2))
    nu = 0.5 * (1.0 + np.sqrt(1.0 + 2.0 * scatter)) / max(scatter, NO_SCATTER)
    return max(float(nu), 1.0) if scatter > NO_SCATTER else float("inf")


def averaged_degrees(measured: FrequencyResponse) -> float:
    """Complex degrees of freedom of the variance averaged over neighbouring lines."""
    return line_degrees(measured) * max(
        min(2 * NEIGHBOURS + 1, len(measured.H)) / (measured.alike or 1.0), 1.0
    )


def inverse_bias(degrees: float) -> float:
    """Mean of 1 / v over that of v, a gamma variate of so many degrees."""
    return 1.0 if np.isinf(degrees) else degrees / max(degrees - 1.0, 1.0)


def excess_share(residual: Complex[np.ndarray, "output line input"], spread: ExcessVariance) -> float:
    """The share e that the model leaves beyond the variance; zero where nothing is left."""
    power = np.abs(residual) ** 2
    if np.mean(power / spread.variance) <= 1.0:
        return 0.0
    # At e = max |r|^2 / P every term is below one: the root lies below; in units of that, for any size.
    top = float(np.max(power / np.maximum(spread.size, np.finfo(float).tiny)))

    def beyond_one(e: float) -> float:
        return float(np.mean(power / spread.at(e * top))) - 1.0

    share: Any = scipy.optimize.brentq(beyond_one, 0.0, 1.0, xtol=1e-12)
    return top * float(share)
