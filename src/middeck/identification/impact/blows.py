"""Find the blows of a hammer in a record, and reject the unusable ones.

A hammer pushes: what counts is force of the sign that most of the momentum has. Pulses that follow each other
much sooner than blows do are one blow that hit twice.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from middeck.errors import ConfigError, DataError
from middeck.identification.faults.equal_runs import levels_of, runs_of
from middeck.identification.faults.gaps_clipping_and_dropouts import DROP, find_clipping
from middeck.identification.model.refused_data import check_record
from middeck.signals.record import Record
from middeck.values import record as frozen

# A pulse rises above this share of the largest force, and above so many deviations of the force's noise.
LEAST, CLEAR = 0.02, 10.0
# A later push of this share of the pulse, above the median of the force for so many pulse lengths around it,
# is kept by the force window: what a window removes of a real force is an error of the response of its size.
FAINT, AROUND = 0.002, 4
# A pulse of the other sign and this share of the largest force, apart from all blows, is a blow with a wrong
# sign. Ringing of filters has less, and is beside its pulse.
REVERSED = 0.3
# What follows a pulse within so many samples may be the ringing of the filters. A second maximum of so much
# of the pulse is a hit: beyond the ringing, and within it.
RINGING, DOUBLE, DOUBLE_WITHIN = 8, 0.05, 0.1
# The edge of the force's band is where its power falls to this share of the largest; what is smoothed keeps
# frequencies up to this share of the edge, so that ringing there is weakened by e^-5.5.
EDGE, SMOOTH = 1e-3, 0.3
# A maximum is one if the force falls to this share of it on the way to the pulse.
VALLEY = 0.7
# Pulses closer than this share of the longest time between two are one blow.
CLOSE = 0.25
# A blow of less than this share of the median one is weak; one with less time than this of the median is cut.
WEAK, SHORT = 0.1, 0.5
# Samples of a block before its pulse, for the ringing of filters that are symmetric in time.
BEFORE = 32
# Response just before a blow, as a share of the rms just after it, that is too much of the blow before.
STILL_RINGING = 0.3


@frozen(kw_only=True)
class Blow:
    """One blow.

    Attributes:
        experiment: Number of its experiment.
        first, struck, last: Its block: first sample, that of the largest force, and the one after the last.
        pulse_end: The sample after the pulse.
        force_end: The sample after the last push, later hits too weak to reject the blow included.
        peak: Largest force.
        rejected: Why it is no use; empty for a good one.
    """

    experiment: int
    first: int
    struck: int
    last: int
    pulse_end: int
    force_end: int
    peak: float
    rejected: str = ""


def locate_blows(record: Record, *, blow_s: float | None = None) -> tuple[Blow, ...]:
    """All blows of a record of one force, in order, the bad ones with the reason.

    Rejected are double hits, overloads (a channel that clips), weak blows, blows whose force has the other
    sign, blows cut short by the next one or by the end, and those struck while the response still rings from
    the one before.

    Args:
        blow_s: Least time between two blows [s]; by default a quarter of the longest in the record.

    Raises `ConfigError` if the record has several inputs, or is periodic; `DataError` if no blow is found.
    """
    check_record(record)
    if len(record.inputs) != 1 or record.periodic:
        raise ConfigError(
            "an impact test has one input, the force of the hammer, and no periods",
            hint="name the force alone as input; one record for each place that was struck",
        )
    u, y = (x.reshape(len(x), -1, x.shape[3]) for x in (record.u, record.y))
    force = u[:, :, 0] - np.median(u[:, :, 0], axis=1, keepdims=True)
    force = force * _sign(force)
    pulses = [_pulses(x, float(force.max())) for x in force]
    if not any(pulses):
        raise DataError(
            "no blow was found: no peak of the force stands out of its usual level",
            where=f"input {record.inputs[0].name}",
            hint="check which channel is the force; middeck identify takes any other excitation",
        )
    apart = _least_apart(pulses, u.shape[1]) if blow_s is None else blow_s * record.sample_hz
    found: list[Blow] = []
    for e, (x, own) in enumerate(zip(force, pulses, strict=True)):
        pulls = _pulls(x, own, apart, float(force.max()))
        turned = np.array(x)
        for a, b in pulls:
            turned[a:b] *= -1.0
        blows = _blows(e, turned, sorted(own + pulls), apart, record.sample_hz)
        found += [_of_sign(blow, pulls) for blow in blows]
    found = _judged(found, record.sample_hz)
    found = _overloads(found, record, u, y)
    return tuple(_ringing(found, y))


def _sign(force: Float[np.ndarray, "experiment sample"]) -> float:
    """Sign of the blows together: one that is harder than all others may have the wrong one."""
    size = np.abs(force)
    return float(np.copysign(1.0, np.sum(force[size > REVERSED * size.max()])))


def _noise(force: Float[np.ndarray, " sample"]) -> float:
    return 1.4826 * float(np.median(np.abs(force)))


def _pulls(
    force: Float[np.ndarray, " sample"], pulses: list[tuple[int, int]], apart: float, largest: float
) -> list[tuple[int, int]]:
    """Pulses of the other sign, as large as blows and apart from all of them but for their own ringing."""
    blows = [a for a, b in pulses if force[a:b].max() > REVERSED * largest]
    return [
        (a, b)
        for a, b in _pulses(-force, largest)
        if -force[a:b].min() > REVERSED * largest and all(abs(a - own) >= apart for own in blows)
    ]


def _of_sign(blow: Blow, pulls: list[tuple[int, int]]) -> Blow:
    if not any(a <= blow.struck < b for a, b in pulls):
        return blow
    why = "wrong sign: the force pulls where that of the other blows pushes"
    return dataclasses.replace(blow, rejected=why)


def _pulses(force: Float[np.ndarray, " sample"], largest: float) -> list[tuple[int, int]]:
    """Runs of force, those joined that the ringing of a filter parts."""
    joined: list[tuple[int, int]] = []
    for a, b in runs_of(force > max(LEAST * largest, CLEAR * _noise(force))):
        if joined and a - joined[-1][1] < RINGING:
            joined[-1] = joined[-1][0], b
        else:
            joined.append((a, b))
    return joined


def _least_apart(pulses: list[list[tuple[int, int]]], samples: int) -> float:
    gaps = [b[0] - a[0] for own in pulses for a, b in itertools.pairwise(own)]
    ends = [samples - own[-1][0] for own in pulses if own]
    return CLOSE * max([*gaps, *ends])


def _blows(
    experiment: int,
    force: Float[np.ndarray, " sample"],
    pulses: list[tuple[int, int]],
    apart: float,
    sample_hz: float,
) -> list[Blow]:
    groups: list[list[tuple[int, int]]] = []
    for pulse in pulses:
        if groups and pulse[0] - groups[-1][0][0] < apart:
            groups[-1].append(pulse)
        else:
            groups.append([pulse])
    if not groups:
        return []
    begins = [max(own[0][0] - BEFORE, 0) for own in groups] + [len(force)]
    smooth = _without_ringing(force, groups)
    found: list[Blow] = []
    for k, own in enumerate(groups):
        a, b = max(own, key=lambda run: force[run[0] : run[1]].max())
        struck = a + int(np.argmax(force[a:b]))
        hit = _second_hit(force, smooth, own, struck)
        after_ms = 0.0 if hit is None else 1e3 * (hit - struck) / sample_hz
        place = f"{abs(after_ms):.3g} ms {'after' if after_ms > 0 else 'before'}"
        why = "" if hit is None else f"double hit: another of {force[hit] / force[struck]:.0%} {place}"
        found.append(
            Blow(
                experiment=experiment,
                first=begins[k],
                struck=struck,
                last=begins[k + 1],
                pulse_end=b,
                force_end=_last_push(force[: begins[k + 1]], smooth, (a, struck, b)),
                peak=float(force[struck]),
                rejected=why,
            )
        )
    return found


def _without_ringing(
    force: Float[np.ndarray, " sample"], groups: list[list[tuple[int, int]]]
) -> Float[np.ndarray, " sample"]:
    """The force below the edge of its band, where a steep filter rings: that has no momentum, a hit has.

    The band is that of the blows: over a whole record drift and hum may have more power than they.
    """
    struck = np.zeros(len(force))
    for own in groups:
        struck[max(own[0][0] - RINGING, 0) : own[-1][1] + RINGING] = 1.0
    power = np.abs(np.fft.rfft(struck * force)) ** 2
    edge = np.flatnonzero(power > EDGE * power.max())[-1]
    return gaussian_filter1d(force, len(force) / (2.0 * np.pi * SMOOTH * max(edge, 1)))


def _last_push(
    force: Float[np.ndarray, " sample"], smooth: Float[np.ndarray, " sample"], pulse: tuple[int, int, int]
) -> int:
    """The sample after the last push that stands out for as short a time as a hit, and is no ringing."""
    a, struck, b = pulse
    least, around = max(FAINT * force[struck], CLEAR * _noise(force)), AROUND * max(b - a, RINGING)
    end = b
    for first, last in runs_of(force[b:] > least):
        k = b + first + int(np.argmax(force[b + first : b + last]))
        level = float(np.median(force[max(k - around, b) : k + around + 1]))
        momentum = smooth[k] > 0.5 * force[k] / force[struck] * smooth[struck]
        if momentum and force[k] - level > least:
            end = b + last
    return end


def _second_hit(
    force: Float[np.ndarray, " sample"],
    smooth: Float[np.ndarray, " sample"],
    pulses: list[tuple[int, int]],
    struck: int,
) -> int | None:
    """The largest other maximum that is no ringing; None for a single hit."""
    hits: list[int] = []
    for a, b in pulses:
        for k in range(max(a, 1), min(b, len(force) - 1)):
            if k == struck or force[k] < force[k - 1] or force[k] <= force[k + 1]:
                continue
            between = force[min(k, struck) : max(k, struck) + 1].min()
            least = DOUBLE if abs(k - struck) > RINGING else DOUBLE_WITHIN
            momentum = smooth[k] > 0.5 * least * smooth[struck]
            if momentum and force[k] > least * force[struck] and between < VALLEY * force[k]:
                hits.append(k)
    return max(hits, key=lambda k: force[k], default=None)


def _judged(blows: list[Blow], sample_hz: float) -> list[Blow]:
    """Reject weak blows, and blows cut short."""
    peak = float(np.median([b.peak for b in blows]))
    length = float(np.median([b.last - b.first for b in blows]))
    found: list[Blow] = []
    for blow in blows:
        size = blow.last - blow.first
        why = blow.rejected
        if not why and blow.peak < WEAK * peak:
            why = f"weak: {blow.peak / peak:.1%} of the median force"
        if not why and size < SHORT * length:
            why = f"cut short after {size / sample_hz:.3g} s by the next blow or the end of the record"
        found.append(dataclasses.replace(blow, rejected=why))
    return found


def _overloads(blows: list[Blow], record: Record, u: np.ndarray, y: np.ndarray) -> list[Blow]:
    """Blows in whose block a channel clips."""
    found = blows
    for ports, x in ((record.inputs, u), (record.outputs, y)):
        for k, port in enumerate(ports):
            for e, channel in enumerate(x[..., k]):
                for a, b in _clipped(channel, float(x[..., k].min()), float(x[..., k].max())):
                    why = f"overload: {port.name} clips at {channel[a]:.4g} {port.unit}".rstrip()
                    found = [
                        dataclasses.replace(blow, rejected=why)
                        if blow.experiment == e and blow.first < b and a < blow.last
                        else blow
                        for blow in found
                    ]
    return found


def _clipped(x: Float[np.ndarray, " sample"], low: float, high: float) -> list[tuple[int, int]]:
    """Runs of samples at a limit of the channel, over all its experiments."""
    levels, size = levels_of(x), np.abs(x - np.median(x))
    found = [run for fault in find_clipping(x, levels) for run in fault.samples]
    for limit in (low, high):
        # Neighbours that agree to the last digit at a limit, but for one where the channel rests: blows that
        # are equally hard have maxima that agree, each for itself.
        runs = runs_of((x == limit) & (size > 0.5 * size.max()))
        beside = [abs(x[k] - limit) for a, b in runs for k in (a - 1, b) if 0 <= k < len(x)]
        if any(b - a > 1 for a, b in runs) and float(np.mean(beside)) > DROP * levels.step:
            found += runs
    return found


def _ringing(blows: list[Blow], y: np.ndarray) -> list[Blow]:
    """Reject blows struck while the response is still large."""
    found: list[Blow] = []
    for blow in blows:
        after = y[blow.experiment, blow.struck : blow.last]
        before = y[blow.experiment, max(blow.first - BEFORE, 0) : blow.first]
        level = after.mean(axis=0)
        early = after[: max(len(after) // 8, 1)] - level
        size = np.sqrt(np.mean(early**2, axis=0))
        rings = np.sqrt(np.mean((before - level) ** 2, axis=0)) if len(before) else np.zeros_like(size)
        # A blow on the last sample of a record has no response.
        share = float(np.max(np.divide(rings, size, out=np.zeros_like(size), where=size > 0.0)))
        why = blow.rejected
        if not why and share > STILL_RINGING:
            why = f"struck while the response rings from before, at {share:.0%} of what this blow makes"
        found.append(dataclasses.replace(blow, rejected=why))
    return found
