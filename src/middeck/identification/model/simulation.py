"""Steady-state simulation of a periodic record, and the error of a model on it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.identification.model.checks import check_record
from middeck.identification.model.held_response import held_response
from middeck.identification.model.measurement_model import MeasurementModel, model_response
from middeck.signals.record import Record


def simulate_periodic(
    model: MeasurementModel, record: Record
) -> Float[np.ndarray, "experiment period sample output"]:
    """The model's steady output for the inputs of ``record``, exact on every line of the period.

    A continuous model whose data had held inputs (``hold_s``) has them held here too.

    Raises `DataError` if the record is not periodic or has other inputs than the model.
    """
    if not record.periodic:
        raise DataError("a steady state needs a periodic record")
    if [p.name for p in record.inputs] != [p.name for p in model.inputs]:
        raise DataError(
            f"the record has the inputs {', '.join(p.name for p in record.inputs)}",
            hint=f"the model has {', '.join(p.name for p in model.inputs)}",
        )
    samples = record.u.shape[2]
    frequency = np.fft.rfftfreq(samples, 1.0 / record.sample_hz)
    U = np.fft.rfft(record.u, axis=2)
    H = model_response(model, frequency)
    if model.hold_s:
        H[1:] = held_response(model, frequency[1:], record.sample_hz)
    Y = np.einsum("koi,epki->epko", H, U)
    return np.fft.irfft(Y, n=samples, axis=2)


def nrmse(model: MeasurementModel, record: Record) -> Float[np.ndarray, " output"]:
    """rms(y - y_model) / rms(y) of each output over all periods of all experiments.

    Both without the offset of each experiment: no line at zero is fitted, and a sensor's zero is no motion.
    """
    check_record(record)
    left, y = (
        x - x.mean(axis=(1, 2), keepdims=True)
        for x in (record.y - simulate_periodic(model, record), record.y)
    )
    axes = (0, 1, 2)
    return np.sqrt(np.sum(left**2, axis=axes) / np.sum(y**2, axis=axes))
