"""Maximum likelihood: the residual weighed with the covariance of all outputs and inputs, line by line.

A weighted fit takes the entries of H for independent. They are not: outputs share noise, inputs that are not
orthogonal share an output's noise, and the noise of a measured input comes through all outputs at once. With
E[dH_oi conj(dH_pj)] = C_op R_ij the likelihood's cost is sum tr(C^-1 (H - E) R^-T (H - E)^H) (Pintelon and
Schoukens 2012, ch. 9 and 12; C holds sigma_y^2 + |G|^2 sigma_u^2 - 2 Re(conj(G) sigma_yu) of noisy inputs).
C from few periods is uncertain, so that it is averaged over neighbouring lines, its variances as the weights
are (`weights`); what the model cannot follow
adds a variance of its own to each output, as in a weighted fit, estimated anew after each round.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float

from middeck.errors import FitError
from middeck.identification.levenberg_marquardt import search
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import residual_of
from middeck.identification.search.least_squares_costs import weighted
from middeck.identification.search.pole_bounds import bound_theta, bounded
from middeck.identification.search.refine_and_reweigh import Polished
from middeck.identification.spectra.excess_variance import ROUNDING, averaged_covariance
from middeck.systems.plants.response import ResponseCovariance
from middeck.values import record

# Rounds of a search and new weights: the excess of a weighted fit is a good first one.
ROUNDS = 3
# Smallest eigenvalue of a correlation matrix: below it channels that err together cannot be distinguished.
ALIKE = 1e-9


@record
class Noise:
    """C averaged over lines with R of unit mean diagonal, the whitening of R, and the outputs' size."""

    C: Complex[np.ndarray, "line output output"]
    white: Complex[np.ndarray, "line input input"]
    size: Float[np.ndarray, " output"]

    def mix(self, share: float) -> Complex[np.ndarray, "line output output"]:
        """The matrix that makes residuals of this covariance and share of excess white, of variance one."""
        return np.linalg.inv(np.linalg.cholesky(self.C + np.diag(share * self.size)))


def noise_of(data: Data, covariance: ResponseCovariance, degrees: float, *, independent: bool) -> Noise:
    """Noise of a response for whitening; ``degrees`` of freedom are those of its variance on a line.

    For ``independent`` lines only the outputs' noise is averaged over lines: R of each line is known.
    Raises `FitError` if outputs, or inputs, have fully correlated noise: their difference would rule the fit.
    """
    size = np.mean(np.abs(data.H) ** 2, axis=(1, 2))
    power = np.real(np.einsum("lii->l", covariance.inverse_power)) / covariance.inverse_power.shape[1]
    own, shared = (power, 1.0) if independent else (1.0, power)
    C = covariance.outputs * np.reshape(shared, (-1, 1, 1))
    C = averaged_covariance(C, degrees) * np.reshape(own, (-1, 1, 1)) + np.diag(ROUNDING * size)
    _refuse_alike(C, "outputs", "leave out an output that is another, or record more periods")
    _refuse_alike(covariance.inverse_power, "inputs", "experiments with independent inputs")
    # Rows h of H with E[h^T conj(h)] = L L^H are white times L^-T.
    lower = np.linalg.cholesky(covariance.inverse_power / power[:, None, None])
    return Noise(C, np.linalg.inv(lower).mT, size)


def likelihood_polish(
    data: Data, start: Polished, covariance: ResponseCovariance, degrees: float, *, independent: bool
) -> Polished:
    """The likeliest model from a weighted fit's."""
    layout, best = start.layout, start
    noise = noise_of(data, covariance, degrees, independent=independent)
    white = dataclasses.replace(
        data, H=_white(data.H, noise), drive=noise.white, weight=np.ones(data.H.shape)
    )
    left = _white(residual_of(layout, data, best.refined.theta, best.refined.step.linear), noise)
    for _ in range(ROUNDS):
        share = _excess(left, noise)
        mixed = dataclasses.replace(white, mix=noise.mix(share))
        found = search(
            bounded(layout, mixed, functools.partial(weighted, layout, mixed)),
            best.refined.theta,
            exactly=bounded(layout, mixed, functools.partial(weighted, layout, mixed, from_sums=False)),
        )
        if found is None:
            return best
        found = dataclasses.replace(found, theta=bound_theta(layout, mixed, found.theta))
        left = residual_of(layout, white, found.theta, found.step.linear)
        value = float(np.sum(np.abs(_mixed(mixed.mix, left)) ** 2) - 2.0 * _log_size(mixed.mix, left))
        best = dataclasses.replace(best, refined=found, share=share, likelihood=value)
    return best


def _refuse_alike(C: Complex[np.ndarray, "line channel channel"], what: str, hint: str) -> None:
    size = np.sqrt(np.real(np.linalg.diagonal(C)))
    least = np.min(np.linalg.eigvalsh(C / size[:, :, None] / size[:, None, :]))
    if least < ALIKE:
        raise FitError(f"the noise of some {what} is that of the others", hint=f"{hint}, or cost 'weighted'")


def _white(rows: Complex[np.ndarray, "output line input"], noise: Noise) -> np.ndarray:
    return np.einsum("oli,lij->olj", rows, noise.white)


def _mixed(mix: np.ndarray | None, left: np.ndarray) -> np.ndarray:
    return left if mix is None else np.einsum("lqo,olk->qlk", mix, left)


def _excess(left: Complex[np.ndarray, "output line column"], noise: Noise) -> float:
    """The share e that the model leaves beyond the noise; zero where nothing is left."""

    def beyond_one(share: float) -> float:
        return float(np.mean(np.abs(_mixed(noise.mix(share), left)) ** 2)) - 1.0

    if beyond_one(0.0) <= 0.0:
        return 0.0
    top = float(np.max(np.mean(np.abs(left) ** 2, axis=2) / noise.size[:, None])) * len(left)
    share: Any = scipy.optimize.brentq(beyond_one, 0.0, top, xtol=1e-9 * top)
    return float(share)


def _log_size(mix: np.ndarray | None, left: np.ndarray) -> float:
    return 0.0 if mix is None else left.shape[2] * float(np.sum(np.log(np.linalg.det(mix).real)))
