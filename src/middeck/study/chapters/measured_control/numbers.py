"""Figures 9a and 9b in numbers.json."""

from __future__ import annotations

from middeck.files.json_results import fitted_numbers, response_numbers
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.study.chapters.measured_control.claims import figure_9_claims
from middeck.study.chapters.measured_control.computation import MeasuredControl
from middeck.study.measured_loop.numbers import fit_numbers, loop_numbers
from middeck.study.words import Numbers


def figure_9a(control: MeasuredControl) -> Numbers:
    """The measured response of the rig and the fit to it."""
    return {
        **fitted_numbers(control.open_loop, control.fitted),
        **fit_numbers(control.fit, control.plant, control.fit_band_hz),
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
