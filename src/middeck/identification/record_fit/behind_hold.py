"""The fit of the system behind a hold of the inputs: a first model estimates the folded-back response."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import FitError
from middeck.identification.fit.fit_response import FitResult, marked
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio, natural_hz
from middeck.identification.model.steady_simulation import folded_modes, folded_response
from middeck.signals.record import Record
from middeck.systems.sampling.zero_order_hold import release_inputs

# Share of half the rate from which a mode of a first model may stand for what is folded back there.
NEAR_HALF = 0.9
# Damping ratio from which a mode's response is as smooth as that of what is folded back.
LIGHT = 0.2
# Fits of what is left by the light modes of the one before, each of which tells it better.
TURNS = 4
# Fits of what is left by the fit before as a whole: with a mode near half the rate each halves the error.
OWN_TURNS = 10
# Deviations of noise by which what a fit folds back may differ from what was taken off before it.
TOLD_APART = 1.0


class Made(NamedTuple):
    """A fit, the length of its description, and the score of a hold that it lacks.

    ``with_delays``: the length with delays in place of damped poles; infinite where there is none.
    """

    fit: FitResult
    length: float
    hold: float
    with_delays: float


class First(NamedTuple):
    """A model without its covariance, and whether its constants are real."""

    model: MeasurementModel
    real: bool


def fit_behind_hold(
    fit: Callable[[Record, Record], Made], given: Record, record: Record, first: First, last_hz: float
) -> Made:
    """The fit of the system behind the hold, less the response that ``first`` folds back.

    What is folded back is as large as the response near half the rate. Modes of ``first`` there, and heavy
    ones, may stand for it. They are left out where that leaves no doubts, or is the shorter description.
    """
    below_hz, f = NEAR_HALF * 0.5 * record.sample_hz, natural_hz(first.model)
    behind = functools.partial(_behind, fit, given, record)
    if not first.real or not np.any((f > below_hz) & (f <= last_hz)):
        made = behind(first, last_hz)
    else:
        made = behind(first, below_hz)
        if made.fit.warnings:
            made = _shorter(made, behind(first, last_hz))
    made = _less_its_own(behind, record, made, first, below_hz)
    light = bool(np.all(damping_ratio(first.model) < LIGHT))
    return made if light else _less_light_modes(behind, made, first, below_hz)


def _less_light_modes(behind: Callable[..., Made], made: Made, first: First, last_hz: float) -> Made:
    """The shortest fit less what light modes alone fold back: those of ``first``, then of the fit before."""
    before = np.inf
    for _ in range(TURNS):
        if not made.fit.warnings:
            break
        try:
            other = behind(first, last_hz, heaviest=LIGHT)
        except FitError:
            break
        if other.length >= before:
            break
        made, before, first = _shorter(made, other), other.length, First(other.fit.model, first.real)
    return made


def _less_its_own(
    behind: Callable[..., Made], record: Record, made: Made, first: First, last_hz: float
) -> Made:
    """The fit less what it folds back itself, where that is told from what was taken off.

    A first model is bent near half the rate by what is folded back there, and so is what it folds back
    itself: where there is little noise, by many deviations of the fit.
    """
    for _ in range(OWN_TURNS):
        own = First(made.fit.model, first.real)
        if _told_apart(record, made, own, first, last_hz) < TOLD_APART:
            break
        try:
            other = behind(own, last_hz)
        except FitError:
            break
        if other.length >= made.length:
            break
        made, first = other, own
    return made


def _told_apart(record: Record, made: Made, own: First, first: First, last_hz: float) -> float:
    """Deviations of noise by which what two models fold back differs: no unknown moves by more of its own."""
    one, other = (_folded_outputs(model, record, last_hz, np.inf) for model in (own, first))
    y = record.y - record.y.mean(axis=(1, 2), keepdims=True)
    noise = made.fit.error**2 * np.mean(y**2, axis=(0, 1, 2)) + np.finfo(float).tiny
    return float(np.sqrt(np.sum((one - other) ** 2 / noise)))


def _shorter(made: Made, other: Made) -> Made:
    return min(made, other, key=lambda made: made.length)


def _behind(
    fit: Callable[[Record, Record], Made],
    given: Record,
    record: Record,
    first: First,
    last_hz: float,
    heaviest: float = np.inf,
) -> Made:
    behind = release_inputs(record)
    behind = dataclasses.replace(behind, y=record.y - _folded_outputs(first, record, last_hz, heaviest))
    made = fit(given, behind)
    return made._replace(fit=marked(made.fit, 1.0 / record.sample_hz))


def _folded_outputs(
    first: First, record: Record, last_hz: float, heaviest: float
) -> Float[np.ndarray, "*outputs"]:
    """The part of the outputs that is folded back: held inputs reach beyond half the rate."""
    model = first.model
    kept = folded_modes(model, last_hz, real=first.real) & (damping_ratio(model) < heaviest)
    run = record.u.reshape(len(record.u), -1, record.u.shape[3])
    f = np.fft.rfftfreq(run.shape[1], 1.0 / record.sample_hz)
    H = np.zeros((len(f), *model.direct.shape), dtype=complex)
    H[1:] = folded_response(model, f[1:], record.sample_hz, kept)
    y = np.fft.irfft(np.einsum("koi,eki->eko", H, np.fft.rfft(run, axis=1)), n=run.shape[1], axis=1)
    return y.reshape(record.y.shape)
