"""Inputs that were held though the record does not say so: the model behind the hold, and the choice."""

import dataclasses

import numpy as np

from middeck.identification.fit.fit_response import FitResult, marked
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz

AS_HELD = "held inputs, which the record does not say, are the shorter description"
MAYBE_HELD = (
    f"{AS_HELD}, with doubts of its own: if they were held, half a sample period is in the delay; say in the "
    "record whether they were"
)


def without_hold(model: MeasurementModel, sample_hz: float) -> MeasurementModel:
    """The model behind the hold, from one whose modes and delay contain the hold."""
    weaker = np.sinc(np.minimum(natural_hz(model) / sample_hz, 0.5))
    late = np.maximum(model.delay_s - 0.5 / sample_hz, 0.0)
    return dataclasses.replace(model, shapes=model.shapes / weaker, delay_s=late)


def taken_as_held(released: FitResult, held: FitResult) -> FitResult:
    """The ``held`` fit, the shorter one, if it has no warnings; else the other one with its warnings."""
    if not held.warnings:
        return dataclasses.replace(held, order_reason=f"{held.order_reason}; {AS_HELD}")
    doubted = marked(released, None)
    return dataclasses.replace(doubted, warnings=(*doubted.warnings, MAYBE_HELD))
