"""The fit of the system behind a hold of the inputs: a first model estimates the folded-back response."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.identification.fit.fit_response import FitResult, marked
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.identification.model.steady_simulation import folded_modes, folded_response
from middeck.signals.record import Record
from middeck.systems.sampling.zero_order_hold import release_inputs

# Share of half the rate from which a mode of a first model may stand for what is folded back there.
NEAR_HALF = 0.9


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

    What is folded back is as large as the response near half the rate. A mode of ``first`` there may stand
    for it, and is left out, unless that leaves doubts and a longer description than with it.
    """
    below_hz, f = NEAR_HALF * 0.5 * record.sample_hz, natural_hz(first.model)
    if not first.real or not np.any((f > below_hz) & (f <= last_hz)):
        return _behind(fit, given, record, first, last_hz)
    without = _behind(fit, given, record, first, below_hz)
    if not without.fit.warnings:
        return without
    return min(without, _behind(fit, given, record, first, last_hz), key=lambda made: made.length)


def _behind(
    fit: Callable[[Record, Record], Made], given: Record, record: Record, first: First, last_hz: float
) -> Made:
    behind = release_inputs(record)
    behind = dataclasses.replace(behind, y=record.y - _folded_outputs(first, record, last_hz))
    made = fit(given, behind)
    return made._replace(fit=marked(made.fit, 1.0 / record.sample_hz))


def _folded_outputs(first: First, record: Record, last_hz: float) -> Float[np.ndarray, "*outputs"]:
    """The part of the outputs that is folded back: held inputs reach beyond half the rate."""
    model = first.model
    kept = folded_modes(model, last_hz, real=first.real)
    run = record.u.reshape(len(record.u), -1, record.u.shape[3])
    f = np.fft.rfftfreq(run.shape[1], 1.0 / record.sample_hz)
    H = np.zeros((len(f), *model.direct.shape), dtype=complex)
    H[1:] = folded_response(model, f[1:], record.sample_hz, kept)
    y = np.fft.irfft(np.einsum("koi,eki->eko", H, np.fft.rfft(run, axis=1)), n=run.shape[1], axis=1)
    return y.reshape(record.y.shape)
