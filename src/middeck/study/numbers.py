"""Every number behind every figure, in the form of ``numbers.schema.json`` beside this file."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from middeck import __version__
from middeck.files.studies import Study
from middeck.identification.measurement_model import damping_ratio, natural_hz, path_delay
from middeck.identification.plants.zeros import name_zeros
from middeck.identification.uncertainty.parameters import stated
from middeck.structure.comparison import ModeComparison
from middeck.structure.equilibrium import Equilibrium, node_rotations
from middeck.structure.modes import Modes
from middeck.study.claims import (
    figure_6_claims,
    figure_7_claims,
    figure_9_claims,
    figure_10_claims,
    figure_11_claims,
    figure_12_claims,
)
from middeck.study.gravity_responses import GravityResponses
from middeck.study.measured_control import MeasuredControl
from middeck.study.measured_loop import MeasuredLoop
from middeck.study.measured_sensors import MeasuredSensors, SensorZeros
from middeck.study.mirror import PUBLISHED_NRMSE, MirrorFit
from middeck.study.stages import Outcome
from middeck.study.two_sensor_control import TwoSensorControl
from middeck.study.zero_g_control import SubModelSweep, ZeroGControl
from middeck.systems.response import FrequencyResponse

SCHEMA = "1"
Numbers = dict[str, Any]


def study_numbers(study: Study, outcomes: Mapping[str, Outcome]) -> Numbers:
    """The document ``numbers.json`` of a study whose stages gave ``outcomes``; no clock, no path."""
    figures: Numbers = {}
    for outcome in outcomes.values():
        figures.update(figure_numbers(outcome))
    return {
        "schema": SCHEMA,
        "versions": {
            "middeck": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "inputs": {**dict(study.inputs), "overrides": list(study.overrides), "seed": study.seed},
        "figures": figures,
    }


def figure_numbers(outcome: Outcome) -> Numbers:
    """Figures of one stage, by their keys."""
    match outcome:
        case ModeComparison():
            return {"figure_4": figure_4(outcome), "figure_5": figure_5(outcome)}
        case GravityResponses():
            return {"figure_6": figure_6(outcome)}
        case ZeroGControl():
            return {"figure_7": figure_7(outcome)}
        case MeasuredControl():
            return {"figure_9a": figure_9a(outcome), "figure_9b": figure_9b(outcome)}
        case TwoSensorControl():
            encoder, bus = (figure_10(outcome.sensors, output) for output in (1, 2))
            return {
                "figure_10a": encoder,
                "figure_10b": bus | {"claims": figure_10_claims(outcome.sensors)},
                "figure_11": figure_11(outcome),
                "figure_12": figure_12(outcome),
            }
        case MirrorFit():
            return {"mirror": mirror(outcome)}


def mode_numbers(modes: Modes, count: int) -> Numbers:
    """The lowest ``count`` modes and how far they are to be trusted."""
    return {
        "frequency_hz": modes.frequency_hz[:count],
        "kind": modes.kind[:count],
        "name": modes.name[:count],
        "strain_share": modes.strain_share[:count],
        "rigid_residual": modes.rigid_residual,
        "residual": float(modes.residual[:count].max()),
        "warnings": modes.warnings,
    }


def rest_numbers(equilibrium: Equilibrium) -> Numbers:
    """The rest state: reactions, holding torques and node rotations, each by name."""
    suspension, joints = equilibrium.suspension, equilibrium.model.structure.joints
    rotation = node_rotations(equilibrium)
    return {
        "reactions_n": dict(zip(suspension.name, suspension.reaction, strict=True)),
        "holding_torque_nm": {
            j.name: torque
            for j, torque in zip(joints, equilibrium.holding_torque, strict=True)
            if not j.slides
        },
        "node_rotation_deg": {name: np.degrees(v) for name, v in rotation.items()},
    }


def figure_4(comparison: ModeComparison) -> Numbers:
    """Frequencies in both environments, pairs of flexible modes and their ratios."""
    sides = {"orbit": comparison.orbit, "lab": comparison.lab}
    return {
        **{
            name: {**mode_numbers(side, comparison.count), **rest_numbers(side.equilibrium)}
            for name, side in sides.items()
        },
        "pairs": comparison.pairs,
        "ratio": comparison.ratio,
        "subspace_angle_deg": np.degrees(comparison.subspace_angle),
    }


def figure_5(comparison: ModeComparison) -> Numbers:
    """Cross-orthogonality [orbit][lab], absolute values, and the MAC."""
    return {"matrix": comparison.cross_orthogonality, "mac": comparison.mac}


def figure_6(responses: GravityResponses) -> Numbers:
    """Rates of payload and bus per torque, in this order of the outputs."""
    sides = {"orbit": responses.orbit, "lab": responses.lab, "rig": responses.rig}
    names = ("payload_z_rate", "bus_z_rate")
    error = responses.magnitude_error
    return {
        **{
            side: {name: response_numbers(r, output=i) for i, name in enumerate(names)}
            for side, r in sides.items()
        },
        "phase_gap_s": responses.phase_gap_s,
        "delay_s": responses.delay_s,
        "input": responses.rig.inputs[0].name,
        "outputs": [port.name for port in responses.rig.outputs],
        "magnitude_error_band_hz": error and error.band_hz,
        "magnitude_error_db": {"orbit": error and error.orbit_db, "lab": error and error.lab_db},
        "claims": figure_6_claims(responses),
    }


def response_numbers(response: FrequencyResponse, *, output: int = 0, input: int = 0) -> Numbers:
    """One entry of a response on its own lines."""
    H = response.H[:, output, input]
    return {"frequency_hz": response.frequency_hz, "re": np.real(H), "im": np.imag(H)}


def figure_7(control: ZeroGControl) -> Numbers:
    """Performance against authority for the model and its two sub-models."""
    sweeps = dict(control.sweeps)
    return {
        "log10_authority": control.log10_authority,
        "disturbance_psd_two_sided": control.disturbance_psd,
        "metric_3sigma_deg_pd": {env: np.degrees(3.0 * value) for env, value in control.metric_pd},
        **{which: _sub_model(sweep) for which, sweep in sweeps.items()},
        "claims": figure_7_claims(control),
    }


def _sub_model(sub: SubModelSweep) -> Numbers:
    sweep, first = sub.sweep, sub.first_instability
    sides = {
        plant: {
            "db": [float(v) if ok else None for v, ok in zip(db, stable, strict=True)],
            "stable": stable,
            "compensator_stable": sweep.compensator_stable,
        }
        for plant, db, stable in zip(sweep.plants, sweep.db, sweep.stable, strict=True)
    }
    instability = first and {
        "log10_authority": first.log10_authority,
        "frequency_hz": first.frequency_hz,
        "growth_rad_s": first.pole.real,
        "mode_frequency_hz": sub.mode_frequency_hz,
        "mode_name": first.mode_name,
        "participation": first.participation,
        "compensator_share": first.compensator_share,
        "unstable_pairs": sub.unstable_pairs,
        "unstable_real_poles": sub.unstable_real,
    }
    return {
        **sides,
        "reference_db_lab_pd": sub.reference_db_lab_pd,
        "quadrature_error": sub.quadrature_error,
        "first_instability": instability,
    }


def figure_9a(control: MeasuredControl) -> Numbers:
    """The measured response of the rig and the fit to it."""
    model = control.fit.model
    return {
        "input": control.open_loop.inputs[0].name,
        "output": control.open_loop.outputs[0].name,
        "data": response_numbers(control.open_loop),
        "fit": response_numbers(control.fitted),
        "natural_hz": natural_hz(model),
        "natural_hz_deviation": stated(control.fit.uncertainty.natural_hz),
        "damping": damping_ratio(model),
        "damping_deviation": stated(control.fit.uncertainty.damping),
        "delay_s": model.delay_s[0],
        "delay_deviation_s": stated(control.fit.uncertainty.delay_s)[0],
        "fit_band_hz": control.fit_band_hz,
        "relative_error": control.fit.error[0],
        "states": model.states,
        "plant_states": len(control.plant.system.A),
        "mode_below_fit": control.below_fit,
        "warnings": control.fit.warnings,
    }


def figure_9b(control: MeasuredControl) -> Numbers:
    """Loops at two authorities and one for two records, predicted and measured."""
    drifted = control.drifted_fit
    return {
        "open_loop": response_numbers(control.open_loop),
        "pair_shift_hz": control.pair_shift_hz,
        "drifted": {
            "shift_percent": control.drifted_percent,
            "natural_hz": natural_hz(drifted.model),
            "damping": damping_ratio(drifted.model),
            "relative_error": drifted.error[0],
            "warnings": drifted.warnings,
        },
        **{loop.name: _loop(loop) for loop in control.loops},
        "one_model": control.one_model,
        "claims": figure_9_claims(control),
    }


def _loop(loop: MeasuredLoop) -> Numbers:
    return {
        "predicted": response_numbers(loop.predicted),
        "measured": None if loop.measured is None else response_numbers(loop.measured),
        "log10_authority": loop.log10_authority,
        "predicted_db": loop.predicted_db,
        "measured_db": loop.measured_db,
        "rms_error_db": loop.rms_error_db,
        "worst_error_db": loop.worst_error_db,
        "worst_hz": loop.worst_hz,
        "control_rms_nm": loop.control_rms_nm,
        "stable": loop.stable,
        "cause": loop.cause,
        "static_db": loop.static_db,
        "modes": loop.modes,
        "survives_shift_percent": {f"{percent:+g}": ok for percent, ok in loop.survives},
        "rig": loop.on_rig,
    }


def figure_10(sensors: MeasuredSensors, output: int) -> Numbers:
    """One path of the common fit: its response, its zeros and its delay, and the poles of all."""
    fit, model = sensors.fit, sensors.fit.model
    return {
        "input": sensors.measured.inputs[0].name,
        "output": sensors.measured.outputs[output].name,
        "data": response_numbers(sensors.measured, output=output),
        "fit": response_numbers(sensors.fitted, output=output),
        "zeros": zero_numbers(sensors.sensors[output]),
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


def figure_11(control: TwoSensorControl) -> Numbers:
    """The payload held by encoder and bus: how far each design reaches, and the loop with the lead."""
    designs = (*control.smaller, control.without_lead, control.with_lead)
    return {
        "open_loop": response_numbers(control.sensors.measured),
        "reach": designs,
        "payload": _loop(control.payload),
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
        "both": _loop(control.both),
        "bus": bus,
        "bus_db_7_to_9_hz": dict(zip(("payload", "both"), control.bus_db, strict=True)),
        "payload_db_above_10_hz": dict(zip(("payload", "both"), control.above_db, strict=True)),
        "payload_db_above_10_hz_without_bus_penalty": control.above_without_bus_db,
        "payload_deeper_db_7_to_9_hz": control.deeper_db,
        "payload_deeper_db_at_mode": control.deeper_at_mode_db,
        "mode_hz": control.mode_hz,
        "claims": figure_12_claims(control),
    }


def zero_numbers(sensor: SensorZeros) -> list[Numbers]:
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


def mirror(fit: MirrorFit) -> Numbers:
    """A real mirror: all entries of the measured and the fitted response, and the held-out error."""
    entries = [
        {
            "input": i.name,
            "output": o.name,
            "data": response_numbers(fit.measured, output=b, input=a),
            "fit": response_numbers(fit.fitted, output=b, input=a),
        }
        for b, o in enumerate(fit.measured.outputs)
        for a, i in enumerate(fit.measured.inputs)
    ]
    return {
        "states": fit.fit.model.states,
        "held_out_nrmse": fit.held_out_nrmse,
        "published_nrmse": PUBLISHED_NRMSE,
        "relative_error": fit.fit.error,
        "natural_hz": natural_hz(fit.fit.model),
        "damping": damping_ratio(fit.fit.model),
        "entries": entries,
        "warnings": fit.fit.warnings,
    }
