"""Data of a fit: a frequency response, or the spectra of experiments with their transients."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from middeck.identification.spectra.excess_variance import ExcessVariance, by_output
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# A start is weighted as if the model left this share of the response's rms.
FIRST_EXCESS = 0.03
# Terms of drift and edges are one and the same, over a narrow band, up to this share.
ALIKE = 1e-9
# Alternating tails at each end: what three leave of the response is 1e-8 of it (of samples alone 1e-5).
TAILS = 3


@record
class Transient:
    """The part of a record's spectrum that is no response to its own input: initial and final motion.

    Attributes:
        period_s: Sampling period of the record [s].
        first, last: Numbers of arbitrary samples at the record's start and end: responses to inputs before
            the record (a delay of n samples needs n + 1), and to a band-limited input between samples.
        steady: Spectra of outputs that no input causes, such as the hum of the mains; None without.
    """

    period_s: float
    first: int = 0
    last: int = 0
    steady: Complex[np.ndarray, "column line"] | None = None

    def drift_and_edges(self, s: np.ndarray, degree: int) -> Complex[np.ndarray, "column line"]:
        """Basis of the spectra at ``s`` that depend on no pole, nearly dependent where the band is narrow.

        Drift, a ramp and to the second degree a parabola, each to the mean square of one; samples that may be
        anything; and what is steady.
        """
        inverse = np.exp(-s * self.period_s)
        ramp = 1.0 / (1.0 - inverse)
        drift = np.stack([ramp, inverse * ramp**2])[:degree]
        drift = drift / np.sqrt(np.mean(np.abs(drift) ** 2, axis=1, keepdims=True))
        samples = np.concatenate([np.arange(self.first), -1 - np.arange(self.last)])
        edges = inverse ** samples[:, None]
        steady = [] if self.steady is None else [self.steady]
        all_of_them = np.concatenate([drift, edges, *self._tails(inverse), *steady]).view(float)
        _, size, right = np.linalg.svd(all_of_them, full_matrices=False)
        return right[size > ALIKE * size[0]].view(complex)

    def _tails(self, inverse: Complex[np.ndarray, " line"]) -> list[Complex[np.ndarray, "tail line"]]:
        """Spectra of (-1)^n / n, (-1)^n / (n (n + 1)) and so on, on from the free samples of each end.

        A response is cut off at half the rate, where it is not zero: samples answer to some before and after
        them, those outside the record among them, alternating and as slowly fading as this. The series sum up
        to powers of 1 + x times log(1 + x), and to samples that are free.
        """
        ends = [(self.first, inverse), (self.last, inverse.conj())]
        powers = np.arange(TAILS)[:, None]
        return [x ** (free - 1) * (1.0 + x) ** powers * np.log1p(x) for free, x in ends if free]


@record(kw_only=True)
class Data:
    """The data to be fitted, at s = j omega.

    Attributes:
        H: The response, a column for each input; with a ``drive``, output spectra, a column for each
            experiment.
        weight: One over the standard deviation of H.
        drive: Spectra of the inputs in each experiment; None for a response.
        driven: Lines of a record that its inputs drive, among silent ones; None if all are driven.
        transient: Whether each column has a free transient with the poles of the model (`transient`).
        mix: Matrix that combines outputs with correlated noise before weighting; not with a transient.
    """

    s: Complex[np.ndarray, " line"]
    H: Complex[np.ndarray, "output line column"]
    weight: Float[np.ndarray, "output line column"]
    drive: Complex[np.ndarray, "line input column"] | None = None
    driven: Bool[np.ndarray, " line"] | None = None
    transient: Transient | None = None
    mix: Complex[np.ndarray, "line output output"] | None = None

    @functools.cached_property
    def weighted(
        self,
    ) -> tuple[Float[np.ndarray, "output column line"], Complex[np.ndarray, "output column line"]]:
        """Weights, and H times them, lines last: the order of all sums over lines."""
        w = np.ascontiguousarray(self.weight.mT)
        return w, w * self.H.mT

    def reweighted(self, weight: Float[np.ndarray, "output line column"]) -> Data:
        """The same with other weights, on which no term depends."""
        again = dataclasses.replace(self, weight=weight)
        again.__dict__["_drift_and_edges"] = self._drift_and_edges
        again.__dict__["at_latest_thetas"] = self.at_latest_thetas
        if self.transient is not None:
            again.__dict__["a_sample_late"] = self.a_sample_late
        return again

    @functools.cached_property
    def a_sample_late(self) -> Complex[np.ndarray, " line"]:
        """exp(-s T), the factor of a record's spectra for a delay of one sample."""
        assert self.transient is not None
        return np.exp(-self.s * self.transient.period_s)

    def drift_and_edges(self, degree: int) -> Complex[np.ndarray, "column line"]:
        """Terms of the transient that depend on no pole, to first or to second degree."""
        assert self.transient is not None
        if degree not in self._drift_and_edges:
            self._drift_and_edges[degree] = self.transient.drift_and_edges(self.s, degree)
        return self._drift_and_edges[degree]

    @functools.cached_property
    def _drift_and_edges(self) -> dict[int, Complex[np.ndarray, "column line"]]:
        return {}

    @functools.cached_property
    def at_latest_thetas(self) -> dict[bytes, Any]:
        """What was computed at the latest thetas and depends on no weight (`residual_and_slopes`)."""
        return {}

    @property
    def omega(self) -> Float[np.ndarray, " line"]:
        """Angular frequencies [rad/s]."""
        return np.imag(self.s)

    @property
    def spacing(self) -> float:
        """Least distance of two lines [rad/s]."""
        return float(np.min(np.diff(self.omega), initial=self.omega[-1]))

    @property
    def lines(self) -> Int[np.ndarray, " line"]:
        """Numbers of the lines, counted from zero frequency."""
        return np.round(self.omega / self.spacing).astype(int)

    @property
    def length_s(self) -> float:
        """Length of a record with these lines [s]."""
        return 2.0 * np.pi / self.spacing

    @property
    def U(self) -> Complex[np.ndarray, "line input column"]:
        """Spectra of a record's inputs: its ``drive``."""
        assert self.drive is not None
        return self.drive

    @property
    def period_s(self) -> float:
        """Sampling period of a record with a transient [s]."""
        assert self.transient is not None
        return self.transient.period_s


def data_of(measured: FrequencyResponse, spread: ExcessVariance) -> Data:
    """A response to be fitted, in the weights of a start."""
    weight = 1.0 / np.sqrt(spread.at(FIRST_EXCESS**2))
    return Data(s=2j * np.pi * measured.frequency_hz, H=by_output(measured.H), weight=weight)
