"""The model a fit returns: poles, modal vectors, a direct term and exact delays."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Share of the largest singular value below which another of a matrix is rounding.
RANK = 1e-10
# Share of half the sampling rate below which a pole may be a mode.
BELOW_NYQUIST = 0.98


@record(kw_only=True)
class MeasurementModel:
    """A transfer matrix by its poles and rank-one residues, with a delay for each output or path.

    H_oi = exp(-s tau_oi) [ sum_m c_om b_mi / (q - lambda_m) + the conjugate of each pair
    + (R + L)_oi / s^2 + Q_oi / s + D_oi ], with q = s and lambda = pole in continuous time, q = exp(s T) and
    lambda = exp(pole T) if sampled.

    Attributes:
        poles: One of each conjugate pair (positive imaginary part), or a real pole [rad/s], also of a sampled
            model; a sampled pole on the negative real axis has the imaginary part pi / T and is single. A
            residue of higher rank has its pole as often as its rank.
        shapes: Output vectors c; the residue of ``poles[m]`` is ``shapes[:, m]`` times ``participation[m]``.
        participation: Input vectors b.
        direct: Constant term D: also what modes above the band leave in it.
        lower: L, what modes below the band leave in it; zero unless asked for. No part of a plant.
        delay_s: Delay of each output [s], exact in responses, a Pade approximation only in a plant
            (`plants`).
        sample_hz: None for a continuous model; else the rate at which its inputs are held and outputs
            sampled.
        path_delay_s: Delay of each path beyond its output's ``delay_s`` [s]; None for none.
        rigid: R = Phi Psi of free rigid-body modes, two states at zero for each of its rank; None without.
        integral: Q of integrators, one state at zero for each of its rank; None without.
        hold_s: Period over which the inputs of a continuous model's data were held [s]: that hold is taken
            out, and the model is of what is behind it. Zero where they were not held. None where that is
            not known: if they were, half a period is in the delays.
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
    integral: Float[np.ndarray, "output input"] | None = None
    hold_s: float | None = None

    @property
    def is_pair(self) -> np.ndarray:
        """True for each mode that stands for a conjugate pair."""
        return ~is_single(self.poles, self.sample_hz)

    @property
    def states(self) -> int:
        """Order without the delays: two for each pair or rigid mode, one for a real pole or integrator."""
        return int(np.sum(np.where(self.is_pair, 2, 1))) + 2 * rank_of(self.rigid) + rank_of(self.integral)


def rank_of(matrix: Float[np.ndarray, "output input"] | None) -> int:
    """Rank of R or Q: how many rigid modes or integrators; zero of None.

    >>> rank_of(None), rank_of(np.ones((2, 2)))
    (0, 1)
    """
    return 0 if matrix is None else int(np.linalg.matrix_rank(matrix, rtol=RANK))


def is_single(value: Complex[np.ndarray, " value"], sample_hz: float | None) -> Bool[np.ndarray, " value"]:
    """Whether each value [rad/s] is real in s, or in z = exp(s T) of a sampled model."""
    imag = np.imag(value)
    if sample_hz is None:
        return imag == 0.0
    return (imag == 0.0) | (imag >= np.pi * sample_hz * (1.0 - 1e-9))


