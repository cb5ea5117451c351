"""Spikes: few samples far outside of all beside them; and records of impacts, which consist of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.ndimage
from jaxtyping import Bool, Float

from middeck.identification.faults.equal_runs import (
    ROUNDING,
    FaultDraft,
    Levels,
    Runs,
    Signal,
    fault,
    runs_of,
)

# Spikes: samples on each side that a spike is compared with, the nearest left out, and by how many times
# their span it leaves it. Of Gaussian samples one in 1e9 does.
BESIDE, LEAP = 12, 2.0
# Samples beside those are of the same spike if they leave it by so many times the span, and lie off by such a
# share of what its largest does.
BELONGS, SHARES = 1.0, 0.5
# Samples on each side that are left out where longer ones are sought: so many and one may be one spike.
WIDE = 8
# Samples so many times beyond the hundredth that are largest, no more than a share of all, are not among
# those that others are compared with: of two spikes close together neither would be outside of the other.
FAR, HUNDREDTH, FEW = 3.0, 0.99, 0.005
# Spikes among large samples of the signal's own: residuals of a prediction from so many samples before. The
# largest, a share but no fewer than FEWEST_LARGE, tell the tail; chance is beyond it in one of e^BEYOND.
PREDICTED_FROM, LARGE, FEWEST_LARGE, BEYOND = 16, 0.01, 20, 7.0
# Samples by which an output may follow a spike or a step of an input and be its response.
ANSWERS = WIDE + 2
# Share of the largest sample of a run that one beside it has where the run is the middle of a longer one.
LASTS = 0.8
# Inputs with so much of their energy in spikes are impacts.
IMPACTS = 0.1
# Times by which an input beside its spikes improves a prediction where it is none of a hammer, and samples
# that show it.
BETTER, MOST_ROWS = 2.0, 20_000
# Share of a sample at an edge that the next one inward has of it, from which on the two are one decay.
DECAYS = 0.2
# A decay that leaves its first sample outside of the rest falls to 0.58 or less from each to the next.
FALLS = 1.5


def find_spikes(x: Signal, levels: Levels, driven: Runs | None = None) -> list[FaultDraft]:
    """Runs of one to nine samples far outside of their neighbours, the signal's tail and any response.

    ``driven`` are spikes of the inputs, to which an output may respond.
    """
    runs = [r for r in spike_runs(x, levels) if not _answers(r, driven or [])]
    if not runs:
        return []
    largest = max(float(np.abs(x[a:b] - np.median(x)).max()) for a, b in runs)
    what = f"{len(runs)} spikes up to {largest:.3g}, first at {runs[0][0]}"
    hint = "check for loose contacts and switching nearby; repair the samples, or leave the period out"
    return [fault("spike", what, hint, samples=runs)]


def spike_runs(x: Signal, levels: Levels) -> Runs:
    """Samples outside of their neighbours, other than large samples as elsewhere in the signal.

    >>> from middeck.identification.faults.equal_runs import levels_of
    >>> rng = np.random.default_rng(0)
    >>> x = rng.laplace(size=4000)
    >>> x[70] = 60.0
    >>> spike_runs(x, levels_of(x))
    [(70, 71)]
    """
    runs = _outside_runs(x, levels.step)
    if not runs:
        return []
    left, limit = _tail(x, runs)
    return [(a, b) for a, b in runs if left[a:b].max() > limit]


def _tail(x: Signal, runs: Runs) -> tuple[Signal, float]:
    """Linear prediction error of each sample, and the limit that chance hardly exceeds.

    The largest residuals of the rest are taken for a power law (Hill 1975): exact for heavy tails, and for
    lighter ones, exponential or normal, on the safe side.
    """
    rest = np.ones(len(x), dtype=bool)
    for a, b in runs:
        # The first samples are predicted from those after them, up to twice as far in.
        rest[max(a - PREDICTED_FROM, 0) if a < 2 * PREDICTED_FROM else a : b + PREDICTED_FROM] = False
    if not rest.any():  # steps or pulses all along: the signal itself
        return np.zeros(len(x)), np.inf
    level = np.where(rest, x, np.interp(np.arange(len(x)), np.flatnonzero(rest), x[rest]))
    before = min(PREDICTED_FROM, len(x) // 4)
    past = np.fft.irfft(np.abs(np.fft.rfft(level - level.mean(), 2 * len(x))) ** 2)[: before + 1]
    # A share of white noise, as small as the rounding of a good converter, keeps the equations determined.
    column = past[:-1] + np.eye(1, before)[0] * 1e-9 * past[0]
    weights = scipy.linalg.solve_toeplitz(column, past[1:]) if past[0] > 0.0 else np.zeros(before)
    ahead = np.concatenate([[1.0], -weights])
    left = np.abs(np.convolve(ahead, x - level.mean())[: len(x)])
    # The first samples have none before them: they are predicted from those after, by the same weights.
    left[:before] = np.abs(np.convolve(ahead, x[::-1] - level.mean())[: len(x)])[::-1][:before]
    clean = np.sort(left[rest])
    large = clean[-max(FEWEST_LARGE, int(LARGE * len(clean))) :]
    least = max(float(large[0]), np.finfo(float).tiny)
    slope = float(np.mean(np.log(np.maximum(large, least) / least)))
    return left, least * float(np.exp(min(slope * (np.log(len(large)) + BEYOND), 300.0)))


def _answers(run: tuple[int, int], driven: Runs) -> bool:
    return any(a <= run[0] <= b - 1 + ANSWERS for a, b in driven)


def _outside_runs(x: Signal, step: float) -> Runs:
    if len(x) < 2 * BESIDE + 5:
        return []
    others = _without_far(x)
    found = _outside(x, others, step, 1, LEAP)
    if len(x) > 4 * (BESIDE + WIDE):
        inner = slice(BESIDE + WIDE, -BESIDE - WIDE)
        wide, whole = (np.zeros(len(x), dtype=bool) for _ in range(2))
        wide[inner] = _outside(x, others, step, WIDE, LEAP)[inner]
        whole[inner] = _outside(x, others, step, WIDE, BELONGS)[inner]
        found |= wide
        for a, b in runs_of(whole):
            if b - a <= WIDE + 1 and wide[a:b].any():
                off = np.abs(x[a:b] - _rest(x, a, b))
                found[a:b] |= off > SHARES * off[wide[a:b]].max()
    return [run for run in runs_of(found) if not (_decays(x, run) or _goes_on(x, run))]


def _without_far(x: Signal) -> Signal:
    """The signal through runs of few samples that are far beyond nearly all others."""
    off = np.abs(x - np.median(x))
    far = off > FAR * float(np.quantile(off, HUNDREDTH))
    if not 0 < np.sum(far) <= FEW * len(x) or any(b - a > WIDE + 1 for a, b in runs_of(far)):
        return x
    return np.where(far, np.interp(np.arange(len(x)), np.flatnonzero(~far), x[~far]), x)


def _outside(x: Signal, others: Signal, step: float, near: int, leap: float) -> Bool[np.ndarray, " sample"]:
    """Samples ``leap`` spans outside of the ``others`` more than ``near``, and BESIDE - 1 more, away."""
    highest = _beside(others, scipy.ndimage.maximum_filter1d, near)
    lowest = -_beside(-others, scipy.ndimage.maximum_filter1d, near)
    beyond = np.maximum(x - highest, lowest - x)
    return (beyond > leap * (highest - lowest) + 5.0 * step) & (beyond > ROUNDING * np.abs(x).max())


def _beside(x: Signal, largest: Callable[..., np.ndarray], near: int) -> Signal:
    """The largest of BESIDE - 1 samples on each side of those ``near``, at an edge as many from inside."""
    size = BESIDE - 1
    # The window of BESIDE - 1 samples that ends just before those near, and the one that begins after them.
    shift = near + 1 + size // 2
    inner = largest(x, size)
    around = np.maximum(np.roll(inner, shift), np.roll(inner, -shift))
    around[: BESIDE + 1] = _most_beside(x[: 2 * BESIDE + 3])
    around[: -BESIDE - 2 : -1] = _most_beside(x[: -2 * BESIDE - 4 : -1])
    return around


def _most_beside(window: Signal) -> Signal:
    """The largest sample that is not next to it, for each of the first BESIDE + 1 samples."""
    before = np.maximum.accumulate(np.concatenate([[-np.inf, -np.inf], window]))[: BESIDE + 1]
    after = np.maximum.accumulate(window[::-1])[::-1][2 : BESIDE + 3]
    return np.maximum(before, after)


def _decays(x: Signal, run: tuple[int, int]) -> bool:
    """Whether a run at an edge decays into what follows, as free motion does."""
    a, b = run
    if a <= BESIDE:
        inward = x[a : a + 2 * BESIDE + 3]
    elif b >= len(x) - BESIDE:
        inward = x[b - 1 : b - 2 * BESIDE - 4 : -1]
    else:
        return False
    off = np.abs(inward - np.median(inward[b - a + 1 :]))
    # The next one of a decay is itself outside of what comes after; beside a spike any sample may lie.
    return bool(off[b - a] > max(DECAYS * off[b - a - 1], FALLS * off[b - a + 1 :].max()))


def _goes_on(x: Signal, run: tuple[int, int]) -> bool:
    """Whether samples beside a run are off the median too: part of a longer level, as of a square wave."""
    a, b = run
    off = np.abs(x[max(a - 1, 0) : b + 1] - _rest(x, a, b))
    return bool(max(off[0] * (a > 0), off[-1] * (b < len(x))) > LASTS * off[min(a, 1) : b - a + 1].max())


def _rest(x: Signal, a: int, b: int) -> float:
    """The median of the samples of a run and beside it."""
    return float(np.median(x[max(a - BESIDE - WIDE, 0) : b + BESIDE + WIDE]))


def is_impact(x: Signal) -> bool:
    """Whether much of the energy is in spikes, as with a hammer."""
    swing = x - np.median(x)
    energy = sum(float(np.sum(swing[a:b] ** 2)) for a, b in _outside_runs(x, 0.0))
    return energy > IMPACTS * float(np.sum(swing**2))


def moves_by_the_rest(
    x: Signal, others: Float[np.ndarray, "sample input"], outputs: Float[np.ndarray, "sample output"]
) -> bool:
    """Whether an input moves an output beside its spikes and not by them: they are no blows of a hammer.

    Between blows an output moves by what the other inputs do, and samples before predict it as well without
    this one. Where it improves that prediction, it shows what the output would do at a spike that was a
    force. Beside a copy of it, as of its command, it improves nothing; then it does so without the others,
    and no output may be off at the spikes.
    """
    before = min(PREDICTED_FROM, len(x) // 16)
    rest = np.ones(len(x), dtype=bool)
    for a, b in _outside_runs(x, 0.0):
        rest[max(a - 2 * BESIDE, 0) : b + 2 * BESIDE] = False
    rows = np.all(_past(rest, before), axis=1)
    if before < 4 or np.sum(rows) < 2 * (2 + others.shape[1]) * before:
        return False
    beside = np.interp(np.arange(len(x)), np.flatnonzero(rest), x[rest])
    inputs = _past(x - x[rest].mean(), before), _past(beside - x[rest].mean(), before)
    others, outputs = (each - each[rest].mean(axis=0) for each in (others, outputs))
    also = np.hstack([np.empty((len(rows), 0)), *(_past(v, before) for v in others.T)])

    def shares(known: np.ndarray) -> np.ndarray:
        return np.array([_shares(_past(y, before), known, *inputs, rows) for y in outputs.T]).T

    def moves(gain: np.ndarray, spiky: np.ndarray, plain: np.ndarray, _: np.ndarray) -> bool:
        return bool(gain.max() > BETTER and spiky.sum() > BETTER * plain.sum())

    found = shares(also)
    if moves(*found) or not others.size:
        return moves(*found)
    return bool(found[3].max() < BETTER) and moves(*shares(also[:, :0]))


def _past(x: np.ndarray, before: int) -> np.ndarray:
    """Each sample with so many before it, the oldest first."""
    return np.lib.stride_tricks.sliding_window_view(x, before + 1)


def _shares(
    y: np.ndarray, also: np.ndarray, with_spikes: np.ndarray, without: np.ndarray, rows: np.ndarray
) -> tuple[float, float, float, float]:
    """What predictions of an output leave, over what the one with the input leaves on ``rows``.

    From itself and what is ``also`` known, on ``rows``; and on the others, the input with its spikes and
    without. The last is what the first leaves on the others, over that on ``rows``.
    """
    known, at = np.flatnonzero(rows)[:MOST_ROWS], ~rows
    last, own = y[known, -1], np.hstack([y[known, :-1], also[known]])
    both = np.hstack([own, without[known]])
    alone, weights = (_weights(columns, last) for columns in (own, both))
    left = float(np.mean((last - both @ weights) ** 2)) + np.finfo(float).tiny
    on = (np.hstack([y[at, :-1], also[at], u[at]]) @ weights for u in (with_spikes, without))
    spiky, plain = (float(np.sum((y[at, -1] - told) ** 2)) for told in on)
    usual = float(np.mean((last - own @ alone) ** 2)) + np.finfo(float).tiny
    there = float(np.mean((y[at, -1] - np.hstack([y[at, :-1], also[at]]) @ alone) ** 2))
    return usual / left, spiky / left, plain / left, there / usual


def _weights(columns: np.ndarray, last: np.ndarray) -> np.ndarray:
    size = np.sqrt(np.mean(columns**2, axis=0)) + np.finfo(float).tiny
    return np.linalg.lstsq(columns / size, last)[0] / size
