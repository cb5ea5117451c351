"""Faults of single samples and short runs: gaps, clipping, dropouts, spikes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.ndimage
from jaxtyping import Bool

from middeck.identification.faults.equal_runs import Found, Levels, Runs, Signal, equal_runs, fault, runs_of

# A channel whose swing is within this share of its level is constant up to rounding.
ROUNDING = 1e-13
# Clipping. Where a smooth peak looks flat for L samples because of steps q, its neighbours lie at most
# (L + 2)^2 / L^2 q below, that is 3 q and rounding for the shortest run of three.
DROP = 8.0
# Density within 0.5 % of the span of a limit over that of the next 0.5 %: 2.4 for a sine, less for noise.
ZONE, PILED = 0.005, 5.0
FEWEST_PILED = 20
# Samples in one run at a limit over those in any zone as wide.
LINGERS = 2.0
# Zones by which a signal goes away from a limit after a visit, and how many it makes: a plateau is a step.
AWAY, FEWEST_VISITS = 10.0, 3
# Equal samples at a limit where each of so many next values is there once: of Gaussian samples in steps of a
# hundredth of their deviation one record in ten thousand has four.
FEWEST_EQUAL, NEXT_VALUES = 4, 20
# Half of the samples at the limits: a switched signal, not a clipped one.
SWITCHED = 0.5
# Dropouts: eight equal samples are no peak seen through steps if the signal then leaps.
STUCK = 8
# Of an output of which nearly all samples differ three in a row are not equal by chance, nor at a peak that
# turns within twenty samples: second differences over first ones are 2 pi over the samples of a cycle.
STUCK_AMONG_UNLIKE, UNLIKE, TURNS = 3, 0.98, 0.3
# A share of equal neighbours above which a signal is held by intention.
HELD = 0.3
# Input at rest for so long a share of the period: a burst that ended.
REST = 0.05
# Spikes: samples on each side that a spike is compared with, the nearest left out, and by how many times
# their span it leaves it. Of Gaussian samples one in 1e9 does.
BESIDE, LEAP = 12, 2.0
# Samples on each side that are left out where longer ones are sought: so many and one may be one spike.
WIDE = 8
# Spikes among large samples of the signal's own: residuals of a prediction from so many samples before. The
# largest, a share but no fewer than FEWEST_LARGE, tell the tail; chance is beyond it in one of e^BEYOND.
PREDICTED_FROM, LARGE, FEWEST_LARGE, BEYOND = 16, 0.01, 20, 7.0
# Samples by which an output may follow a spike or a step of an input and be its answer.
ANSWERS = WIDE + 2
# Share of the largest sample of a run that one beside it has where the run is the middle of a longer one.
LASTS = 0.8
# Inputs with so much of their energy in spikes are impacts.
IMPACTS = 0.1
# Share of a sample at an edge that the next one inward has of it, from which on the two are one decay.
DECAYS = 0.2
# A decay that leaves its first sample outside of the rest falls to 0.58 or less from each to the next.
FALLS = 1.5


def find_gaps(x: Signal) -> list[Found]:
    """Samples that are not finite numbers."""
    runs = runs_of(~np.isfinite(x))
    if not runs:
        return []
    count = sum(b - a for a, b in runs)
    what = f"{count} samples are missing or no numbers, in {_times(runs)}, first at {runs[0][0]}"
    hint = "cut the record before the gap, or record it again"
    return [fault("gap", what, hint, severity="unusable", samples=runs)]


def is_dead(x: Signal) -> bool:
    """Whether the channel does not move at all."""
    return bool(np.ptp(x) <= ROUNDING * np.abs(x).max())


def find_clipping(x: Signal, levels: Levels) -> list[Found]:
    """Runs at the largest or smallest value, and samples that crowd below a limit blurred by noise."""
    if levels.count <= 3:  # a switched signal
        return []
    runs = _exact_limits(x, levels.step) or _blurred_limits(x, levels.step) or _equal_limits(x)
    if not runs:
        return []
    count = sum(b - a for a, b in runs)
    limits = sorted({float(f"{x[a]:.3g}") for a, _ in runs})
    at = " and ".join(f"{v:g}" for v in (limits[:1] + limits[-1:] if len(limits) > 1 else limits))
    what = f"clipped: {count} samples at the limits near {at}, in {_times(runs)}"
    return [fault("clipping", what, "record it again with a wider range or less drive", samples=runs)]


def _exact_limits(x: Signal, step: float) -> Runs:
    least = 3 if step > 0.0 else 2
    runs = equal_runs(x, least)
    low, high = x.min(), x.max()
    at = [(a, b) for a, b in runs if x[a] in (low, high)]
    count = sum(b - a for a, b in at)
    # A held signal rests at any value.
    if count < 3 or len(runs) > 2 * len(at) or np.mean((x == low) | (x == high)) > SWITCHED:
        return []
    beside = [abs(x[k] - x[a]) for a, b in at for k in (a - 1, b) if 0 <= k < len(x)]
    return at if np.mean(beside) > DROP * step else []


def _equal_limits(x: Signal) -> Runs:
    """Samples of exactly the largest or smallest value, far more than of each of the values next to it.

    A signal too fast to stay at a limit for two samples shows its clipping so. Periods that repeat exactly
    have each of their values as often.
    """
    found = np.zeros(len(x), dtype=bool)
    value, times = np.unique(x, return_counts=True)
    for limit, own, others in (
        (value[0], times[0], times[1 : 1 + NEXT_VALUES]),
        (value[-1], times[-1], times[-1 - NEXT_VALUES : -1]),
    ):
        most = int(others.max(initial=1))
        if own >= FEWEST_EQUAL and (most == 1 or own > PILED * most):
            found |= x == limit
    runs = runs_of(found)
    return runs if len(runs) >= FEWEST_VISITS and found.mean() <= SWITCHED else []


def _blurred_limits(x: Signal, step: float) -> Runs:
    zone = max(ZONE * float(np.ptp(x)), 1.5 * step)
    # How long half of the samples stay within a zone: steps rest everywhere, a clipped signal at its limits.
    inner = np.flatnonzero(np.diff(np.floor((x - x.min()) / zone)))
    stays = np.sort(np.diff(np.concatenate([[-1], inner, [len(x) - 1]])))
    stay = stays[np.searchsorted(np.cumsum(stays), 0.5 * len(x))]
    runs: Runs = []
    count = 0
    for size in (x, -x):
        depth = size.max() - size
        at, next_to = depth < zone, (depth >= zone) & (depth < 2.0 * zone)
        top, below = int(at.sum()), int(next_to.sum())
        found = runs_of(at)
        crowded = top >= FEWEST_PILED and top > PILED * below + 5.0 * np.sqrt(below)
        visits = np.count_nonzero(np.maximum.reduceat(depth, [a for a, _ in found]) > AWAY * zone)
        if crowded and top > LINGERS * stay * len(found) and visits >= FEWEST_VISITS:
            runs, count = runs + found, count + top
    return sorted(runs) if count < SWITCHED * len(x) else []


def find_dropouts(x: Signal, levels: Levels, *, period: int, is_input: bool) -> list[Found]:
    """Runs of one value that the signal enters or leaves with a jump."""
    low, high = x.min(), x.max()
    if np.mean(np.diff(x) == 0.0) > HELD and len(equal_runs(x, 2)) > 5 * len(equal_runs(x, STUCK)):
        return []
    unlike = levels.count > UNLIKE * len(x) and not is_input
    least = STUCK_AMONG_UNLIKE if unlike else STUCK
    runs = [(a, b) for a, b in equal_runs(x, least) if a > 0 and x[a] not in (low, high)]
    if is_input:  # a burst rests for long, and to the end
        runs = [(a, b) for a, b in runs if b - a < REST * period and b < len(x)]
    fast = unlike and np.median(np.abs(np.diff(x, 2))) > TURNS * np.median(np.abs(np.diff(x)))
    runs = [r for r in runs if fast or _leaps(x, r, levels.step)]
    if not runs:
        return []
    count = sum(b - a for a, b in runs)
    what = f"drops out: stuck for {count} samples, in {_times(runs)}, first at {runs[0][0]}"
    hint = "check cable and transmission; cut the record there"
    if runs[-1][1] == len(x):
        hint = "the end may have been cut and padded: cut it off, or copy the record again"
    return [fault("dropout", what, hint, samples=runs)]


def _leaps(x: Signal, run: tuple[int, int], step: float) -> bool:
    """Whether the jump exceeds the quantisation step and the usual change between samples."""
    a, b = run
    moves = np.abs(np.concatenate([np.diff(x[max(0, a - 50) : a]), np.diff(x[b : b + 50])]))
    usual = float(np.median(moves)) if len(moves) else 0.0
    edges = [abs(x[a] - x[a - 1])] + ([abs(x[b] - x[b - 1])] if b < len(x) else [])
    # What stays to the end needs less of a leap: nothing but a sticking joint comes to rest on one value.
    share = 0.5 if b < len(x) else 0.05
    return max(edges) > max(5.0 * step, share * usual) and usual > 0.0


def find_spikes(x: Signal, levels: Levels, driven: Runs | None = None) -> list[Found]:
    """One to nine samples far outside of all that is beside them, of the signal's tail and of any answer.

    ``driven`` are spikes of the inputs, which an output may answer.
    """
    runs = [r for r in spike_runs(x, levels) if not _answers(r, driven or [])]
    if not runs:
        return []
    largest = max(float(np.abs(x[a:b] - np.median(x)).max()) for a, b in runs)
    what = f"{len(runs)} spikes up to {largest:.3g}, first at {runs[0][0]}"
    hint = "check for loose contacts and switching nearby; repair the samples, or leave the period out"
    return [fault("spike", what, hint, samples=runs)]


def spike_runs(x: Signal, levels: Levels) -> Runs:
    """Samples outside of what is beside them that are no large samples like others of the signal.

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
        # The first samples are foretold from those after them, up to twice as far in.
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
    # The first samples have none before them: they are foretold from those after, by the same weights.
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
    found = _outside(x, step, 1)
    if len(x) > 4 * (BESIDE + WIDE):
        inner = slice(BESIDE + WIDE, -BESIDE - WIDE)
        found[inner] |= _outside(x, step, WIDE)[inner]
    return [run for run in runs_of(found) if not (_decays(x, run) or _goes_on(x, run))]