@named_kinds
def model_response(
    model: MeasurementModel, frequency_hz: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """Response at ``frequency_hz`` with the exact delay.

    Raises `ConfigError` for a frequency that is not finite.
    """
    f = np.asarray(frequency_hz, dtype=float)
    if not np.all(np.isfinite(f)):
        raise ConfigError("a frequency is not finite", hint="numbers, in Hz")
    s = 2j * np.pi * f
    return rational_response(model, s) * np.exp(-s[:, None, None] * path_delay(model))


def evaluate_model(model: MeasurementModel, frequency_hz: Float[np.ndarray, " line"]) -> FrequencyResponse:
    """`model_response` with the ports of the model."""
    H = model_response(model, frequency_hz)
    return FrequencyResponse(frequency_hz=frequency_hz, H=H, inputs=model.inputs, outputs=model.outputs)


def rational_response(
    model: MeasurementModel, s: Complex[np.ndarray, " point"]
) -> Complex[np.ndarray, "point output input"]:
    """The response without its delays, anywhere in the plane."""
    terms = _terms(model, s)
    H = (terms.along @ terms.ahead + terms.both @ terms.still).reshape(-1, *model.direct.shape) + model.direct
    double = double_pole(model)
    at_zero = 0.0 if model.integral is None else model.integral / s[:, None, None]
    return H + at_zero + double / s[:, None, None] ** 2 if np.any(double) else H + at_zero


def rational_slope(
    model: MeasurementModel, s: Complex[np.ndarray, " point"]
) -> Complex[np.ndarray, "point output input"]:
    """Derivative by s of `rational_response`."""
    terms = _terms(model, s)
    slope = (terms.both - terms.along * terms.fall) @ terms.ahead - (terms.both * terms.fall) @ terms.still
    slope = slope.reshape(-1, *model.direct.shape) * terms.by_s[:, None, None]
    double = double_pole(model)
    slope = slope if model.integral is None else slope - model.integral / s[:, None, None] ** 2
    return slope - 2.0 * double / s[:, None, None] ** 3 if np.any(double) else slope


@record(kw_only=True)
class _Terms:
    """The modes as ahead (q - Re lambda) / N + still / N, N = (q - lambda)(q - conj lambda).

    With the residue R of a pair, ahead = 2 Re R and still = -2 Im lambda Im R: its two fractions alone would
    cancel near critical damping, where R grows beyond all bounds. A single pole is ahead / (q - lambda).
    ``fall`` is -dN/dq / N, ``by_s`` dq/ds.
    """

    along: Complex[np.ndarray, "point mode"]
    both: Complex[np.ndarray, "point mode"]
    fall: Complex[np.ndarray, "point mode"]
    by_s: Complex[np.ndarray, " point"]
    ahead: Float[np.ndarray, "mode entry"]
    still: Float[np.ndarray, "mode entry"]


def _terms(model: MeasurementModel, s: np.ndarray) -> _Terms:
    T = 0.0 if model.sample_hz is None else 1.0 / model.sample_hz
    q, pole = (np.exp(s * T), np.exp(model.poles * T)) if T else (s, model.poles)
    pair, modes = model.is_pair, len(model.poles)
    R = model.shapes.T[:, :, None] * model.participation[:, None, :]
    ahead = np.where(pair, 2.0, 1.0)[:, None, None] * np.real(R)
    still = np.where(pair, -2.0 * np.imag(pole), 0.0)[:, None, None] * np.imag(R)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = 1.0 / (q[:, None] - pole)
        second = np.where(pair, 1.0 / (q[:, None] - pole.conj()), 0.0)
        along = np.where(pair, (q[:, None] - np.real(pole)) * first * second, first)
    entries = int(model.direct.size)
    return _Terms(
        along=along,
        both=first * second,
        fall=first + second,
        by_s=T * q if T else np.ones_like(q),
        ahead=ahead.reshape(modes, entries),
        still=still.reshape(modes, entries),
    )


def double_pole(model: MeasurementModel) -> Float[np.ndarray, "output input"]:
    """R + L, all that goes with 1/s^2."""
    return model.lower if model.rigid is None else model.lower + model.rigid


def single_pole(model: MeasurementModel) -> Float[np.ndarray, "output input"]:
    """Q, all that goes with 1/s."""
    return np.zeros(model.direct.shape) if model.integral is None else model.integral


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


def is_mode(model: MeasurementModel, sample_hz: float) -> Bool[np.ndarray, " mode"]:
    """Whether each pole may be a mode of a system sampled at this rate: clearly below half of it.

    A pole near z = -1, on the negative real axis or over within a sample is none: it stands for a delay, a
    filter or what is beyond half the rate.

    >>> port, one = (Port("x", "1"),), np.ones((1, 2))
    >>> poles = np.log([0.9 * np.exp(0.5j), -0.3 + 0j])
    >>> model = MeasurementModel(
    ...     poles=poles, shapes=one, participation=one.T, direct=[[0.0]], lower=[[0.0]], delay_s=[0.0],
    ...     inputs=port, outputs=port, sample_hz=1.0)
    >>> is_mode(model, 1.0).tolist()
    [True, False]
    """
    return natural_hz(model) < BELOW_NYQUIST * 0.5 * sample_hz
