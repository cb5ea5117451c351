"""The mirror in numbers.json."""

from __future__ import annotations

from middeck.files.json_results import response_numbers
from middeck.identification.measurement_model import damping_ratio, natural_hz
from middeck.study.chapters.mirror.computation import PUBLISHED_NRMSE, MirrorFit
from middeck.study.words import Numbers


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
