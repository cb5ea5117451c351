"""Inputs that may have been held, though the record does not say so: the choice between two fits."""

import dataclasses

import numpy as np

from middeck.identification.fit.fit_result import FitResult, marked

# Difference of description length, of models with as many unknowns, that chance reaches in a record of 100.
CHANCE = 6.0
# Deviations of a delay below which half a period moves it in silence.
MOVED = 4.0
AS_HELD = "held inputs, which the record does not say, are the shorter description"
TO_THE_END = "inputs are taken as held, as they drive all frequencies up to half the rate"
BY_HALF = "inputs are taken as held, as residues of rates are turned by half a sample period"
MAYBE_HELD = (
    f"{AS_HELD}, with doubts of its own: if they were held, half a sample period is in the delay, or in "
    "phases of residues, direct terms and zeros; say in the record whether they were"
)
STEPS_AS_NOT_HELD = (
    "inputs are given in steps, but a model behind their hold is the longer description: if they were held, "
    "{ms:.3g} ms, half a sample period, are in the delay; say in the record whether they were, or take a "
    "wider band"
)
LIKELIER = (
    "held inputs, which the record does not say, describe it better by {by:.0f} of description length, too "
    "few to decide: if they were held, {ms:.3g} ms, half a sample period, are in the delay, and gains are "
    "too small at high frequencies; say in the record whether they were"
)

TURNED = (
    "residues of rates are turned by half a sample period, {ms:.3g} ms, as a hold of inputs turns them, but "
    "a model behind a hold is a longer description, or fails: if they were held, phases of residues, direct "
    "terms, zeros and delays are wrong by it; say in the record whether they were"
)
EITHER = (
    "{why}, but held and band-limited ones describe the record alike: if they were band-limited, "
    "{ms:.3g} ms, half a sample period, lack in the delay; say in the record whether they were held"
)
ALIKE = (
    "held and band-limited commands describe the response alike: if they were held, {ms:.3g} ms, half a "
    "sample period, are in the delay; say in the record whether they were"
)


def taken_as_held(
    released: FitResult, held: FitResult, shorter: float, why: str, sample_hz: float
) -> FitResult:
    """The ``held`` fit, the ``shorter`` one, if it has no warnings; else the other one with its warnings.

    Of inputs that are or seem to be commands (``why``) it need not be shorter, and its warnings may be those
    of the other one.
    """
    if not held.warnings or (why and len(held.warnings) <= len(released.warnings)):
        alike = why in {TO_THE_END, BY_HALF} and shorter < CHANCE
        either = (EITHER.format(why=why, ms=500.0 / sample_hz),) if alike else ()
        reason = f"{held.order_reason}; {why or AS_HELD}"
        return dataclasses.replace(held, order_reason=reason, warnings=(*held.warnings, *either))
    return _doubted(released, MAYBE_HELD)


def perhaps_held(released: FitResult, shorter: float, sample_hz: float) -> FitResult:
    """The fit of inputs that were not held, with a warning where held ones are shorter than by chance."""
    if shorter < CHANCE:
        return marked(released, None)
    return _doubted(released, LIKELIER.format(by=shorter, ms=500.0 / sample_hz))


def steps_as_not_held(released: FitResult, sample_hz: float) -> FitResult:
    """The fit of inputs in steps that were taken as not held: no band-limited signal stands still."""
    return _doubted(released, STEPS_AS_NOT_HELD.format(ms=500.0 / sample_hz))


def turned_as_if_held(released: FitResult, sample_hz: float) -> FitResult:
    """The fit of inputs that were taken as not held, though residues are turned as by a hold."""
    return _doubted(released, TURNED.format(ms=500.0 / sample_hz))


def _doubted(released: FitResult, warning: str) -> FitResult:
    found = marked(released, None)
    return dataclasses.replace(found, warnings=(*found.warnings, warning))


def chosen_hold(released: FitResult, held: FitResult, shorter: float, hold_s: float) -> FitResult:
    """The fit of a response to commands that may have been held over ``hold_s``, with its doubt.

    ``shorter`` by `CHANCE` is held: a controller holds its commands.
    """
    if shorter > CHANCE:
        return taken_as_held(released, held, shorter, AS_HELD, 1.0 / hold_s)
    deviation = released.uncertainty.delay_s
    if shorter < -CHANCE or not np.any((deviation > 0.0) & (deviation < 0.5 * hold_s / MOVED)):
        return released
    return _doubted(released, ALIKE.format(ms=500.0 * hold_s))
