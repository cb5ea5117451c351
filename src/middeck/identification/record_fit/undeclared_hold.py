"""Inputs that were held though the record does not say so: the model behind the hold, and the choice."""

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.identification.faults.spikes import is_impact
from middeck.identification.fit.fit_response import FitResult, marked
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.signals.excitation.driven_band import driven_band
from middeck.signals.record import Record

# Share of samples off rest that equal the one before exactly, and jumps, from which an input is in steps.
# It rests within this share of its span, as a converter's last digit moves.
STILL, FEWEST_JUMPS, AT_REST = 0.4, 10, 0.05
# Score of a hold from which it is tried. Share of half the rate from which inputs drive all frequencies.
TRIED, NYQUIST = 2.0, 0.95
# Difference of description length, of models with as many unknowns, that chance reaches in a record of 100.
CHANCE = 6.0
AS_HELD = "held inputs, which the record does not say, are the shorter description"
IN_STEPS = "inputs are taken as held, as they are given in steps"
TO_THE_END = "inputs are taken as held, as they drive all frequencies up to half the rate"
MAYBE_HELD = (
    f"{AS_HELD}, with doubts of its own: if they were held, half a sample period is in the delay; say in the "
    "record whether they were"
)
LIKELIER = (
    "held inputs, which the record does not say, describe it better by {by:.0f} of description length, too "
    "few to decide: if they were held, {ms:.3g} ms, half a sample period, are in the delay, and gains are "
    "too small at high frequencies; say in the record whether they were"
)

EITHER = (
    "inputs that drive all frequencies up to half the rate are taken as held, but held and band-limited ones "
    "describe the record alike: if they were band-limited, {ms:.3g} ms, half a sample period, lack in the "
    "delay; say in the record whether they were held"
)


def given_as_commands(record: Record) -> str:
    """Why the inputs are commands, which are held, by themselves; empty where they may have been measured.

    What is measured behind a filter is weak near half the rate. Blows are short, and may not be.
    """
    if are_steps(record):
        return IN_STEPS
    inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
    to_the_end = driven_band(inputs, record.sample_hz)[1] >= NYQUIST * 0.5 * record.sample_hz
    struck = any(is_impact(x) for u in inputs for x in u.T)
    return TO_THE_END if to_the_end and not struck and not _falls_off(inputs) else ""


def _falls_off(inputs: Float[np.ndarray, "experiment sample input"]) -> bool:
    """Whether an input is weaker in the last tenth of its lines, by more than three deviations of noise."""
    power = np.abs(np.fft.rfft(inputs, axis=1)[:, 1:]) ** 2
    last = power.shape[1] // 10
    tail, rest = power[:, -last:].mean(axis=(0, 1)), power[:, last:-last].mean(axis=(0, 1))
    return bool(np.any(tail < (1.0 - 3.0 / np.sqrt(len(inputs) * last)) * rest)) if last else True


def are_steps(record: Record) -> bool:
    """Whether all inputs stay at a level for some samples and jump to the next: commands, which are held.

    What is band-limited between samples, or measured, has hardly two equal samples in a row. Rest, as between
    the blows of a hammer or after a burst, is at or near the value that is there most often, and is no step.
    """
    inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
    return all(_in_steps(inputs[:, :, i]) for i in range(inputs.shape[2]))


def _in_steps(u: Float[np.ndarray, "experiment sample"]) -> bool:
    still = np.diff(u, axis=1) == 0.0
    rest = np.array(
        [[level[np.argmax(times)]] for level, times in (np.unique(x, return_counts=True) for x in u)]
    )
    off = np.abs(u - rest) > AT_REST * np.ptp(u)
    after = off[:, 1:]
    stays = np.count_nonzero(still & after) > STILL * max(np.count_nonzero(after), 1)
    jumps = ~still & (after | off[:, :-1])  # those to rest are jumps, too: a pulse has two
    return bool(stays and np.count_nonzero(jumps) >= FEWEST_JUMPS)


def without_hold(model: MeasurementModel, sample_hz: float) -> MeasurementModel:
    """The model behind the hold, from one whose modes and delay contain the hold."""
    weaker = np.sinc(np.minimum(natural_hz(model) / sample_hz, 0.5))
    late = np.maximum(model.delay_s - 0.5 / sample_hz, 0.0)
    return dataclasses.replace(model, shapes=model.shapes / weaker, delay_s=late)


def taken_as_held(
    released: FitResult, held: FitResult, shorter: float, why: str, sample_hz: float
) -> FitResult:
    """The ``held`` fit, the ``shorter`` one, if it has no warnings; else the other one with its warnings.

    Of inputs that are commands (``why``) it need not be shorter, and its warnings may be those of the other
    one.
    """
    if not held.warnings or (why and len(held.warnings) <= len(released.warnings)):
        either = (EITHER.format(ms=500.0 / sample_hz),) if why == TO_THE_END and shorter < CHANCE else ()
        reason = f"{held.order_reason}; {why or AS_HELD}"
        return dataclasses.replace(held, order_reason=reason, warnings=(*held.warnings, *either))
    return _doubted(released, MAYBE_HELD)


def perhaps_held(released: FitResult, shorter: float, sample_hz: float) -> FitResult:
    """The fit of inputs that were not held, with a warning where held ones are shorter than by chance."""
    if shorter < CHANCE:
        return marked(released, None)
    return _doubted(released, LIKELIER.format(by=shorter, ms=500.0 / sample_hz))


def _doubted(released: FitResult, warning: str) -> FitResult:
    found = marked(released, None)
    return dataclasses.replace(found, warnings=(*found.warnings, warning))
