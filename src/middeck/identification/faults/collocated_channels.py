"""Faults seen by comparing channels: duplicates, and collocated ones that contradict each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from middeck.identification.faults.equal_runs import FaultDraft, fault
from middeck.signals.fault import RecordFault
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record

# Two channels that agree so well are one signal; independent sensors differ by their noise.
ONE_SIGNAL = 1e-9
# Difference of two outputs of one signal over the noise of either: of independent noise it is 0.5 or more, as
# prediction from noisy samples makes noise up to 2.5 times as large. Earlier samples that predict the next,
# and the samples that are looked at.
SHARED, PAST, MOST = 0.2, 12, 4096
# Share of an output that is predicted but for rounding: it was computed, and has no noise.
NOISELESS = 1e-7
# Correlation from which two collocated sensors of one quantity are taken to see the same motion.
ALIKE = 0.7
# Delay between collocated sensors, [samples], from which it is reported: the phase of a sixth of a cycle at a
# third of the sampling rate.
LATE = 0.5
# A driven point takes power in: the share with the right sign less that with the wrong one is near 1. Below
# minus a half, three quarters have the wrong sign.
POWER = -0.5
FORCES = ("N", "N m", "Nm")


def find_pair_faults(record: Record) -> list[RecordFault]:
    """Duplicated outputs, and signs and delays of collocated channels."""
    inputs, outputs = (
        [(port, x[..., k].reshape(len(x), -1)) for k, port in enumerate(ports)]
        for ports, x in ((record.inputs, record.u), (record.outputs, record.y))
    )
    found: list[RecordFault] = []
    for k, (port, y) in enumerate(outputs):
        for other, z in outputs[:k]:
            same = _duplicate(y, z, other)
            noise = _noise_of_either(y[0], z[0], [u[0] for _, u in inputs]) if same else None
            same = [_unsure(f) if noise is None else f for f in same if noise is None or noise < SHARED]
            here = same or _collocated(record, port, y, other, z)
            found += [f.at("output", port) for f in here]
        for at, u in inputs:
            here = _duplicate(y, u, at) or _driven(port, y, at, u)
            found += [f.at("output", port) for f in here]
    return found


Runs = Float[np.ndarray, "experiment sample"]
Run = Float[np.ndarray, " sample"]


def _correlation(a: Runs, b: Runs) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    return float(np.sum(a * b)) / size if size else 0.0


def _duplicate(y: Runs, z: Runs, other: Port) -> list[FaultDraft]:
    alike = _correlation(y, z)
    if abs(alike) < 1.0 - ONE_SIGNAL:
        return []
    how = "the same signal as" if alike > 0.0 else "the same signal, turned round, as"
    return [fault("duplicate", f"{how} {other.name}", "check the wiring; leave one of them out")]


def _unsure(same: FaultDraft) -> FaultDraft:
    """The finding as a note, for outputs without noise: two sensors of one mode are equal as well."""
    what = f"{same.what}; no noise tells whether both are one signal or one mode"
    return replace(same, what=what, severity="note")


def _noise_of_either(y: Run, z: Run, inputs: list[Run]) -> float | None:
    """Difference of two proportional outputs over the noise of either: zero if they share it.

    Sensors of one mode are proportional, too. Noise is the part that neither past nor inputs predict; None:
    there is no noise.
    """
    past = min(PAST, len(y) // (8 * (1 + len(inputs))))
    if past < 1:
        return 0.0
    y, z = y - y.mean(), z - z.mean()
    rest = y - (y @ z) / (z @ z) * z
    channels = [x - x.mean() for x in (y, *inputs)]
    rows = [x[past - k : len(x) - k][-MOST:] for x in channels for k in range(past + 1)]
    basis = np.column_stack(rows[1:])
    left = rows[0] - basis @ np.linalg.lstsq(basis, rows[0], rcond=None)[0]
    noise = float(np.std(left))
    return float(np.std(rest)) / noise if noise > NOISELESS * float(np.std(y)) else None


def _collocated(record: Record, port: Port, y: Runs, other: Port, z: Runs) -> list[FaultDraft]:
    """Two sensors of one quantity at one point along one axis."""
    sign = _same_place(port.channel, other.channel)
    if sign == 0 or port.unit != other.unit:
        return []
    lag, alike = _lag(sign * y, z)
    if alike < -ALIKE:
        what = f"has the opposite sign of {other.name}, at the same place (correlation {alike:.2f})"
        return [fault("sign", what, "one of the two is mounted or calibrated with the wrong sign")]
    if alike > ALIKE and abs(lag) > LATE:
        when = f"{abs(lag):.1f} samples ({abs(lag) / record.sample_hz:.3g} s)"
        what = f"{when} {'after' if lag > 0 else 'before'} {other.name}, at the same place"
        return [fault("delay", what, "start the channels together, or shift one")]
    return []


def _same_place(a: Channel | None, b: Channel | None) -> int:
    """1 at one node along one axis, -1 along opposite ones, 0 elsewhere or unknown."""
    if a is None or b is None or not a.node or not a.direction or a.node != b.node:
        return 0
    if a.direction.lstrip("+-") != b.direction.lstrip("+-"):
        return 0
    return 1 if a.direction.startswith("-") == b.direction.startswith("-") else -1


def _lag(y: Runs, z: Runs) -> tuple[float, float]:
    """Samples by which ``y`` is later than ``z``, and their correlation there, whichever sign it has."""
    samples = y.shape[1]
    Y, Z = (np.fft.rfft(x - x.mean(axis=1, keepdims=True), 2 * samples) for x in (y, z))
    cross = np.fft.irfft(np.sum(Y * np.conj(Z), axis=0), 2 * samples)
    most = min(samples - 1, 1 + samples // 8)
    near = np.concatenate([cross[-most:], cross[: most + 1]])
    k = int(np.abs(near).argmax())
    size = np.sqrt(np.sum((y - y.mean()) ** 2) * np.sum((z - z.mean()) ** 2))
    shift = 0.0
    if 0 < k < len(near) - 1:  # the peak of a parabola through three
        left, peak, right = near[k - 1 : k + 2]
        shift = 0.5 * (left - right) / (left - 2.0 * peak + right)
    return k - most + float(shift), float(near[k] / size) if size else 0.0


def _driven(port: Port, y: Runs, at: Port, u: Runs) -> list[FaultDraft]:
    """A force and the motion where it acts: the article takes power in."""
    sign = _same_place(port.channel, at.channel)
    derivative = {"m": 1, "rad": 1, "m/s": 0, "rad/s": 0, "m/s^2": -1, "rad/s^2": -1}.get(port.unit)
    if sign == 0 or derivative is None or at.unit not in FORCES:
        return []
    share = _power_share(sign * y, u, derivative)
    if share > POWER:
        return []
    what = f"has the wrong sign against {at.name} there: the article gives off power ({share:.0%})"
    hint = f"turn the sign of the sensor or of {at.name}; a passive article takes power in"
    return [fault("sign", what, hint)]


def _power_share(y: Runs, u: Runs, derivative: int) -> float:
    """Power u v of the lines with its sign, over without, v from y by ``derivative`` differentiations.

    Squared: at a resonance the phase is sure, while a delay turns the small power between the modes round.
    """
    samples = y.shape[1]
    window = np.hanning(samples)
    Y, U = (np.fft.rfft(window * (x - x.mean(axis=1, keepdims=True)), axis=1)[:, 2:] for x in (y, u))
    line = 1j * np.arange(2, 2 + Y.shape[1])
    power = np.real(np.sum(np.conj(U) * Y, axis=0) * line**derivative)
    total = float(np.sum(power**2))
    return float(np.sum(power * np.abs(power))) / total if total else 0.0
