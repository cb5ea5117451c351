"""Faults of samples that stand still or are missing: gaps, clipping, dropouts."""

import numpy as np

from middeck.identification.faults.equal_runs import (
    ROUNDING,
    FaultDraft,
    Levels,
    Runs,
    Signal,
    equal_runs,
    fault,
    runs_of,
)

# Clipping. Where a smooth peak looks flat for L samples because of steps q, its neighbours lie at most
# (L + 2)^2 / L^2 q below, that is 3 q and rounding for the shortest run of three.
DROP = 8.0
# Density within 0.5 % of the span of a limit over that of the next 0.5 %: 2.4 for a sine, less for noise.
# Noise of the samples blurs the limit over six deviations: 1 % of a sine over the widest zone; where it blurs
# less, smaller zones tell more.
ZONES, PILED = (0.03, 0.012, 0.005, 0.0015, 0.0005), 5.0
FEWEST_PILED = 20
# Samples in one run at a limit over those in any zone as wide.
LINGERS = 2.0
# Zones by which a signal goes away from a limit after a visit, and how many it makes: a plateau is a step.
AWAY, FEWEST_VISITS = 10.0, 3
# A smooth peak that has fewer samples within a zone may have none within the next one, at each visit alike:
# the next one is 0.4 as wide, both sides together. Not if peaks are met at all phases: the samples before
# visits spread over a parabola's depth of so many sqrt(zone), without a gap of so much of that.
FEWEST_IN_A_PEAK, PHASES, GAP = 6.0, 3.0, 0.2
# Equal samples at a limit where each of so many next values is there once: of Gaussian samples in steps of a
# hundredth of their deviation one record in ten thousand has four.
FEWEST_EQUAL, NEXT_VALUES = 4, 20
# Distance of so many times more values from a limit, over that of the next values. From this ratio on they
# crowd towards it as a sine's do at its peak (16); below a limit that cuts a signal off they lie evenly (4).
# Of a sine of which n samples are cut off, the k next lie within (n + k)^2 - n^2: the limit is then half-way,
# in logarithms, from that to 16.
MORE_VALUES, CROWD = 4, 6.5
# Share of the span to which values of a repeated signal are one.
REPEATED = 1e-6
# Half of the samples at the limits: a switched signal, not a clipped one.
SWITCHED = 0.5
# Dropouts: eight equal samples are no peak seen through steps if the signal then leaps.
STUCK = 8
# Steps of the converter within which the samples before are at rest.
AT_REST = 2.5
# Equal samples in a row that show a stuck output if nearly all others differ: not by chance, nor at a peak
# that turns within twenty samples (second over first differences are 2 pi over the samples of a cycle).
STUCK_AMONG_UNLIKE, UNLIKE, TURNS = 3, 0.98, 0.3
# A share of equal neighbours above which a signal is held by intention.
HELD = 0.3
# Input at rest for so long a share of the period: a burst that ended.
REST = 0.05


def find_gaps(x: Signal) -> list[FaultDraft]:
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


def find_clipping(x: Signal, levels: Levels) -> list[FaultDraft]:
    """Runs at the largest or smallest value, and samples that crowd below a limit blurred by noise."""
    if levels.count <= 3:  # a switched signal
        return []
    runs = _exact_limits(x, levels.step) or _blurred_limits(x, levels.step) or _equal_limits(x)
    return _clipped(x, runs)


def find_clipped_mean(x: Signal, period: int) -> list[FaultDraft]:
    """Samples that crowd below a limit which the mean of all periods shows: noise blurs it less."""
    rows = x.reshape(-1, period)
    mean = rows.mean(axis=0)
    return _clipped(mean, _blurred_limits(mean, 0.0)) if len(rows) > 1 else []


def _clipped(x: Signal, runs: Runs) -> list[FaultDraft]:
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
    # A held signal rests at any value; before it is driven, a channel rests.
    if (
        count < 3
        or [a for a, _ in at] == [0]
        or len(runs) > 2 * len(at)
        or np.mean((x == low) | (x == high)) > SWITCHED
    ):
        return []
    inside = [(a, b) for a, b in at if a > 0 and b < len(x)]
    alike = REPEATED * np.ptp(x)
    if inside and all(b - a == 2 and abs(x[a - 1] - x[b]) <= alike for a, b in inside):
        return []  # a sine of an odd number of samples a cycle has its peaks between two samples
    beside = [abs(x[k] - x[a]) for a, b in at for k in (a - 1, b) if 0 <= k < len(x)]
    return at if np.mean(beside) > DROP * step else []


