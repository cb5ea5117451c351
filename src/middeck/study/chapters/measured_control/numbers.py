"""Figures 9a and 9b in numbers.json."""

from __future__ import annotations

from middeck.files.json_results import response_numbers
from middeck.identification.measurement_model import damping_ratio, natural_hz
from middeck.identification.uncertainty.parameters import stated
from middeck.study.chapters.measured_control.claims import figure_9_claims
from middeck.study.chapters.measured_control.computation import MeasuredControl
from middeck.study.measured_loop.numbers import loop_numbers
from middeck.study.words import Numbers


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
        **{loop.name: loop_numbers(loop) for loop in control.loops},
        "one_model": control.one_model,
        "claims": figure_9_claims(control),
    }
