"""The model a fit returns: poles, modal vectors, a direct term and exact delays."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.systems.ports import Port
from middeck.values import record

# Share of the largest singular value below which another of a matrix is rounding.
RANK = 1e-10


@record
class MeasurementModel:
    """A transfer matrix by its poles and rank-one residues, with a delay for each output or path.

    H_oi = exp(-s tau_oi) [ sum_m c_om b_mi / (q - lambda_m) + the conjugate of each pair
    + (R + L)_oi / s^2 + D_oi ], with q = s and lambda = pole in continuous time, q = exp(s T) and
    lambda = exp(pole T) if sampled.

    Parameters
    ----------
    poles:
        One of each conjugate pair (positive imaginary part), or a real pole [rad/s], also of a sampled
        model; a sampled pole on the negative real axis has the imaginary part pi / T and is single. A residue
        of higher rank has its pole as often as its rank.
    shapes:
        Output vectors c; the residue of ``poles[m]`` is ``shapes[:, m]`` times ``participation[m]``.
    participation:
        Input vectors b.
    direct:
        Constant term D: also what modes above the band leave in it.
    lower:
        L, what modes below the band leave in it; zero unless asked for. No part of a plant.
    delay_s:
        Delay of each output [s], exact in responses, a Pade approximation only in a plant (`plants`).
    sample_hz:
        None for a continuous model; otherwise the rate at which its inputs are held and outputs sampled.
    path_delay_s:
        What each path is late beyond its output's ``delay_s`` [s]; None where that is all.
    rigid:
        R = Phi Psi of free rigid-body modes, two states at zero for each of its rank; None without.
    """

    poles: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "output mode"]
    participation: Complex[np.ndarray, "mode input"]
    direct: Float[np.ndarray, "output input"]
    lower: Float[np.ndarray, "output input"]
    delay_s: Float[np.ndarray, " output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    sample_hz: float | None = None
    path_delay_s: Float[np.ndarray, "output input"] | None = None
    rigid: Float[np.ndarray, "output input"] | None = None

    @property
    def is_pair(self) -> np.ndarray:
        """True for each mode that stands for a conjugate pair."""
        return ~is_single(self.poles, self.sample_hz)

    @property
    def states(self) -> int:
        """Order without the delays: two for each pair and each rigid mode, one for each real pole."""
        rigid = 0 if self.rigid is None else int(np.linalg.matrix_rank(self.rigid, rtol=RANK))
        return int(np.sum(np.where(self.is_pair, 2, 1))) + 2 * rigid


def is_single(value: Complex[np.ndarray, " value"], sample_hz: float | None) -> Bool[np.ndarray, " value"]:
    """Whether each value [rad/s] is real in s, or in z = exp(s T) of a sampled model."""
    imag = np.imag(value)
    if sample_hz is None:
        return imag == 0.0
    return (imag == 0.0) | (imag >= np.pi * sample_hz * (1.0 - 1e-9))


def model_response(
    model: MeasurementModel, frequency_hz: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """Response at ``frequency_hz`` with the exact delay."""
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    T = None if model.sample_hz is None else 1.0 / model.sample_hz
    q, pole = (s, model.poles) if T is None else (np.exp(s * T), np.exp(model.poles * T))
    c, b = model.shapes, model.participation
    sum_of_terms = (c / (q[:, None, None] - pole)) @ b
    pairs = np.flatnonzero(model.is_pair)
    sum_of_terms += (c[:, pairs].conj() / (q[:, None, None] - pole[pairs].conj())) @ b[
        pairs
    ].conj() + model.direct
    double = model.lower if model.rigid is None else model.lower + model.rigid
    if np.any(double):
        sum_of_terms += double / s[:, None, None] ** 2
    return sum_of_terms * np.exp(-s[:, None, None] * path_delay(model))


def path_delay(model: MeasurementModel) -> Float[np.ndarray, "output input"]:
    """Delay of each path [s]."""
    beyond = np.zeros(model.direct.shape) if model.path_delay_s is None else model.path_delay_s
    return model.delay_s[:, None] + beyond


def natural_hz(model: MeasurementModel) -> Float[np.ndarray, " mode"]:
    """Undamped natural frequency |pole| / 2 pi of each mode [Hz]."""
    return np.abs(model.poles) / (2.0 * np.pi)


def damping_ratio(model: MeasurementModel) -> Float[np.ndarray, " mode"]:
    """-Re pole / |pole| of each mode."""
    return -np.real(model.poles) / np.abs(model.poles)