def _equal_limits(x: Signal) -> Runs:
    """Samples of exactly the largest or smallest value, far more than of each of the values next to it.

    A signal too fast to stay at a limit for two samples shows its clipping so. Periods that repeat exactly
    have each of their values as often. A computed sine repeats its peaks exactly and other values to
    rounding: where the samples before each visit of the limit are one, the signal repeats. A computed sweep
    may meet its peaks exactly, too: there its values crowd towards the limit.
    """
    found = np.zeros(len(x), dtype=bool)
    value, times = np.unique(x, return_counts=True)
    for limit, own, others, away in (
        (value[0], times[0], times[1 : 1 + NEXT_VALUES], value - value[0]),
        (value[-1], times[-1], times[-1 - NEXT_VALUES : -1], value[-1] - value[::-1]),
    ):
        most = int(others.max(initial=1))
        before = x[np.flatnonzero(x[1:] == limit)]
        repeats = np.ptp(before) <= REPEATED * (value[-1] - value[0]) if len(before) else True
        repeats |= len(away) > MORE_VALUES * NEXT_VALUES and bool(
            away[MORE_VALUES * NEXT_VALUES] > _crowd(own) * away[NEXT_VALUES]
        )
        if own >= FEWEST_EQUAL and not repeats and (most == 1 or own > PILED * most):
            found |= x == limit
    runs = runs_of(found)
    return runs if len(runs) >= FEWEST_VISITS and found.mean() <= SWITCHED else []


def _crowd(own: int) -> float:
    """The limit for the ratio of distances beside ``own`` samples at a limit."""
    if own <= NEXT_VALUES:
        return CROWD
    further, next_to = ((own + k) ** 2 - own**2 for k in (MORE_VALUES * NEXT_VALUES, NEXT_VALUES))
    return MORE_VALUES * float(np.sqrt(further / next_to))


def _blurred_limits(x: Signal, step: float) -> Runs:
    size = float(np.ptp(x))
    zones = dict.fromkeys(max(share * size, 1.5 * step) for share in ZONES)
    return next(filter(None, (_crowded_zones(x, zone) for zone in zones)), [])


def _crowded_zones(x: Signal, zone: float) -> Runs:
    """Runs of samples within ``zone`` of a limit, if they are far more than in the next zone."""
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
        length = np.array([b - a for a, b in found])
        alike = np.ptp(length) <= 1 and length.mean() < FEWEST_IN_A_PEAK
        alike = alike and not _all_phases(np.sort([depth[a - 1] for a, _ in found if a > 0]), zone, np.ptp(x))
        if crowded and top > LINGERS * stay * len(found) and visits >= FEWEST_VISITS and not alike:
            runs, count = runs + found, count + top
    return sorted(runs) if count < SWITCHED * len(x) else []


def _all_phases(before: Signal, zone: float, size: float) -> bool:
    """Whether a signal comes to its peaks at all phases, by the samples ``before`` them, in order."""
    wide = before[-1] - before[0] if len(before) > 1 else 0.0
    return bool(wide > PHASES * np.sqrt(zone * size) and np.diff(before).max() < GAP * wide)


def find_dropouts(x: Signal, levels: Levels, *, period: int, is_input: bool) -> list[FaultDraft]:
    """Runs of one value that the signal enters or leaves with a jump."""
    low, high = x.min(), x.max()
    if np.mean(np.diff(x) == 0.0) > HELD and len(equal_runs(x, 2)) > 5 * len(equal_runs(x, STUCK)):
        return []
    unlike = levels.count > UNLIKE * len(x) and not is_input
    least = STUCK_AMONG_UNLIKE if unlike else STUCK
    runs = [(a, b) for a, b in equal_runs(x, least) if a > 0 and x[a] not in (low, high)]
    if is_input:  # a burst rests for long, and to the end
        runs = [(a, b) for a, b in runs if b - a < REST * period and b < len(x)]
    if not runs:
        return []
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
    # A converter shows motion below its step as rest, until something moves the article again.
    if step > 0.0 and np.abs(x[max(0, a - STUCK) : a] - x[a]).max() < AT_REST * step:
        return False
    moves = np.abs(np.concatenate([np.diff(x[max(0, a - 50) : a]), np.diff(x[b : b + 50])]))
    usual = float(np.median(moves)) if len(moves) else 0.0
    edges = [abs(x[a] - x[a - 1])] + ([abs(x[b] - x[b - 1])] if b < len(x) else [])
    # What stays to the end needs less of a leap: nothing but a sticking joint comes to rest on one value.
    share = 0.5 if b < len(x) else 0.05
    return max(edges) > max(5.0 * step, share * usual) and usual > 0.0


def _times(runs: Runs) -> str:
    return "one run" if len(runs) == 1 else f"{len(runs)} runs"
