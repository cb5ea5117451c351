"""Inputs that were held though the record does not say so: the model behind the hold, and the choice."""

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.identification.fit.fit_response import FitResult, marked
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.signals.record import Record

# Share of samples off rest that equal the one before exactly, and jumps, from which an input is in steps.
# It rests within this share of its span, as a converter's last digit moves.
STILL, FEWEST_JUMPS, AT_REST = 0.4, 10, 0.05
AS_HELD = "held inputs, which the record does not say, are the shorter description"
IN_STEPS = "inputs are taken as held, as they are given in steps"
MAYBE_HELD = (
    f"{AS_HELD}, with doubts of its own: if they were held, half a sample period is in the delay; say in the "
    "record whether they were"
)


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
    off = np.abs(u[:, 1:] - rest) > AT_REST * np.ptp(u)
    stays = np.count_nonzero(still & off) > STILL * max(np.count_nonzero(off), 1)
    return bool(stays and np.count_nonzero(~still & off) >= FEWEST_JUMPS)


def without_hold(model: MeasurementModel, sample_hz: float) -> MeasurementModel:
    """The model behind the hold, from one whose modes and delay contain the hold."""
    weaker = np.sinc(np.minimum(natural_hz(model) / sample_hz, 0.5))
    late = np.maximum(model.delay_s - 0.5 / sample_hz, 0.0)
    return dataclasses.replace(model, shapes=model.shapes / weaker, delay_s=late)


def taken_as_held(released: FitResult, held: FitResult, *, steps: bool = False) -> FitResult:
    """The ``held`` fit, the shorter one, if it has no warnings; else the other one with its warnings.

    Of inputs in ``steps`` it need not be shorter, and its warnings may be those of the other one.
    """
    if not held.warnings or (steps and len(held.warnings) <= len(released.warnings)):
        why = IN_STEPS if steps else AS_HELD
        return dataclasses.replace(held, order_reason=f"{held.order_reason}; {why}")
    doubted = marked(released, None)
    return dataclasses.replace(doubted, warnings=(*doubted.warnings, MAYBE_HELD))
