"""Check a record against a known response: signs, gains, swapped channels and delays."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import DataError
from middeck.identification.faults.equal_runs import FaultDraft, fault
from middeck.signals.fault import RecordFault
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse

# Share of an output's power in the band that the reference must explain before a fault of it is reported.
EXPLAINED = 0.5
# Gain from which a channel is reported: calibrations are good to some per cent, mistaken units are tens.
WRONG_GAIN = 1.5
# Delay [samples] from which it is reported.
LATE = 0.5
# A channel is taken for another if its own row leaves so much of its power unexplained, and the other row so
# much less of that.
LEFT, LESS = 0.01, 0.1


def compare_with_reference(record: Record, reference: FrequencyResponse) -> list[RecordFault]:
    """Contradictions of ``reference``, a response or a model's, with the same ports.

    Each output's lines are explained by what the reference makes of each input times a real gain, least
    squares over all experiments: gains of one say that all is well, an output of minus ones has the wrong
    sign, and an output that another row explains is that other one. The relative sign of an input and all
    outputs cannot be distinguished from an input of the wrong sign: the input is named.

    Raises `DataError` if ports differ or if no line of the record lies within the reference.
    """
    for side, ours, theirs in (
        ("inputs", record.inputs, reference.inputs), ("outputs", record.outputs, reference.outputs)
    ):  # fmt: skip
        if [p.name for p in ours] != [p.name for p in theirs]:
            what = f"the record has the {side} {', '.join(p.name for p in ours)}"
            raise DataError(what, hint=f"the reference has {', '.join(p.name for p in theirs)}")
    omega, U, Y = _lines(record, reference)
    H = _interpolated(reference, omega / (2.0 * np.pi))
    outputs = len(record.outputs)
    gains = np.empty((outputs, outputs, len(record.inputs)))
    explained = np.empty((outputs, outputs))
    delay = np.empty(outputs)
    for o in range(outputs):
        for row in range(outputs):
            gains[o, row], explained[o, row], late = _fit(Y[..., o], H[:, row], U, omega, record.sample_hz)
            delay[o] = late if row == o else delay[o]
    return _judge(record, gains, explained, delay)


Lines = Complex[np.ndarray, "line experiment"]


def _lines(record: Record, reference: FrequencyResponse) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """omega, U[line, experiment, input] and Y of the period averages within the reference's band."""
    u, y = record.u.mean(axis=1), record.y.mean(axis=1)
    samples = u.shape[1]
    if not record.periodic:  # leakage spreads over a few lines only
        window = np.hanning(samples)[None, :, None]
        u, y = (window * (x - x.mean(axis=1, keepdims=True)) for x in (u, y))
    f = np.fft.rfftfreq(samples, 1.0 / record.sample_hz)
    keep = (f >= reference.frequency_hz[0]) & (f <= reference.frequency_hz[-1]) & (f > 0.0)
    U, Y = (np.fft.rfft(x, axis=1).transpose(1, 0, 2)[keep] for x in (u, y))
    if not keep.any() or not np.any(U):
        raise DataError(
            "no line of the record lies within the reference", hint="a reference of the same band"
        )
    return 2.0 * np.pi * f[keep], U, Y


def _interpolated(reference: FrequencyResponse, f: Float[np.ndarray, " line"]) -> np.ndarray:
    lines = reference.frequency_hz
    flat = reference.H.reshape(len(lines), -1)
    real, imag = (
        np.stack([np.interp(f, lines, part[:, k]) for k in range(flat.shape[1])], axis=1)
        for part in (np.real(flat), np.imag(flat))
    )
    return (real + 1j * imag).reshape(len(f), *reference.H.shape[1:])


def _fit(
    Y: Lines, H: np.ndarray, U: np.ndarray, omega: np.ndarray, sample_hz: float
) -> tuple[np.ndarray, float, float]:
    """Real gain of each input's part, share of Y's power explained, and the delay [s] that explains most."""
    parts = H[:, None, :] * U  # line experiment input
    best = (np.zeros(H.shape[1]), -np.inf, 0.0)
    for late in np.arange(-20, 21) * 0.25 / sample_hz:
        turned = (parts * np.exp(-1j * omega * late)[:, None, None]).reshape(-1, parts.shape[2])
        A = np.concatenate([np.real(turned), np.imag(turned)])
        b = np.concatenate([np.real(Y).ravel(), np.imag(Y).ravel()])
        gain, *_ = np.linalg.lstsq(A, b, rcond=None)
        share = 1.0 - float(np.sum((b - A @ gain) ** 2) / np.sum(b**2))
        if share > best[1] + (1e-6 if late else 0.0):
            best = (gain, share, float(late))
    return best


def _judge(record: Record, gains: np.ndarray, explained: np.ndarray, delay: np.ndarray) -> list[RecordFault]:
    names, found = [p.name for p in record.outputs], list[RecordFault]()
    own = np.array([gains[o, o] for o in range(len(names))])  # output input
    swapped = set()
    for o in range(len(names)):
        row = int(explained[o].argmax())
        left, least = 1.0 - explained[o, o], 1.0 - explained[o, row]
        if row != o and left > LEFT and least < LESS * left and explained[o, row] > EXPLAINED:
            swapped.add(o)
            what = f"looks like {names[row]} of the reference"
            found.append(fault("swap", what, "check the wiring").at("output", record.outputs[o]))
    known = [o for o in range(len(names)) if o not in swapped and explained[o, o] > EXPLAINED]
    turned = [i for i in range(own.shape[1]) if known and np.all(own[known, i] < 0.0) and own.shape[1] > 1]
    # With one input, an output that alone is turned is at fault; if all are, it is the input.
    if own.shape[1] == 1 and len(known) > 1 and np.all(own[known, 0] < 0.0):
        turned = [0]
    for i in turned:
        what = "has the wrong sign against the reference, in all outputs"
        found.append(fault("sign", what, "turn its sign").at("input", record.inputs[i]))
    for o in known:
        here: list[FaultDraft] = []
        gain = own[o] * np.where(np.isin(np.arange(own.shape[1]), turned), -1.0, 1.0)
        if np.mean(gain) < 0.0:
            here.append(fault("sign", "has the wrong sign against the reference", "turn its sign"))
        size = float(np.sqrt(np.mean(gain**2)))
        if not 1.0 / WRONG_GAIN < size < WRONG_GAIN:
            what = f"is {size:.3g} times what the reference says"
            here.append(fault("gain", what, "check unit and calibration"))
        if abs(delay[o]) * record.sample_hz > LATE:
            what = f"is {1e3 * delay[o]:.3g} ms later than the reference says"
            here.append(fault("delay", what, "check triggers and filters"))
        found += [f.at("output", record.outputs[o]) for f in here]
    return found
