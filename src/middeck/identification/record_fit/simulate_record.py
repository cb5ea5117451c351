"""A model driven by a record's inputs from any initial state: simulated, not predicted from its outputs.

The response to a record's inputs repeated for ever is one particular motion, and the discrete Fourier
transform gives it exactly; what differs from it within the record is free motion of the model's poles, whose
amplitudes (the initial state) are fitted to the outputs. Between samples, the inputs of a continuous model
are either held or band-limited; a sampled model needs to know nothing of what is between.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError, NumericalError
from middeck.identification.model.measurement_model import (
    RANK,
    MeasurementModel,
    double_pole,
    model_response,
    path_delay,
    single_pole,
)
from middeck.identification.model.refused_data import check_record, check_word
from middeck.identification.model.steady_simulation import held_response
from middeck.signals.record import Record

Between = Literal["hold", "band-limited"]
# Exponent of free motion before the record's first sample.
LARGEST = 50.0


def simulate_record(
    model: MeasurementModel, record: Record, *, state_share: float = 1.0, between: Between | None = None
) -> Float[np.ndarray, "experiment period sample output"]:
    """Outputs of the model for the record's inputs, the initial state fitted to the record's outputs.

    Args:
        record: Periods are taken as one run of samples.
        state_share: Share of each experiment, from its first sample, to which its initial state is fitted,
            outputs weighed by their rms. The rest is then a simulation that has never seen the outputs.
        between: Inputs of a continuous model between samples: "hold" (a converter before the
            plant) or "band-limited" (both sides measured behind the same filters; Pintelon and Schoukens
            2012, ch. 13). By default as in the data of the model, its ``hold_s``; band-limited where that is
            not known.

    Raises `ConfigError` if the record has other ports than the model, the share is no share, or the rates
    differ; `DataError` if the share holds fewer numbers than the model has states; `NumericalError` for a
    model that is not stable: its response to repeated inputs is none.

    >>> from middeck.signals.ports import Port
    >>> port = (Port("x", "1"),)
    >>> one = np.ones((1, 1))
    >>> lag = MeasurementModel(
    ...     poles=[np.log(0.5) + 0j], shapes=one, participation=one, direct=0 * one, lower=0 * one,
    ...     delay_s=[0.0], inputs=port, outputs=port, sample_hz=1.0)
    >>> u = np.zeros((1, 1, 16, 1))
    >>> y = 0.5 ** np.arange(16.0).reshape(u.shape)            # y[k+1] = 0.5 y[k] + u[k], from y[0] = 1
    >>> u[..., 8:, :], y[..., 9:, :] = 1.0, 2.0 - 2.0 * 0.5 ** np.arange(1.0, 8.0).reshape(1, 1, 7, 1)
    >>> y[..., 9:, :] += 0.5 ** np.arange(9.0, 16.0).reshape(1, 1, 7, 1)
    >>> record = Record(sample_hz=1.0, u=u, y=y, inputs=port, outputs=port, periodic=False)
    >>> bool(np.allclose(simulate_record(lag, record, state_share=0.2), y))
    True
    """
    check_record(record)
    check_word("between", between, get_args(Between))
    _check(model, record, state_share)
    experiments, periods, samples, _ = record.u.shape
    count = periods * samples
    u = record.u.reshape(experiments, count, -1)
    y = record.y.reshape(experiments, count, -1)
    forced = _forced(model, u, record.sample_hz, between or ("hold" if model.hold_s else "band-limited"))
    free = free_motion(model, count, record.sample_hz)
    if not (np.isfinite(forced).all() and np.isfinite(free).all()):
        raise NumericalError("the model's response to the record is not finite", hint="a stable model")
    used = int(np.ceil(state_share * count))
    if used * y.shape[2] < len(free):
        raise DataError(
            f"{used} samples cannot tell {len(free)} initial states", hint="a larger share, or fewer states"
        )
    level = np.sqrt(np.mean(y**2, axis=(0, 1)))
    A = (free[:, :used] / level).reshape(len(free), -1).T
    size = np.linalg.norm(A, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    left = ((y - forced)[:, :used] / level).reshape(experiments, -1).T
    state = np.linalg.lstsq(A / size, left, rcond=None)[0].T / size
    return (forced + np.tensordot(state, free, axes=1)).reshape(record.y.shape)


def record_nrmse(
    model: MeasurementModel, record: Record, *, state_share: float = 1.0
) -> Float[np.ndarray, " output"]:
    """rms(y - y_model) / rms(y) of each output over the whole record; see `simulate_record`."""
    y = simulate_record(model, record, state_share=state_share)
    axes = (0, 1, 2)
    return np.sqrt(np.sum((record.y - y) ** 2, axis=axes) / np.sum(record.y**2, axis=axes))


def _check(model: MeasurementModel, record: Record, state_share: float) -> None:
    for side, has, wants in (
        ("inputs", record.inputs, model.inputs),
        ("outputs", record.outputs, model.outputs),
    ):
        if [p.name for p in has] != [p.name for p in wants]:
            raise ConfigError(
                f"the record has the {side} {', '.join(p.name for p in has)}",
                hint=f"the model has {', '.join(p.name for p in wants)}",
            )
    if not 0.0 < state_share <= 1.0:
        raise ConfigError(f"a share of {state_share} of a record is none", hint="above 0, up to 1")
    rate = model.sample_hz
    if rate is not None and abs(rate - record.sample_hz) > 1e-9 * record.sample_hz:
        raise ConfigError(
            f"the model is sampled at {rate:.6g} Hz, the record at {record.sample_hz:.6g} Hz",
            hint="resample the record, or fit a continuous model",
        )
    if np.any(np.real(model.poles) >= 0.0):
        raise NumericalError(
            "a pole of the model does not decay: it has no steady response to repeated inputs",
            hint="a model whose poles all decay",
        )


def _forced(
    model: MeasurementModel, u: Float[np.ndarray, "experiment sample input"], rate_hz: float, between: Between
) -> Float[np.ndarray, "experiment sample output"]:
    """Motion that repeats with the record; poles at zero add their response to a constant input."""
    held = between == "hold" and model.sample_hz is None
    double, delay = double_pole(model), path_delay(model)
    # Held inputs are zero before the record, as far back as a delay reaches; repeated ones need no such.
    before = int(np.ceil(float(delay.max()) * rate_hz)) + 1 if held else 0
    u = np.pad(u, ((0, 0), (before, 0), (0, 0)))
    count = u.shape[1]
    frequency = np.fft.rfftfreq(count, 1.0 / rate_hz)
    H = np.zeros((len(frequency), *model.direct.shape), dtype=complex)
    H[1:] = held_response(model, frequency[1:], rate_hz) if held else model_response(model, frequency[1:])
    H[0] = _static(model)
    y = np.fft.irfft(np.einsum("koi,eki->eko", H, np.fft.rfft(u, axis=1)), n=count, axis=1)
    late = np.arange(count)[:, None, None] / rate_hz - delay
    y += np.einsum("koi,ei->eko", double * 0.5 * late**2 + single_pole(model) * late, u.mean(axis=1))
    return y[:, before:]


def _static(model: MeasurementModel) -> Float[np.ndarray, "output input"]:
    """Response at zero frequency, poles there apart."""
    T = None if model.sample_hz is None else 1.0 / model.sample_hz
    room = -model.poles if T is None else 1.0 - np.exp(model.poles * T)
    each = np.where(model.is_pair, 2.0, 1.0)
    return np.real((model.shapes * (each / room)) @ model.participation) + model.direct


def free_motion(
    model: MeasurementModel, count: int, rate_hz: float
) -> Float[np.ndarray, "state sample output"]:
    """The model's motion from each of its initial states, as samples of the outputs."""
    pairs = model.is_pair
    c = model.shapes / np.maximum(np.linalg.norm(model.shapes, axis=0), np.finfo(float).tiny)
    # A delay of an output is one of its view of the state; paths that differ share that of the output.
    late = np.arange(count)[:, None] / rate_hz - (model.delay_s - model.delay_s.min())
    # A pole that decays within the delay would be seen larger than numbers go.
    exponent = model.poles[:, None, None] * late
    motion = np.exp(np.minimum(np.real(exponent), LARGEST) + 1j * np.imag(exponent)) * c.T[:, None, :]
    parts = [np.real(motion), -np.imag(motion[pairs])]
    double = double_pole(model)
    if np.any(double):
        shape = _columns(double)
        parts += [np.broadcast_to(shape, (len(shape), count, len(double))), shape * late]
    if np.any(single := single_pole(model)):
        shape = _columns(single)
        parts.append(np.broadcast_to(shape, (len(shape), count, len(double))))
    return np.concatenate(parts)


def _columns(residue: Float[np.ndarray, "output input"]) -> Float[np.ndarray, "rank one output"]:
    """Directions of the outputs in which a pole at zero is seen."""
    left, size, _ = np.linalg.svd(residue)
    return left[:, : int(np.sum(size > RANK * size[0]))].T[:, None, :]