def _outside(x: Signal, step: float, near: int) -> Bool[np.ndarray, " sample"]:
    """Samples outside of those more than ``near`` and up to BESIDE + ``near`` - 1 away."""
    highest = _beside(x, scipy.ndimage.maximum_filter1d, near)
    lowest = -_beside(-x, scipy.ndimage.maximum_filter1d, near)
    beyond = np.maximum(x - highest, lowest - x)
    return (beyond > LEAP * (highest - lowest) + 5.0 * step) & (beyond > ROUNDING * np.abs(x).max())


def _beside(x: Signal, largest: Callable[..., np.ndarray], near: int) -> Signal:
    """The largest of BESIDE - 1 samples on each side of those ``near``, at an edge as many from inside."""
    size = BESIDE - 1
    # The window of BESIDE - 1 samples that ends just before those near, and the one that begins after them.
    shift = near + 1 + size // 2
    inner = largest(x, size)
    around = np.maximum(np.roll(inner, shift), np.roll(inner, -shift))
    for k in range(BESIDE + 1):
        around[k] = _most_beside(x[: 2 * BESIDE + 3], k)
        around[-1 - k] = _most_beside(x[: -2 * BESIDE - 4 : -1], k)
    return around


def _most_beside(window: Signal, k: int) -> float:
    return float(window[np.abs(np.arange(len(window)) - k) > 1].max())


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
    """Whether a run is the middle of something longer, as a level of a square wave."""
    a, b = run
    rest = np.median(x[max(a - BESIDE - WIDE, 0) : b + BESIDE + WIDE])
    off = np.abs(x[max(a - 1, 0) : b + 1] - rest)
    return bool(max(off[0] * (a > 0), off[-1] * (b < len(x))) > LASTS * off[min(a, 1) : b - a + 1].max())


def is_impact(x: Signal) -> bool:
    """Whether much of the energy is in spikes, as with a hammer."""
    swing = x - np.median(x)
    energy = sum(float(np.sum(swing[a:b] ** 2)) for a, b in _outside_runs(x, 0.0))
    return energy > IMPACTS * float(np.sum(swing**2))


def _times(runs: Runs) -> str:
    return "one run" if len(runs) == 1 else f"{len(runs)} runs"
