"""Figures 10a and 10b: one torque to payload, encoder and bus, fitted together by poles, zeros and delays."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.files.study_form import RigForm, SisoForm, SitoForm
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.measurement_model import model_response
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.zeros import Zeros, path_zeros
from middeck.identification.uncertainty.parameters import zero_deviation
from middeck.study.rig_experiment import in_band
from middeck.systems.plant import Plant
from middeck.systems.response import FrequencyResponse
from middeck.values import record


@record
class SensorZeros:
    """Zeros of the fitted path to one sensor.

    Parameters
    ----------
    frequency_deviation_hz, damping_deviation:
        Their standard deviations.
    mirrored_error:
        Relative complex error of the path in the band of the fit once its zeros of the right half-plane are
        put in the left, the sign of the gain left free; None where it has none.
    """

    zeros: Zeros
    frequency_deviation_hz: Float[np.ndarray, " zero"]
    damping_deviation: Float[np.ndarray, " zero"]
    mirrored_error: float | None


@record
class MeasuredSensors:
    """Three measured paths from one torque, one fit with common poles, its zeros and its design plant.

    Parameters
    ----------
    measured, fitted:
        Outputs: the performance, then the two sensors of Figures 10a and 10b.
    sensors:
        Zeros of each path, in the same order.
    delay_s:
        The rig's own.
    """

    fit_band_hz: tuple[float, float]
    measured: FrequencyResponse
    fit: FitResult
    fitted: FrequencyResponse
    sensors: tuple[SensorZeros, ...]
    plant: Plant
    delay_s: float


def study_measured_sensors(
    measured: FrequencyResponse, rig: RigForm, siso: SisoForm, sito: SitoForm
) -> MeasuredSensors:
    """Fit the three measured paths together and find the zeros of each."""
    banded = in_band(measured, sito.fit_band_hz)
    fit = fit_sensors(measured, sito.states, sito.fit_band_hz)
    H = model_response(fit.model, measured.frequency_hz)
    torque = (siso.actuator,)
    plant = measured_plant(
        fit.model, pade_order=sito.pade_order, w=torque, u=torque, z=(siso.sensor,), y=sito.sensors
    )
    return MeasuredSensors(
        sito.fit_band_hz,
        measured,
        fit,
        FrequencyResponse(measured.frequency_hz, H, measured.inputs, measured.outputs),
        tuple(_sensor_zeros(fit, banded, o) for o in range(len(measured.outputs))),
        plant,
        rig.delay_s,
    )


def fit_sensors(measured: FrequencyResponse, states: int | None, band_hz: tuple[float, float]) -> FitResult:
    """All paths in a band, by common poles and one delay; the data choose the order where none is given.

    Without a constant term, which a disturbance that is white would make infinite in the performance.
    """
    banded = in_band(measured, band_hz)
    return fit_response(banded, states=states, cost="logarithmic", delay="common", direct=False)


def _sensor_zeros(fit: FitResult, banded: FrequencyResponse, o: int) -> SensorZeros:
    output, torque = banded.outputs[o].name, banded.inputs[0].name
    zeros = path_zeros(fit.model, output, torque)
    deviation = zero_deviation(fit.covariance, zeros.value, output=output, input=torque)
    wrong = zeros.value[zeros.is_nonminimum_phase]
    fitted = model_response(fit.model, banded.frequency_hz)[:, o, 0]
    mirrored = fitted * mirroring(banded.frequency_hz, wrong)
    data = banded.H[:, o, 0]
    error = min(float(np.linalg.norm(sign * mirrored - data)) for sign in (1.0, -1.0))
    return SensorZeros(zeros, *deviation, error / float(np.linalg.norm(data)) if len(wrong) else None)


def mirroring(
    frequency_hz: Float[np.ndarray, " line"], zeros: Complex[np.ndarray, " zero"]
) -> Complex[np.ndarray, " line"]:
    """The all-pass that takes zeros [rad/s], one of each pair, to the other half-plane: only phase changes.

    >>> factor = mirroring(np.array([1.0]), np.array([2.0 * np.pi + 0.0j]))
    >>> bool(np.isclose(factor[0], -1j))
    True
    """
    s = 2j * np.pi * frequency_hz
    factor = np.ones(len(s), dtype=complex)
    for z in zeros:
        for each in (z,) if z.imag == 0.0 else (z, z.conjugate()):
            factor *= (s + each.conjugate()) / (s - each)
    return factor
