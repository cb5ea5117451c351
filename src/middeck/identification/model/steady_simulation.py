"""Response of a model to held inputs, its steady simulation of a periodic record, and its error on it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.errors import DataError
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    double_pole,
    model_response,
    natural_hz,
    path_delay,
    single_pole,
)
from middeck.identification.model.refused_data import check_record
from middeck.signals.record import Record
from middeck.systems.sampling.zero_order_hold import hold_response


def held_response(
    model: MeasurementModel, frequency_hz: np.ndarray, rate_hz: float
) -> Complex[np.ndarray, "line output input"]:
    """From held input samples to output samples, delays exact: tau = d T + f with 0 <= f < T.

    A mode at k T - f has gone a step from its last sample: x = exp(p (T - f)) x[k-1] + gamma(T - f) u[k-1]
    with gamma(t) = (exp(p t) - 1) / p.
    """
    T = 1.0 / rate_hz
    z = np.exp(2j * np.pi * frequency_hz * T)
    tau = path_delay(model)
    # A delay within rounding of whole samples is whole.
    whole = np.floor(tau / T + 1e-9)
    beyond = np.maximum(tau - whole * T, 0.0)
    p, pairs = model.poles, model.is_pair
    p = np.concatenate([p, p[pairs].conj()])
    c = np.concatenate([model.shapes, model.shapes[:, pairs].conj()], axis=1)
    b = np.concatenate([model.participation, model.participation[pairs].conj()])
    step = T - beyond[:, :, None]
    decay, gain = np.exp(p * step), np.expm1(p * step) / p
    residue = c[:, None, :] * b.T[None]
    full = np.expm1(p * T) / p
    sum_of_terms = np.einsum("oim,km->koi", residue * decay * full, 1.0 / (z[:, None] - np.exp(p * T)))
    sum_of_terms += np.sum(residue * gain, axis=2)
    # A double pole: position and rate a step later, and half the square of the step.
    d, double = step[:, :, 0], double_pole(model)
    w = (z - 1.0)[:, None, None]
    sum_of_terms += double * (T**2 * (z[:, None, None] + 1.0) / (2.0 * w**2) + d * T / w + 0.5 * d**2)
    sum_of_terms += single_pole(model) * (T / w + d)
    sum_of_terms += model.direct * np.where(beyond > 0.0, 1.0, z[:, None, None])
    return sum_of_terms * z[:, None, None] ** -(1.0 + whole)


def folded_response(
    model: MeasurementModel, frequency_hz: np.ndarray, rate_hz: float, kept: Bool[np.ndarray, " mode"]
) -> Complex[np.ndarray, "line output input"]:
    """The part of `held_response` that sampling folds back from above half the rate.

    The constant term is left out: it stands for what is above the band, where it is not constant. So are
    modes that are not ``kept``.
    """
    moving = dataclasses.replace(
        model,
        poles=model.poles[kept],
        shapes=model.shapes[:, kept],
        participation=model.participation[kept],
        direct=np.zeros(model.direct.shape),
    )
    hold = hold_response(frequency_hz, 1.0 / rate_hz)[:, None, None]
    return held_response(moving, frequency_hz, rate_hz) - hold * model_response(moving, frequency_hz)


def folded_modes(model: MeasurementModel, last_hz: float, *, real: bool) -> Bool[np.ndarray, " mode"]:
    """Modes of a first fit whose response beyond half the rate is folded back, as that of the article is.

    Those above the last line were fitted with what is folded back, and stand for it themselves, but where
    residues are complex, which add up with theirs. One below the first line keeps its tail at all
    frequencies.
    """
    return (natural_hz(model) <= last_hz) | (not real)


def simulate_periodic(
    model: MeasurementModel, record: Record
) -> Float[np.ndarray, "experiment period sample output"]:
    """The model's steady output for the inputs of ``record``, exact on every line of the period.

    A continuous model whose data had held inputs (``hold_s``) has them held here too.

    Raises `DataError` if the record is not periodic or has other inputs than the model.
    """
    if not record.periodic:
        raise DataError("a steady state needs a periodic record", hint="simulate_record simulates any record")
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
