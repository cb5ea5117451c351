"""A fit and a measured loop in the form of numbers.json, and whether the loop was predicted."""

from collections.abc import Iterable

from middeck.files.json.results import response_numbers
from middeck.identification.fit.fit_response import FitResult
from middeck.identification.model.measurement_model import damping_ratio, natural_hz, path_delay
from middeck.identification.uncertainty.parameter_deviations import stated
from middeck.study.measured_loop.computation import SEEN_DB, MeasuredLoop
from middeck.study.words import Claim, Numbers, at_most, fields, largest
from middeck.systems.plants.plant import Plant


def fit_numbers(fit: FitResult, plant: Plant, band_hz: tuple[float, float], output: int = 0) -> Numbers:
    """Poles, delay and error of the path to one output, and the sizes of the fit and of its design plant."""
    return {
        "natural_hz": natural_hz(fit.model),
        "natural_hz_deviation": stated(fit.uncertainty.natural_hz),
        "damping": damping_ratio(fit.model),
        "damping_deviation": stated(fit.uncertainty.damping),
        "delay_s": path_delay(fit.model)[output, 0],
        "delay_deviation_s": stated(fit.uncertainty.delay_s)[output],
        "fit_band_hz": band_hz,
        "relative_error": fit.error[output],
        "states": fit.model.states,
        "plant_states": len(plant.system.A),
    }


OF_LOOPS = (
    *("log10_authority", "predicted_db", "measured_db", "rms_error_db", "worst_error_db", "worst_hz"),
    *("control_rms_nm", "stable", "cause", "static_db", "modes"),
)


def loop_numbers(loop: MeasuredLoop) -> Numbers:
    """The loop as predicted, as measured, and by the rig's own eigenvalues."""
    return {
        "predicted": response_numbers(loop.predicted),
        "measured": None if loop.measured is None else response_numbers(loop.measured),
        **fields(loop, *OF_LOOPS),
        "survives_shift_percent": {f"{percent:+g}": ok for percent, ok in loop.survives},
        "rig": loop.on_rig,
        "warnings": loop.warnings,
    }


RMS_DB, LINE_DB = 1.0, 3.0  # how closely a measured loop is to be predicted, in rms and line by line


def prediction_claims(loops: Iterable[MeasuredLoop], which: str) -> list[Claim]:
    """Claims that each loop is measured as predicted."""
    loops = tuple(loops)
    rms = largest(None if loop.rms_error_db is None else abs(loop.rms_error_db) for loop in loops)
    line = largest(loop.worst_error_db for loop in loops)
    seen = f"within {LINE_DB:g} dB wherever the open loop is within {SEEN_DB:g} dB of its peak"
    return [
        at_most(
            f"{which}: predicted and measured rms agree within {RMS_DB:g} dB; largest difference [dB]",
            rms,
            RMS_DB,
        ),
        at_most(
            f"{which}: predicted and measured frequency lines agree {seen}; largest difference [dB]",
            line,
            LINE_DB,
        ),
    ]
