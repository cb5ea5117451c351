"""Figures 10 to 12 in numbers.json."""

from __future__ import annotations

from middeck.files.json_results import response_numbers
from middeck.identification.measurement_model import damping_ratio, natural_hz, path_delay
from middeck.identification.plants.zeros import name_zeros
from middeck.identification.uncertainty.parameters import stated
from middeck.study.chapters.two_sensor_control.claims import (
    figure_10_claims,
    figure_11_claims,
    figure_12_claims,
)
from middeck.study.chapters.two_sensor_control.computation import TwoSensorControl
from middeck.study.chapters.two_sensor_control.measured_sensors import MeasuredSensors, SensorZeros
from middeck.study.measured_loop.numbers import loop_numbers
from middeck.study.words import Numbers


def figure_10a(control: TwoSensorControl) -> Numbers:
    """The encoder."""
    return _path(control.sensors, 1)


def figure_10b(control: TwoSensorControl) -> Numbers:
    """The bus."""
    return {**_path(control.sensors, 2), "claims": figure_10_claims(control.sensors)}


def _path(sensors: MeasuredSensors, output: int) -> Numbers:
    """One path of the common fit: its response, its zeros and its delay, and the poles of all."""
    fit, model = sensors.fit, sensors.fit.model
    return {
        "input": sensors.measured.inputs[0].name,
        "output": sensors.measured.outputs[output].name,
        "data": response_numbers(sensors.measured, output=output),
        "fit": response_numbers(sensors.fitted, output=output),
        "zeros": _zeros(sensors.sensors[output]),
        "mirrored_error": sensors.sensors[output].mirrored_error,
        "natural_hz": natural_hz(model),
        "natural_hz_deviation": stated(fit.uncertainty.natural_hz),
        "damping": damping_ratio(model),
        "damping_deviation": stated(fit.uncertainty.damping),
        "delay_s": path_delay(model)[output, 0],
        "delay_deviation_s": stated(fit.uncertainty.delay_s)[output],
        "fit_band_hz": sensors.fit_band_hz,
        "relative_error": fit.error[output],
        "states": model.states,
        "plant_states": len(sensors.plant.system.A),
        "warnings": fit.warnings,
    }


def _zeros(sensor: SensorZeros) -> list[Numbers]:
    """Each zero of a path, a pair once."""
    zeros = sensor.zeros
    columns = {
        "name": name_zeros(zeros),
        "frequency_hz": zeros.frequency_hz,
        "frequency_deviation_hz": stated(sensor.frequency_deviation_hz),
        "damping": zeros.damping,
        "damping_deviation": stated(sensor.damping_deviation),
        "pair": zeros.is_pair,
        "nonminimum_phase": zeros.is_nonminimum_phase,
        "residual": zeros.residual,
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def figure_11(control: TwoSensorControl) -> Numbers:
    """The payload held by encoder and bus: how far each design reaches, and the loop with the lead."""
    designs = (*control.smaller, control.without_lead, control.with_lead)
    return {
        "open_loop": response_numbers(control.sensors.measured),
        "reach": designs,
        "payload": loop_numbers(control.payload),
        "claims": figure_11_claims(control),
    }


def figure_12(control: TwoSensorControl) -> Numbers:
    """Payload and bus held together: both closed-loop responses, and what the bus costs and gains."""
    sensors = control.sensors
    bus = {
        "open_loop": response_numbers(sensors.measured, output=2),
        "predicted": response_numbers(control.both.predicted, output=2),
        "measured": None
        if control.both.measured is None
        else response_numbers(control.both.measured, output=2),
    }
    return {
        "open_loop": response_numbers(sensors.measured),
        "both": loop_numbers(control.both),
        "bus": bus,
        "bus_db_7_to_9_hz": dict(zip(("payload", "both"), control.bus_db, strict=True)),
        "payload_db_above_10_hz": dict(zip(("payload", "both"), control.above_db, strict=True)),
        "payload_db_above_10_hz_without_bus_penalty": control.above_without_bus_db,
        "payload_deeper_db_7_to_9_hz": control.deeper_db,
        "payload_deeper_db_at_mode": control.deeper_at_mode_db,
        "mode_hz": control.mode_hz,
        "claims": figure_12_claims(control),
    }
