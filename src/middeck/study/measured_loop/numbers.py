"""A measured loop in the form of numbers.json."""

from __future__ import annotations

from middeck.files.json_results import response_numbers
from middeck.study.measured_loop.computation import MeasuredLoop
from middeck.study.words import Numbers


def loop_numbers(loop: MeasuredLoop) -> Numbers:
    """The loop as predicted, as measured, and by the rig's own eigenvalues."""
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
