"""The force of an AC-coupled hammer, as it was before its sensor blocked the mean.

An ICP (IEPE) sensor or a charge amplifier of time constant tau multiplies the force by s tau / (1 + s tau).
After a blow of impulse I its reading is -I / tau, and decays with tau. Only the blow itself is kept by the
force window, which is then neither the force nor its reading: delays and gains would be wrong by hundredths
of a period of the lowest line. The tail is known from the pulses but for tau, so that it is found by least
squares over the samples between the blows, and taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.optimize
import scipy.signal
from jaxtyping import Bool, Float

from middeck.identification.impact.blows import BEFORE, Blow

# Samples of the force window's slope after the pulse: the ringing of filters.
SLOPE = 32
# Time constants that are tried: from so many pulse lengths on to so many records, and how many.
SHORTEST, LONGEST, TRIED = 5.0, 20.0, 40
# Deviations of a tail that is none by chance, for means over so many parts of an experiment; and by how much
# its impulse may differ from that of the blows: both are the same force.
TOLD, BLOCKS, SAME = 6.0, 128, 0.25
# Variances of a random walk's end that are tried, over that of white noise in the mean of a part.
WALKS = (0.0, *np.logspace(-2, 6, 17))
# How often the pulses are found anew without the tail.
TIMES = 5


class CoupledForce(NamedTuple):
    """The force without the tails of its blows, and the time constant [s]; infinite where there are none."""

    force: Float[np.ndarray, "experiment sample"]
    tau_s: float


def released_force(
    force: Float[np.ndarray, "experiment sample"], blows: Sequence[Blow], sample_hz: float
) -> CoupledForce:
    """The ``force`` before an AC-coupled sensor, if its reading is that of one."""
    struck = np.zeros(force.shape, bool)
    for b in blows:
        struck[b.experiment, max(b.struck - BEFORE, 0) : _last(b)] = True
    rest = ~struck
    if rest.mean() < 0.5:
        return CoupledForce(force, np.inf)
    pulse_s = max(float(np.median([b.pulse_end - b.struck for b in blows])), 1.0) / sample_hz
    low, high = np.log(SHORTEST * pulse_s), np.log(LONGEST * force.shape[1] / sample_hz)
    level = np.array([np.median(x[r]) for x, r in zip(force, rest, strict=True)])[:, None]
    tail, tau = np.zeros(force.shape), np.inf
    for _ in range(TIMES):
        pulses = np.where(struck, force - level - tail, 0.0)

        def left(log_tau: float, pulses: np.ndarray = pulses) -> float:
            return float(np.sum(_off_rest(force - _tail(pulses, np.exp(log_tau), sample_hz), rest) ** 2))

        tried = np.linspace(low, high, TRIED)
        k = int(np.argmin([left(x) for x in tried]))
        near = tried[max(k - 1, 0)], tried[min(k + 1, TRIED - 1)]
        tau = float(np.exp(scipy.optimize.minimize_scalar(left, bounds=near, method="bounded").x))
        tail = _tail(pulses, tau, sample_hz)
        level = np.mean(force - tail, axis=1, where=rest, keepdims=True)
    return CoupledForce(force - tail, tau) if _is_tail(force, tail, rest) else CoupledForce(force, np.inf)


def _last(blow: Blow) -> int:
    return min(max(2 * blow.pulse_end - blow.struck, blow.force_end) + SLOPE, blow.last)


def _tail(
    pulses: Float[np.ndarray, "experiment sample"], tau: float, sample_hz: float
) -> Float[np.ndarray, "experiment sample"]:
    """What a coupling takes off the force: its convolution with exp(-t / tau) / tau.

    Each sample's step is by the cubic through its four neighbours (Adams and Moulton): trapezia would be late
    by the square of the sampling period over 12 tau.
    """
    step = 1.0 / (sample_hz * tau)
    later = np.pad(pulses, ((0, 0), (0, 1)))
    found = scipy.signal.lfilter(
        np.array([-1.0, 13.0, 13.0, -1.0]) / 24.0, [1.0, -np.exp(-step)], later, axis=1
    )
    return -step * found[:, 1:]


def _off_rest(
    x: Float[np.ndarray, "experiment sample"], rest: Bool[np.ndarray, "experiment sample"]
) -> Float[np.ndarray, " some"]:
    """At rest, without the level and the ramp of each experiment."""
    found = []
    for own, at in zip(x, rest, strict=True):
        time = np.flatnonzero(at) / len(own) - 0.5
        basis = np.linalg.qr(np.column_stack([np.ones(len(time)), time]))[0]
        found.append(own[at] - basis @ (basis.T @ own[at]))
    return np.concatenate(found)


def _is_tail(force: np.ndarray, tail: np.ndarray, rest: np.ndarray) -> bool:
    """Whether what the sensor reads at rest is the tail of its own blows, in size, too.

    Generalised least squares of means over time, with the likeliest mix of white noise and a random walk:
    steps of a drift at the blows of some experiments pass for tails where its noise is taken for white.
    """
    if not tail.any():
        return False
    means = [_means(*own) for own in zip(tail, force, rest, strict=True)]
    share, deviation = min((_by_walk(means, walk) for walk in WALKS), key=lambda fit: fit[0])[1:]
    return abs(share) > TOLD * deviation and abs(share - 1.0) < SAME


class _Means(NamedTuple):
    """Means of the tail and of the force at rest over equal times, when and of how many samples."""

    tail: Float[np.ndarray, " part"]
    force: Float[np.ndarray, " part"]
    time: Float[np.ndarray, " part"]
    count: Float[np.ndarray, " part"]


def _means(tail: np.ndarray, force: np.ndarray, rest: np.ndarray) -> _Means:
    at = np.flatnonzero(rest)
    part = at * BLOCKS // len(rest)
    count = np.bincount(part, minlength=BLOCKS)
    some = count > 0
    found = (np.bincount(part, x[at], BLOCKS)[some] / count[some] for x in (tail, force))
    time = np.bincount(part, at, BLOCKS)[some] / count[some] / len(rest)
    return _Means(*found, time, count[some] / (len(rest) / BLOCKS))


def _by_walk(means: Sequence[_Means], walk: float) -> tuple[float, float, float]:
    """Twice the negative logarithm of likelihood, the tail's share and its deviation, for a walk's size."""
    rows, logarithms = [], 0.0
    for own in means:
        root = np.linalg.cholesky(np.diag(1.0 / own.count) + walk * np.minimum.outer(own.time, own.time))
        still = np.column_stack([np.ones(len(own.time)), own.time])
        basis = np.linalg.qr(np.linalg.solve(root, still))[0]
        both = np.linalg.solve(root, np.column_stack([own.tail, own.force]))
        rows.append(both - basis @ (basis.T @ both))
        logarithms += 2.0 * float(np.sum(np.log(np.diag(root))))
    by, y = np.concatenate(rows).T
    share = float(by @ y / (by @ by))
    left = float(np.sum((y - share * by) ** 2)) + np.finfo(float).tiny
    freedom = len(y) - 2 * len(means) - 1
    return len(y) * np.log(left) + logarithms, share, np.sqrt(left / freedom / float(by @ by))
