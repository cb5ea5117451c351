"""Figures 10a and 10b: one torque to payload, encoder and bus, fitted together by poles, zeros and delays."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
from jaxtyping import Float

from middeck.files.studies.documents import Study
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.model.measurement_model import damping_ratio, model_response, natural_hz
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.zeros import Zeros, path_zeros
from middeck.identification.search.fit_warnings import FAR, HALF
from middeck.identification.uncertainty.parameter_deviations import zero_deviation
from middeck.study.chapters.two_sensor_control.left_zeros import refit_left
from middeck.study.measured_loop.computation import DesignCase, design_case
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import FrequencyResponse, in_band
from middeck.values import record


@record
class SensorZeros:
    """Zeros of the fitted path to one sensor.

    Attributes:
        frequency_deviation_hz, damping_deviation: Their standard deviations; infinite where the data do not
            determine the zero.
        mirrored_error: Relative complex error of the path in the band of the fit once its zeros are fitted
            anew with all of them in the left half-plane (`refit_left`); None where none is in the right one.
    """

    zeros: Zeros
    frequency_deviation_hz: Float[np.ndarray, " zero"]
    damping_deviation: Float[np.ndarray, " zero"]
    mirrored_error: float | None


@record(kw_only=True)
class MeasuredSensors:
    """Three measured paths from one torque, one fit with common poles, its zeros and its design plant.

    Attributes:
        measured, fitted: Outputs: the performance, then the two sensors of Figures 10a and 10b.
        sensors: Zeros of each path, in the same order.
        delay_s: The rig's own, hidden error included.
    """

    fit_band_hz: tuple[float, float]
    measured: FrequencyResponse
    fit: FitResult
    fitted: FrequencyResponse
    sensors: tuple[SensorZeros, ...]
    plant: Plant
    delay_s: float


def study_measured_sensors(study: Study, measured: FrequencyResponse, delay_s: float) -> MeasuredSensors:
    """Fit the three measured paths together and find the zeros of each; ``delay_s`` is for a claim alone."""
    band_hz = study.sito.fit_band_hz
    fit = fit_sensors(measured, study.sito.states, band_hz)
    case, banded = sensor_case(study, fit, measured), in_band(measured, band_hz)
    zeros = tuple(_sensor_zeros(fit, banded, o) for o in range(len(measured.outputs)))
    return MeasuredSensors(
        fit_band_hz=band_hz,
        measured=measured,
        fit=fit,
        fitted=case.fitted,
        sensors=zeros,
        plant=case.plant,
        delay_s=delay_s,
    )


def sensor_case(
    study: Study, fit: FitResult, measured: FrequencyResponse, *, bus: bool = False
) -> DesignCase:
    """The plant of a fit, with the payload for its performance, or payload and bus."""
    siso, sito = study.siso, study.sito
    torque = (siso.actuator,)
    z = (siso.sensor, sito.sensors[1]) if bus else (siso.sensor,)
    plant = measured_plant(fit.model, w=torque, u=torque, z=z, y=sito.sensors)
    return design_case(study.loop_test, fit.model, approximate_delays(plant, sito.pade_order), measured)


def fit_sensors(measured: FrequencyResponse, states: int | None, band_hz: tuple[float, float]) -> FitResult:
    """All paths in a band, by common poles and one delay; the data choose the order where none is given.

    Without a constant term, which a disturbance that is white would make infinite in the performance. A
    design trusts every mode of its plant: of a chosen order two states go as long as the damping of a mode
    in the band is not known to half of it, or depends on one or two lines, whose distortion the mode then
    follows, or as one lies so far above that it is a constant there, which no law can be sampled with.
    """
    banded = in_band(measured, band_hz)
    fit = partial(fit_response, banded, cost="logarithmic", delay="common", direct=False)
    found = fit(states=states)
    reason = found.order_reason
    while states is None and found.model.states > 2 and not _is_known(found, banded.frequency_hz):
        found = fit(states=found.model.states - 2)
        fewer = f"{found.model.states} are the most whose modes are all known"
        found = dataclasses.replace(found, order_reason=f"{reason}; {fewer}")
    return found


def _is_known(fit: FitResult, lines: Float[np.ndarray, " line"]) -> bool:
    f, zeta = natural_hz(fit.model), damping_ratio(fit.model)
    inside = (f >= lines[0]) & (f <= lines[-1])
    loose = (fit.uncertainty.damping > HALF * zeta) | (2.0 * zeta * f < lines[1] - lines[0])
    return not np.any(inside & loose | (f > FAR * lines[-1]))


def _sensor_zeros(fit: FitResult, banded: FrequencyResponse, o: int) -> SensorZeros:
    output, torque = banded.outputs[o].name, banded.inputs[0].name
    zeros = path_zeros(fit.model, output, torque)
    deviation = zero_deviation(fit.covariance, zeros.value, output=output, input=torque)
    if not zeros.is_nonminimum_phase.any():
        return SensorZeros(zeros, *deviation, None)
    f, data = banded.frequency_hz, banded.H[:, o, 0]
    fitted = model_response(fit.model, f)[:, o, 0]
    return SensorZeros(zeros, *deviation, refit_left(f, fitted, data, zeros.value))
