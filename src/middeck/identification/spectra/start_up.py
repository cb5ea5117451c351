"""The transient at the beginning of a repeated signal, and its drift: distinguished from noise, removed.

A repeated response is the same in every period. An output minus itself a period later is thus free motion,

    y[n] - y[n + N] = sum_m c_m (1 - exp(p_m N T)) exp(p_m n T) + noise,

whatever the response is. Its poles are found one by one, at the frequency where most is left and the decay
that explains most of it, and refined together (variable projection, Golub and Pereyra 1973), as long as the
description length falls (Rissanen 1978); those that hide each other are looked for together. If the motion
dies out early, the first periods are cut off; otherwise it is subtracted, and its uncertainty is added to the
variance of the average. Samples before the response to the first input are no motion, and are left out.

Steady forces that shake the article leave motion of its own, too, which is taken out alike: it is likelier as
noise where it fades in reversed time as well, and is then no transient in words.

A ramp, as of a sensor that warms up, adds a constant to that difference, by which it is found. In each period
it is the same sawtooth, so that no scatter between periods shows what it adds to all lines.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.levenberg_marquardt import LeastSquaresResult, Step, search
from middeck.identification.spectra.period_length import length_of_period
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.values import record as frozen

# Motions at most, and decays tried for each, as multiples of one over the length.
MOST_MOTIONS = 24
DECAYS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
# What each unknown costs beyond half of ln n. The largest of n lines of noise stands ln n above their mean,
# of differences over a period twice that, and noise that is coloured has peaks of its own.
DEAR = 6.0
# Turns below which a motion is too slow for one of an article that forces shake; and how many
# times what the best motion of the reversed record brings a motion must bring to be called a transient.
SLOW, BACK = 2.0, 3.0
# Radians by which the slowest motion turns or fades over the differences: below, it is a ramp or a parabola,
# whose size, beside a ramp, nothing determines.
SLOWEST = 1.0
# Motions that are tried together where each alone is not worth its unknowns, and numbers up to which they
# are: twelve take seconds there, and lines of a longer record are closer than its modes.
TOGETHER, FEW = 12, 20_000
# What free motions may be at most in the first period, over the outputs: a few that nearly repeat with the
# period cancel each other in the differences of periods, and may be any size. Nor may they leave more than a
# gain or a delay that changes would.
LARGEST = 1.0
# Part of a period that a delay may take, and deviations of noise beyond which a sample is no motion.
LATEST, OUTSIDE = 4, 6.0
# Lines to either side of a motion's own that its noise is seen on.
AROUND = 10
# Lines beyond the fastest of several on which noise is seen, and three times as many for how it falls.
BEYOND = 50
# A period is steady where no line of the motion left in it has more than this share of the power of noise.
LEFT = 0.1
# Share of the periods, and how many, that must remain for the others to be cut off.
ENOUGH, FEWEST = 0.5, 4
# Deviations from which on a ramp is taken out: a lesser one moves the first line by about one of its own.
STEEP = 4.0
# Share of a channel's rms from which a ramp is reported: a lesser one is taken out and counted as well.
TOLD = 0.05
# A pole leaves a basis undetermined below this share of its largest singular value.
SAME = 1e-9
STEPS = 30


@frozen
class StartUp:
    """The record without its start-up transient and its drift, and how they were removed.

    Attributes:
        record: The steady periods, or all of them without the free motion.
        what: Finding and correction in words; empty for a steady record, forces that shake it included.
        unknown: Covariance, per unit of that of the periods' differences, that the motion taken out adds to
            each line of an average of periods; that of a ramp as well.
        spread: Covariance of the differences' samples, of all outputs.
    """

    record: Record
    what: str
    unknown: Float[np.ndarray, " line"]
    spread: Float[np.ndarray, "output output"]

    def covariance(self, keep: np.ndarray) -> Float[np.ndarray, "line output output"]:
        """The addition to the covariance of the averaged outputs on the lines ``keep``."""
        return self.unknown[keep][:, None, None] * self.spread


def steadied(taken: Record) -> StartUp:
    """``taken`` as the steady record that it would have been; itself where it is steady."""
    steady, length = _steadied(taken), length_of_period(taken.u)
    if length is None:
        return steady
    what = (
        f"the inputs repeat after {length:.8g} samples, not after {taken.u.shape[2]}: lines may be wrong "
        "by far more than their deviations, and what looks like a transient may be that; take the record "
        "as one run (not periodic), or a rate of whole periods"
    )
    return dataclasses.replace(steady, what=_joined(what, steady.what))


def _steadied(taken: Record) -> StartUp:
    """The same, whether the inputs' period is that of the record or not."""
    periods, samples, outputs = taken.y.shape[1:]
    if periods < 2:
        return StartUp(taken, "", np.zeros(samples // 2 + 1), np.zeros((outputs, outputs)))
    u, told = _without_ramps(taken.u, taken.inputs, np.zeros(0, dtype=complex))[:2]
    taken = taken if u is taken.u else dataclasses.replace(taken, u=u)
    z = _differences(taken.y)
    size = np.sqrt(np.mean(np.var(z, axis=1), axis=0))
    size = np.where(size > 0.0, size, 1.0)  # an output that repeats to the digit
    target = _columns((z - z.mean(axis=1, keepdims=True)) / size)
    poles, left, is_free, late = _free_motions(target, samples, TOGETHER)
    if len(poles) and (
        _share(_motion(taken, poles, size, late)[0], taken) > LARGEST
        or np.sum(left**2) > np.sum(_but_changes(target, taken) ** 2)
    ):
        poles, left, is_free, late = _free_motions(target, samples, 1)
    own = left.reshape(-1, outputs) * size
    y, drifts, unknown = _without_ramps(taken.y, taken.outputs, poles)
    taken = taken if y is taken.y else dataclasses.replace(taken, y=y)
    steady = StartUp(taken, _joined(told, drifts), unknown, own.T @ own / len(own))
    if not len(poles):
        return steady
    found = _without_motion(steady, poles, size, late)
    return found if is_free else dataclasses.replace(found, what=steady.what)


def _without_motion(
    steady: StartUp, poles: Complex[np.ndarray, " pole"], size: Float[np.ndarray, " output"], late: int
) -> StartUp:
    """The first periods cut off if the free motion is soon over, else all less that motion.

    The first ``late`` samples, which have no such motion, are taken from the second period.
    """
    taken = steady.record
    periods, samples = taken.y.shape[1:3]
    y, unknown = _motion(taken, poles, size, late)
    first = max(_steady_from(y, np.diag(steady.spread), samples), int(late > 0))
    share = _share(y, taken)
    found = f"the periods begin with a transient, {share:.2g} of the output's rms in the first"
    if periods - first >= max(FEWEST, ENOUGH * periods):
        cut = dataclasses.replace(taken, u=taken.u[:, first:], y=taken.y[:, first:])
        found += f": the first {first} of {periods} are left out"
        return dataclasses.replace(steady, record=cut, what=_joined(found, steady.what))
    found += f": {len(poles)} free motions are subtracted from all {periods}, and their uncertainty"
    found += " is added to the variance; record more periods, or wait before recording"
    y = taken.y - y
    y[:, 0, :late] = y[:, 1, :late]
    return dataclasses.replace(
        steady,
        record=dataclasses.replace(taken, y=y),
        what=_joined(found, steady.what),
        unknown=steady.unknown + unknown,
    )


def _joined(*said: str) -> str:
    return "; ".join(filter(None, said))


def _differences(x: Float[np.ndarray, "experiment period sample channel"]) -> np.ndarray:
    """Each channel less itself a period later."""
    return (x[:, :-1] - x[:, 1:]).reshape(len(x), -1, x.shape[3])


def _columns(z: Float[np.ndarray, "experiment sample channel"]) -> Float[np.ndarray, "sample column"]:
    return np.moveaxis(z, 1, 0).reshape(z.shape[1], -1)


def _motion(
    taken: Record, poles: Complex[np.ndarray, " pole"], size: Float[np.ndarray, " output"], late: int
) -> tuple[Float[np.ndarray, "experiment period sample output"], Float[np.ndarray, " line"]]:
    """The free motion of all periods, and the variance of its mean for noise of one (`_continued`)."""
    experiments, periods, samples, outputs = taken.y.shape
    target = _columns(_differences(taken.y) / size)[late:]
    motion, unknown = _continued(poles, target, periods, samples)
    return np.moveaxis(motion.reshape(periods, samples, experiments, outputs), 2, 0) * size, unknown


def _but_changes(target: Float[np.ndarray, "sample column"], taken: Record) -> np.ndarray:
    """The differences less what a gain and a delay that change from each period to the next make of them."""
    steady = _columns(taken.y.mean(axis=1))
    left = target.reshape(-1, *steady.shape).copy()
    for column, response in enumerate((steady - steady.mean(axis=0)).T):
        Q, _ = np.linalg.qr(np.column_stack([response, np.gradient(response)]))
        left[:, :, column] -= left[:, :, column] @ Q @ Q.T
    return left


def _share(motion: Float[np.ndarray, "experiment period sample output"], taken: Record) -> float:
    """Size of the motion in the first period over that of the outputs in the last."""
    first, last = np.sum(motion[:, 0] ** 2, (0, 1)), np.sum(taken.y[:, -1] ** 2, (0, 1))
    return float(np.sqrt(np.max(first / last)))


def _without_ramps(
    x: Float[np.ndarray, "experiment period sample channel"],
    ports: Sequence[Port],
    poles: Complex[np.ndarray, " pole"],
) -> tuple[np.ndarray, str, Float[np.ndarray, " line"]]:
    """The channels without ramps beside free motion; sentences on these, and the remaining uncertainty.

    The last is as in `StartUp`: the square of the sawtooth by which a ramp may be wrong.
    """
    experiments, periods, samples, channels = x.shape
    z = _columns(_differences(x))
    ones, motion = np.ones((len(z), 1)), _basis(poles, len(z))
    amplitudes = np.linalg.lstsq(np.hstack([ones, motion]), z, rcond=SAME)[0]
    constant, left = amplitudes[0], z - np.hstack([ones, motion]) @ amplitudes
    # Accuracy of a constant beside the motion from differences that are steady noise.
    beside = ones - motion @ np.linalg.lstsq(motion, ones, rcond=SAME)[0]
    known = max(float(np.sum(beside**2)), np.finfo(float).tiny)
    rounding = SAME * np.sqrt(np.mean(x**2, axis=(1, 2))).ravel()
    strong = constant**2 * known / STEEP**2
    steep = (strong > np.mean(left**2, axis=0)) & (np.abs(constant) > rounding)
    # A motion that dies out, as an input's own, is not there in the second half; a ramp is as it is before.
    half = len(z) // 2
    steep &= np.abs(left[:half].mean(axis=0) - left[-half:].mean(axis=0)) < np.abs(constant)
    if not steep.any():
        return x, "", np.zeros(samples // 2 + 1)
    slope = np.where(steep, -constant / samples, 0.0)
    time = np.arange(periods * samples) - 0.5 * (periods * samples - 1)
    ramp = (slope.reshape(experiments, 1, channels) * time[:, None]).reshape(x.shape)
    # The bias of a gyro walks: a ramp is then part of the noise (`_gain`), the more so of few periods, whose
    # differences walk as well, and their mean as half a line does.
    walk = _level(left, 0, AROUND) * max(4.0 / (periods - 1), 1.0)
    drifts = np.where(steep & (strong > walk), np.abs(slope), 0.0)
    most = drifts.reshape(experiments, channels).max(axis=0) * len(time) / np.std(x, axis=(0, 1, 2))
    told = [
        f"{port.name} drifts by {drift:.2g} of its rms over the periods; the ramp is taken out"
        for port, drift in zip(ports, most, strict=True)
        if drift > TOLD
    ]
    sawtooth = np.fft.rfft(np.arange(samples) / samples)
    return x - ramp, _joined(*told), np.abs(sawtooth) ** 2 / known


def _late(left: Float[np.ndarray, "sample column"], samples: int) -> int:
    """First samples that are no free motion, by what the motions leave: a delay has let nothing through."""
    count = max(samples // LATEST, 1)
    noise = np.sqrt(np.mean(left[count:] ** 2, axis=0)) + np.finfo(float).tiny
    outside = np.flatnonzero((np.abs(left[:count]) > OUTSIDE * noise).any(axis=1))
    return int(outside[-1]) + 1 if len(outside) else 0


def _steady_from(
    motion: Float[np.ndarray, "experiment period sample output"], variance: np.ndarray, samples: int
) -> int:
    """First period from which no line of the motion counts against the noise of one period."""
    noise = 0.5 * samples * variance + np.finfo(float).tiny
    power = np.max(np.abs(np.fft.rfft(motion, axis=2)) ** 2, axis=2) / noise
    counts = np.flatnonzero((power > LEFT).any(axis=(0, 2)))
    return int(counts[-1]) + 1 if len(counts) else 0


def _free_motions(
    target: Float[np.ndarray, "sample column"], samples: int, together: int
) -> tuple[Complex[np.ndarray, " pole"], np.ndarray, bool, int]:
    """Poles, residual and kind of `_motions`, and the samples before them, which are left out."""
    poles, left, is_free = _motions(target, together)
    late = _late(left, samples) if len(poles) else 0
    return (*(_motions(target[late:], together) if late else (poles, left, is_free)), late)


def _motions(
    target: Float[np.ndarray, "sample column"], together: int
) -> tuple[Complex[np.ndarray, " pole"], np.ndarray, bool]:
    """Poles [1/sample] of the free motion in ``target``, the residual, and whether forces are no cause.

    What steady forces shake is as likely in reversed time; free motion grows in it.
    """
    theta, left, is_free = np.zeros(0), target, False
    while (more := _more(theta, left, target, together)) is not None:
        is_free = is_free or len(more.steps) > 1 or _turns(more.steps[0].omega, left) < SLOW
        is_free = is_free or more.gain > BACK * _backwards(left)
        theta, left = more.theta, more.left
    return _poles(theta), left, is_free


class _Motion(NamedTuple):
    """A motion as it was first seen, and the squares of each column without it, less those with it."""

    sigma: float
    omega: float
    fall: Float[np.ndarray, " column"]


class _More(NamedTuple):
    """Poles with some motions more, what they leave, and the log likelihood beyond the cost of these."""

    theta: np.ndarray
    left: np.ndarray
    steps: list[_Motion]
    gain: float


def _more(theta: np.ndarray, left: np.ndarray, target: np.ndarray, together: int) -> _More | None:
    """The next motion that is worth its unknowns, or the next few that are together and not backwards.

    Beside others that are still left, one alone does not stand out of the lines around it.
    """
    forth = _one_by_one(theta, left, target)
    one = next(forth, None)
    if one is not None and one.gain > 0.0:
        return one
    if one is None or together == 1 or target.size > FEW:
        return None
    back, reverse, due = _one_by_one(np.zeros(0), left[::-1], left[::-1]), None, 1
    for several in forth:
        due += 1
        if several.gain > 0.0:
            # As many motions in reversed time, or as many as are worth it there.
            reverse, due = [reverse, *itertools.islice(back, due)][-1], 0
            if several.gain > BACK * _likelihood(reverse):
                return several
    return None


def _one_by_one(theta: np.ndarray, left: np.ndarray, target: np.ndarray) -> Iterator[_More]:
    """One motion more each time, as long as the last was worth its unknowns among white noise."""
    cost = (2.0 + 2.0 * target.shape[1]) * (0.5 * np.log(target.size) + DEAR)
    steps: list[_Motion] = []
    while len(steps) < TOGETHER and len(theta) < 2 * MOST_MOTIONS and 4 * len(theta) < len(target):
        log_sigma, omega = _strongest(left)
        half = len(theta) // 2
        more = _refined(np.concatenate([theta[:half], [log_sigma], theta[half:], [omega]]), target)
        if more is None:
            return
        rest = _rest(more, target)
        before, after = (np.sum(x**2, axis=0) + np.finfo(float).tiny for x in (left, rest))
        steps.append(_Motion(float(np.exp(log_sigma)), omega, before - after))
        theta, left = more, rest
        yield _More(theta, left, steps, _gain(steps, left) - cost * len(steps))
        if not 0.5 * len(target) * np.sum(np.log(before / after)) > cost:
            return


def _turns(omega: float, left: Float[np.ndarray, "sample column"]) -> float:
    return omega * len(left) / (2.0 * np.pi)


def _backwards(left: Float[np.ndarray, "sample column"]) -> float:
    """Log likelihood that the best motion brings in reversed time."""
    return _likelihood(next(_one_by_one(np.zeros(0), left[::-1], left[::-1]), None))


def _likelihood(more: _More | None) -> float:
    return 0.0 if more is None else _gain(more.steps, more.left)


def _gain(steps: Sequence[_Motion], after: np.ndarray) -> float:
    """Log likelihood that motions bring, by the noise that is left on the lines around each.

    Forces that shake the article move it at its own frequencies too (`_motions`). The bias of a gyro walks:
    noise may grow towards rest as 1/f^2, and what is left on faster lines counts for so much more. Several
    motions leave none of a walk on the lines between them: it is continued from beyond the fastest.
    """
    gain, turns = 0.0, [_turns(step.omega, after) for step in steps]
    beyond = _beyond(after, max(turns)) if len(steps) > 1 else None
    for step, k in zip(steps, turns, strict=True):
        half = AROUND + int(2.0 * step.sigma * len(after) / np.pi)
        level = _level(after, round(k), half)
        if beyond is not None:
            power, line, slope = beyond
            level = np.maximum(level, power * (line / max(k, 1.0)) ** slope)
        gain += float(np.sum(step.fall / (2.0 * level)))
    return gain


def _beyond(
    left: Float[np.ndarray, "sample column"], k: float
) -> tuple[Float[np.ndarray, " column"], float, Float[np.ndarray, " column"]] | None:
    """Variance of noise beyond line k, its line, and the power (0 to 2) of 1/f with which it falls there.

    None where the lines end too soon.
    """
    edges = np.ceil(k) + AROUND + np.array([0, BEYOND, 4 * BEYOND])
    if edges[-1] > len(left) // 2:
        return None
    first, middle, last = edges.astype(int)
    power = np.abs(np.fft.rfft(left, axis=0)) ** 2 / len(left) + np.finfo(float).tiny
    near, far = power[first:middle].mean(axis=0), power[middle:last].mean(axis=0)
    # Noise that falls as 1/f^2 has its mean over lines a to b at the geometric mean of both.
    lines = np.sqrt(first * middle), np.sqrt(middle * last)
    return near, float(lines[0]), np.clip(np.log(near / far) / np.log(lines[1] / lines[0]), 0.0, 2.0)


def _level(left: Float[np.ndarray, "sample column"], k: int, half: int) -> Float[np.ndarray, " column"]:
    """Variance of noise on line k by the ``half`` lines to either side, which may grow as 1/f^2."""
    count = len(left)
    near = np.arange(max(k - half, 0), min(k + half, count // 2) + 1)
    power = np.abs(np.fft.rfft(left, axis=0)[near]) ** 2
    level = np.mean(power * (np.maximum(near / max(k, 1), 1.0) ** 2)[:, None], axis=0) / count
    return level + np.finfo(float).tiny


def _poles(theta: np.ndarray) -> Complex[np.ndarray, " pole"]:
    half = len(theta) // 2
    with np.errstate(over="ignore"):  # a step too long, which `_step` refuses
        return -np.exp(theta[:half]) + 1j * theta[half:]


def _strongest(left: Float[np.ndarray, "sample column"]) -> tuple[float, float]:
    """Log decay and angular frequency of the motion that explains most, on a grid."""
    count = len(left)
    best = (-1.0, 0.0, 0.0)
    for decay in DECAYS:
        sigma = decay / count
        window = np.exp(-sigma * np.arange(count))
        power = np.sum(np.abs(np.fft.rfft(left * window[:, None], 2 * count, axis=0)) ** 2, axis=1)
        k = int(np.argmax(power))
        explained = float(power[k]) / float(np.sum(window**2))
        if explained > best[0]:
            # At rest a motion has one column less, and none that turns by less is distinguished from it.
            best = (explained, float(np.log(sigma)), np.pi * max(k, 1) / count)
    return best[1], best[2]


def _basis(
    poles: Complex[np.ndarray, " pole"], count: int, power: int = 0
) -> Float[np.ndarray, "sample column"]:
    """n^power exp(p n) as real columns, real parts first."""
    n = np.arange(count)[:, None]
    return _as_real(np.exp(poles * n) * (n / count) ** power)


def _as_real(motion: Complex[np.ndarray, "sample pole"]) -> Float[np.ndarray, "sample column"]:
    """Motions as real columns, real parts first."""
    return np.concatenate([motion.real, -motion.imag], axis=1)


def _centred(columns: Float[np.ndarray, "sample column"]) -> Float[np.ndarray, "sample column"]:
    """The columns less their means, as the differences by which a ramp is detected."""
    return columns - columns.mean(axis=0)


def _refined(theta: np.ndarray, target: np.ndarray) -> np.ndarray | None:
    """The poles at which least is left, counted in units of that."""
    for _ in range(2):
        unit = float(np.sqrt(np.mean(_rest(theta, target) ** 2))) + np.finfo(float).tiny
        found: LeastSquaresResult | None = search(
            lambda x, below, unit=unit: _step(x, target / unit, below), theta, STEPS
        )
        if found is None:
            return None
        theta = found.theta
    return theta


def _rest(theta: np.ndarray, target: np.ndarray) -> np.ndarray:
    basis = _centred(_basis(_poles(theta), len(target)))
    return target - basis @ np.linalg.lstsq(basis, target, rcond=SAME)[0]


def _step(theta: np.ndarray, target: np.ndarray, below: float) -> Step | None:
    """Half the squared residual, if ``below``, and its slopes by decays and frequencies (Kaufman 1975)."""
    poles, half = _poles(theta), len(theta) // 2
    if np.real(poles).min() < -np.pi or np.abs(poles).min() * len(target) < SLOWEST:
        return None
    n = np.arange(len(target))[:, None]
    motion = np.exp(poles * n)
    basis = _centred(_as_real(motion))
    Q, R = np.linalg.qr(basis)
    size = np.abs(np.diag(R))
    if not np.isfinite(basis).all() or size.min() <= SAME * size.max():
        return None
    on = Q.T @ target
    left, a = target - Q @ on, np.linalg.solve(R, on)
    cost = 0.5 * float(np.sum(left**2))
    if not cost < below:
        return None
    motion *= n
    rows = np.empty((2 * half, target.size))
    for m in range(half):
        # Slopes of a Re(e) - b Im(e), e = exp(p n): each derivative by p multiplies e by n.
        real, imag = motion[:, m : m + 1].real, motion[:, m : m + 1].imag
        by_p = real * a[m] - imag * a[half + m]
        by_turn = -imag * a[m] - real * a[half + m]
        for row, slope in ((m, poles[m].real * by_p), (half + m, by_turn)):
            slope = _centred(slope)
            rows[row] = (slope - Q @ (Q.T @ slope)).ravel()
    return Step(cost=cost, gradient=-rows @ left.ravel(), gram=rows @ rows.T, linear=a)


def _continued(
    poles: Complex[np.ndarray, " pole"], target: np.ndarray, periods: int, samples: int
) -> tuple[Float[np.ndarray, "sample column"], Float[np.ndarray, " line"]]:
    """The motion itself over all periods, and the variance of its average's lines for differences of one.

    A pole that is not known exactly adds n exp(p n).
    """
    count = periods * samples
    one, wide = _basis(poles, count), np.hstack([_basis(poles, count), _basis(poles, count, 1)])
    late = count - samples - len(target)
    amplitudes = np.linalg.lstsq((one[:-samples] - one[samples:])[late:], target, rcond=SAME)[0]
    _, size, right = np.linalg.svd((wide[:-samples] - wide[samples:])[late:], full_matrices=False)
    known = size > SAME * size[0]
    lines = np.fft.rfft(wide.reshape(periods, samples, -1).mean(axis=0), axis=0)
    unknown = np.sum(np.abs(lines @ (right[known] / size[known, None]).T) ** 2, axis=1)
    return one @ amplitudes, unknown
