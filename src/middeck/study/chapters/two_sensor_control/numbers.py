"""Figures 10 to 12 in numbers.json."""

from __future__ import annotations

from middeck.files.json_results import fitted_numbers, response_numbers
from middeck.identification.plants.zeros import name_zeros
from middeck.identification.uncertainty.parameters import stated
from middeck.study.chapters.two_sensor_control import claims
from middeck.study.chapters.two_sensor_control.computation import TwoSensorControl
from middeck.study.chapters.two_sensor_control.measured_sensors import MeasuredSensors, SensorZeros
from middeck.study.measured_loop.numbers import fit_numbers, loop_numbers
from middeck.study.words import Numbers


def figure_10a(control: TwoSensorControl) -> Numbers:
    """The encoder's path of the common fit: its response, its zeros and its delay, and the poles of all."""
    return _path(control.sensors, 1)


def figure_10b(control: TwoSensorControl) -> Numbers:
    """The bus's path, and what is claimed of the three."""
    return {**_path(control.sensors, 2), "claims": claims.figure_10_claims(control.sensors)}


def _path(sensors: MeasuredSensors, output: int) -> Numbers:
    return {
        **fitted_numbers(sensors.measured, sensors.fitted, output=output),
        "zeros": _zeros(sensors.sensors[output]),
        "mirrored_error": sensors.sensors[output].mirrored_error,
        **fit_numbers(sensors.fit, sensors.plant, sensors.fit_band_hz, output),
        "warnings": sensors.fit.warnings,
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
        "claims": claims.figure_11_claims(control),
    }


def figure_12(control: TwoSensorControl) -> Numbers:
    """Payload and bus held together: both closed-loop responses, and what the bus costs and gains."""
    sensors = control.sensors
    measured = control.both.measured
    bus = {
        "open_loop": response_numbers(sensors.measured, output=2),
        "predicted": response_numbers(control.both.predicted, output=2),
        "measured": None if measured is None else response_numbers(measured, output=2),
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
        "claims": claims.figure_12_claims(control),
    }
