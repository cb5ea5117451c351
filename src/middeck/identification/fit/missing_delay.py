"""A test of whether a fit without delays lacks one.

With the fitted poles fixed, the other unknowns are linear and a delay only turns the data, so that delays are
tried for each output by least squares. A delay is missing, not a mode, if the response moved earlier is
fitted much better without a constant term (an acceleration: with one) than the unmoved response with one.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.model.fit_options import is_acceleration
from middeck.identification.model.measurement_model import MeasurementModel, double_pole
from middeck.identification.search.fit_warnings import LEFT
from middeck.identification.spectra.excess_variance import by_output
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.systems.plants.response import FrequencyResponse

# A delay is named where it leaves less than half of what is left without.
MUCH = 0.5
# Delays are tried up to this many periods of the last line, at so many in each, then as many about the best.
PERIODS, IN_PERIOD = 8, 16


def name_missing_delay(
    doubts: list[str],
    measured: FrequencyResponse,
    covariance: ModelCovariance,
    error: Float[np.ndarray, " output"],
) -> list[str]:
    """Add the delays that a poor model seems to need to its warnings, ``doubts``.

    They stand for the modes that it would seem to lack, and beside outputs that it leaves mostly unexplained.
    """
    model, structure = covariance.model, covariance.structure
    if not doubts or model.sample_hz is not None or structure.with_delay or structure.real_constants:
        return doubts
    degree = 0 if any(is_acceleration(port) for port in measured.outputs) else 1
    late = [
        f"output {port.name}: a delay of about {tau * 1e3:.3g} ms explains most of the {left:.1%} that the "
        f"model leaves; fit it, with --delay output --relative-degree {degree} (delay='output', "
        f"relative_degree={degree})"
        for port, left, tau in zip(measured.outputs, error, missing_delay(measured, model), strict=True)
        if tau > 0.0
    ]
    return [*doubts, *late] if np.any(error > LEFT) else late or doubts


def missing_delay(measured: FrequencyResponse, model: MeasurementModel) -> Float[np.ndarray, " output"]:
    """Delay [s] that each output seems to need; zero where none would help much.

    ``model`` is continuous and has no delay; a lead is not looked for.
    """
    s = 2j * np.pi * measured.frequency_hz
    moving = _basis(model, s)
    with_direct = np.column_stack([moving, np.ones(len(s))])
    found = [
        _of_output(s, with_direct if is_acceleration(port) else moving, with_direct, H)
        for port, H in zip(measured.outputs, by_output(measured.H), strict=True)
    ]
    return np.array(found)


def _of_output(s: np.ndarray, moving: np.ndarray, with_direct: np.ndarray, H: np.ndarray) -> float:
    last_s = 2.0 * np.pi / float(np.imag(s[-1]))
    q = np.linalg.qr(stack_parts(moving))[0]

    def left(tau: float) -> float:
        return _left(q, H * np.exp(s * tau)[:, None])

    step, coarse = last_s / IN_PERIOD, np.arange(1, PERIODS * IN_PERIOD + 1)
    near = step * float(min(coarse, key=lambda k: left(step * k)))
    best = float(min(near + step * np.linspace(-1.0, 1.0, IN_PERIOD + 1), key=left))
    return best if left(best) < MUCH**2 * _left(np.linalg.qr(stack_parts(with_direct))[0], H) else 0.0


def _left(q: Float[np.ndarray, "row column"], H: Complex[np.ndarray, "line input"]) -> float:
    """Sum of squares that least squares leave."""
    y = stack_parts(H)
    return float(np.sum((y - q @ (q.T @ y)) ** 2))


def stack_parts(x: Complex[np.ndarray, "line column"]) -> Float[np.ndarray, "row column"]:
    """Real parts above imaginary parts."""
    return np.concatenate([np.real(x), np.imag(x)])


def _basis(model: MeasurementModel, s: np.ndarray) -> Complex[np.ndarray, "line column"]:
    """Basis functions of a path without delay and constant term; its coefficients are real."""
    poles = np.unique(model.poles)
    pair = np.imag(poles) != 0.0
    first, second = 1.0 / (s[:, None] - poles), 1.0 / (s[:, None] - poles.conj())
    columns = [first + second, 1j * (first - second)[:, pair]]
    if model.integral is not None:
        columns.append(1.0 / s[:, None])
    if np.any(double_pole(model)):
        columns.append(1.0 / s[:, None] ** 2)
    basis = np.concatenate(columns, axis=1)
    return basis / np.linalg.norm(basis, axis=0)
