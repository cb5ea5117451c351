"""Crossings and veerings on a path, independent of its stations.

Every closest approach of two branches is searched for its least gap. The shapes on both sides, at distances
set by the approach itself, decide what happened there: neither the steps of the path nor its legs matter.
Where the stations followed the branches differently, the branches are corrected: both turn through a veering,
and both go straight on through anything narrower than `NARROW`.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.eigenproblem.repeated import REPEATED
from middeck.structure.gravity.path_events import EventKind, GravityEvent, PathState
from middeck.structure.gravity.tracking import Spectrum, track
from middeck.values import record

# Shapes are compared where the gap of omega^2 is this many times its least: of two modes that exchange their
# shapes, 60 of 90 degrees are turned between both sides (tan 2 theta = coupling / detuning).
WIDENED = 2.0
# And where it is at least this part of omega^2: well out of what counts as one frequency.
ASIDE = 100.0 * REPEATED
# A least gap of omega^2 that is a smaller part of it is a crossing: a fortieth of the half-power bandwidth of
# a mode damped by 1 %, which no test can distinguish. Strictly, nearly all crossings are veerings: modes
# that no symmetry separates are slightly coupled.
NARROW = 1e-3
# Parabolas towards a least gap. Close enough is where the gap would change by this part of itself, or of what
# counts as one frequency: in steps that converge faster than linearly, far closer than that.
PARABOLAS = 40
CLOSE = 1e-2
# The last parabola is drawn through points about this part of the width of the approach away.
LOCAL = 0.5
# Halvings until the middle of a bracket is nearer than its ends.
HALVINGS = 20
# Share of the first and last step of a run at which the slope of a gap is evaluated.
INSIDE = 1e-3
# Veerings that one run may step over; more are no longer separate events.
STEPPED_OVER = 200

# From a station to a near place on the same branch; None where there is none.
Advance = Callable[[PathState, float], PathState | None]


class Course(NamedTuple):
    """The way from station to station, and how far gravity has come [m/s^2] at each whole s."""

    advance: Advance
    come: Float[np.ndarray, " place"]

    def distance(self, s: float) -> float:
        """Distance along the straight line, independent of the places that cut it."""
        return float(np.interp(s, np.arange(len(self.come)), self.come))

    def to(self, near: PathState, x: float) -> PathState | None:
        """The station at the distance ``x``, reached from a near one."""
        inside = self.come[0] <= x <= self.come[-1]
        s = float(np.interp(x, self.come, np.arange(len(self.come))))
        return self.advance(near, s) if inside else None


@record(kw_only=True)
class Approach:
    """Two modes where they are nearest, and on both sides; ``gap`` is relative, of omega^2.

    ``rank`` is how many of those followed are below them.
    """

    at: PathState
    before: PathState
    after: PathState
    gap: float
    exchanged: bool
    rank: int

    @property
    def kind(self) -> EventKind:
        """Crossing where the gap is too small to resolve, else veering."""
        return EventKind.VEERING if self.gap > NARROW else EventKind.CROSSING


class Resolved(NamedTuple):
    """The stations of a run with those of veerings added, events, and the order of branches at its end.

    ``unexplained`` are pairs of branches whose order changes without a crossing of these two alone.
    """

    stations: list[PathState]
    events: list[GravityEvent]
    order: Int[np.ndarray, " branch"]
    unexplained: list[tuple[int, int]]


def reorder(station: PathState, order: Int[np.ndarray, " branch"]) -> PathState:
    """The run with its branches in another order."""
    lam, shapes, M = station.spectrum
    return dataclasses.replace(
        station, spectrum=Spectrum(lam[order], shapes[:, order], M), match=station.match[order]
    )


def resolve_exchanges(stations: Sequence[PathState], course: Course, names: tuple[str, ...]) -> Resolved:
    """Crossings and veerings of all pairs of modes over a run of stations on one continuous branch."""
    run, order = list(stations), np.arange(stations[0].spectrum.lam.size)
    found: list[Approach] = []
    looked: set[tuple[float, float, tuple[int, int]]] = set()
    for _ in range(STEPPED_OVER):
        flip = next((f for f in _flips(run) if f not in looked), None)
        if flip is None:
            break
        looked.add(flip)
        a, b, pair = flip
        near = _bracket_flip([x for x in run if a <= x.s <= b], pair, course)
        new = near and _nearest(near, pair, course)
        if not new or not new.exchanged or _known(new, found):
            continue
        found.append(new)
        run, turn = _put_right(run, new)
        order = order[turn]
    for new in sorted(_resolved_already(run, found, course), key=lambda x: x.at.s):
        found.append(new)
        if new.kind is EventKind.CROSSING:
            run, turn = _put_right(run, new)
            order = order[turn]
    events = [_event(x, run, names) for x in found]
    return Resolved(run, sorted(events, key=lambda e: e.s), order, _unexplained(run, events))


def _unexplained(run: Sequence[PathState], events: Sequence[GravityEvent]) -> list[tuple[int, int]]:
    """Pairs that change their order without an odd number of crossings, as a group of three modes may."""
    first, last = run[0].spectrum.lam, run[-1].spectrum.lam
    count = Counter(tuple(sorted(e.branch)) for e in events if e.kind is EventKind.CROSSING)
    size = REPEATED * np.maximum(np.abs(first), np.abs(last))
    found: list[tuple[int, int]] = []
    for i, j in itertools.combinations(range(len(first)), 2):
        apart = min(abs(first[i] - first[j]), abs(last[i] - last[j])) > max(size[i], size[j])
        flipped = (first[i] > first[j]) != (last[i] > last[j])
        if apart and flipped != bool(count[i, j] % 2):
            found.append((i, j))
    return found


def _known(new: Approach, found: Sequence[Approach]) -> bool:
    return any(x.rank == new.rank and x.before.s <= new.at.s <= x.after.s for x in found)


# Closest approaches that the stations show


def _flips(run: Sequence[PathState]) -> list[tuple[float, float, tuple[int, int]]]:
    """Values of s between which two branches change their order; one repeated frequency has none."""
    lam = np.array([x.spectrum.lam for x in run])
    found: list[tuple[float, float, tuple[int, int]]] = []
    for i, j in itertools.combinations(range(lam.shape[1]), 2):
        a, b = lam[:, i], lam[:, j]
        one = np.abs(a - b) <= REPEATED * np.maximum(np.abs(a), np.abs(b))
        apart = np.flatnonzero(~one).tolist()
        rank = np.sign(a - b)
        found += [(run[p].s, run[q].s, (i, j)) for p, q in itertools.pairwise(apart) if rank[p] != rank[q]]
    return sorted(found)


def _bracket_flip(
    run: Sequence[PathState], pair: tuple[int, int], course: Course
) -> tuple[PathState, PathState, PathState] | None:
    """Three stations, the middle one the nearest, between two on either side of a change of order."""
    a, b = run[0], run[-1]
    for k in range(HALVINGS):
        u, v = course.distance(a.s), course.distance(b.s)
        part = 0.5 if k else _signed(a, pair) / (_signed(a, pair) - _signed(b, pair))
        middle = course.to(a, u + part * (v - u))
        if middle is None:
            return None
        if _gap(middle, pair) < min(_gap(a, pair), _gap(b, pair)):
            return a, middle, b
        a, b = (middle, b) if _signed(middle, pair) * _signed(a, pair) > 0.0 else (a, middle)
    return None


def _resolved_already(run: Sequence[PathState], known: Sequence[Approach], course: Course) -> list[Approach]:
    """Approaches in which the stations followed both branches: minima of a gap that no flip explains."""
    run = _look_inside(run, course)
    lam = np.array([x.spectrum.lam for x in run])
    found: list[Approach] = []
    for pair in itertools.combinations(range(lam.shape[1]), 2):
        gap = np.abs(lam[:, pair[0]] - lam[:, pair[1]])
        apart = gap > REPEATED * np.abs(lam[:, pair]).max(axis=1)
        for p in range(1, len(run) - 1):
            least = gap[p] < gap[p - 1] and gap[p] <= gap[p + 1] and apart[p - 1] and apart[p + 1]
            if not least or not _neighbours(run[p], pair):
                continue
            # Between two stations a gap falls no lower than it would, if it went on as on the steeper side.
            fall = max(gap[p - 1], gap[p + 1]) - gap[p]
            if min(gap[:p].max(), gap[p + 1 :].max()) < WIDENED * max(gap[p] - fall, 0.0):
                continue
            near = (run[p - 1], run[p], run[p + 1])
            rank = int(np.sum(lam[p] < lam[p, list(pair)].min()))
            if any(x.rank == rank and near[0].s <= x.at.s <= near[2].s for x in known):
                continue
            new = _nearest(near, pair, course)
            if new and new.exchanged and not _known(new, [*known, *found]):
                found.append(new)
    return found


def _look_inside(run: Sequence[PathState], course: Course) -> list[PathState]:
    """The run with a station just inside each end, which shows approaches next to the ends."""
    if len(run) < 2:
        return list(run)
    first = course.advance(run[0], run[0].s + INSIDE * (run[1].s - run[0].s))
    last = course.advance(run[-1], run[-1].s - INSIDE * (run[-1].s - run[-2].s))
    inside = [[x] if x is not None else [] for x in (first, last)]
    return [run[0], *inside[0], *run[1:-1], *inside[1], run[-1]]


# One approach


def _nearest(
    near: tuple[PathState, PathState, PathState], pair: tuple[int, int], course: Course
) -> Approach | None:
    """The least gap by parabolas through its square, exact for a 2x2 problem linear in gravity.

    Each goes through the three stations nearest to the least gap so far (one through the bracket, whose far
    end may stay where it is, converges linearly). The last one goes through points as near as the gap is
    wide: the rate at which it opens is that there, whatever the bracket was.
    """
    tried, curved = [*near], 0.0
    for _ in range(PARABOLAS):
        best = course.distance(near[1].s)
        x, y = _squares(sorted(tried, key=lambda p: abs(p.s - near[1].s))[:3], pair, course)
        lowest, curved = _parabola(x, y)
        if not (curved > 0.0 and course.distance(near[0].s) < lowest < course.distance(near[2].s)):
            x, y = _squares(near, pair, course)
            lowest, curved = _parabola(x, y)
        if curved <= 0.0:
            return None
        floor = max(_gap(near[1], pair), REPEATED * _size(near[1], pair)) / np.sqrt(curved)
        if abs(lowest - best) <= CLOSE * floor:
            far = float(max(x, key=lambda end: abs(end - best)))
            if abs(far - best) <= 2.0 * LOCAL * floor:
                break
            lowest = best + LOCAL * floor * np.sign(far - best)
        between = course.to(near[1], lowest)
        if between is None:
            return None
        if any(between.s == p.s for p in tried):  # nearer than s can be resolved
            break
        tried.append(between)
        four = sorted([*near, between], key=lambda p: p.s)
        k = min((1, 2), key=lambda m: _gap(four[m], pair))
        near = (four[k - 1], four[k], four[k + 1])
    return _compare_sides(near[1], curved, pair, course)


def _compare_sides(at: PathState, curved: float, pair: tuple[int, int], course: Course) -> Approach | None:
    size, gap = _size(at, pair), _gap(at, pair)
    if size == 0.0 or not _neighbours(at, pair):
        return None
    x = course.distance(at.s)
    reach = max(np.sqrt(WIDENED**2 - 1.0) * gap, ASIDE * size) / np.sqrt(curved)
    before, after = (course.to(at, x + way * reach) for way in (-1.0, 1.0))
    if before is None or after is None:
        return None
    rank = int(np.sum(at.spectrum.lam < at.spectrum.lam[list(pair)].min()))
    return Approach(
        at=at,
        before=before,
        after=after,
        gap=gap / size,
        exchanged=_exchanged(before, after, pair),
        rank=rank,
    )


def _squares(
    three: Sequence[PathState], pair: tuple[int, int], course: Course
) -> tuple[np.ndarray, np.ndarray]:
    at = sorted(three, key=lambda p: p.s)
    return np.array([course.distance(p.s) for p in at]), np.array([_gap(p, pair) ** 2 for p in at])


def _parabola(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Minimum of the parabola through three points, and its second divided difference."""
    rise, further = np.diff(y) / np.diff(x)
    curved = (further - rise) / (x[2] - x[0])
    return (x[1] if curved <= 0.0 else 0.5 * (x[0] + x[1] - rise / curved)), curved


def _signed(x: PathState, pair: tuple[int, int]) -> float:
    return float(x.spectrum.lam[pair[0]] - x.spectrum.lam[pair[1]])


def _gap(x: PathState, pair: tuple[int, int]) -> float:
    return abs(_signed(x, pair))


def _size(x: PathState, pair: tuple[int, int]) -> float:
    return float(np.abs(x.spectrum.lam[list(pair)]).max())


def _neighbours(x: PathState, pair: tuple[int, int]) -> bool:
    """Whether no third mode stands between the two."""
    low, high = sorted(x.spectrum.lam[list(pair)])
    return not np.any((x.spectrum.lam > low) & (x.spectrum.lam < high))


def _exchanged(before: PathState, after: PathState, pair: tuple[int, int]) -> bool:
    """Whether the lower shape is, on the other side, more of the upper than of itself, and the reverse."""
    lower, upper = (
        x.spectrum.shapes[:, sorted(pair, key=lambda b: float(x.spectrum.lam[b]))] for x in (before, after)
    )
    cross = np.abs(lower.T @ (before.spectrum.mass @ upper))
    return bool(min(cross[0, 1], cross[1, 0]) > max(cross[0, 0], cross[1, 1]))


def _put_right(run: Sequence[PathState], found: Approach) -> tuple[list[PathState], np.ndarray]:
    """The run with branches that turn through a veering, by its three stations, or straight on, by two.

    Also the new order of branches behind it. Stations within a crossing are left out but for places.
    """
    done = [x for x in run if x.s < found.before.s]
    behind = [x for x in run if x.s > found.after.s]
    within = [x for x in run if found.before.s < x.s < found.after.s and x.s == round(x.s)]
    done.append(_follow(done[-1], found.before)[0] if done else found.before)
    if found.kind is EventKind.VEERING:
        for new in sorted([found.at, *within, found.after], key=lambda x: x.s):
            done.append(_follow(done[-1], new)[0])
    else:  # what is half the one and half the other, where they are nearest, must not hand them over
        sides = [done[-1], _follow(done[-1], found.after)[0]]
        done += [_follow(sides[x.s > found.at.s], x)[0] for x in within]
        done.append(sides[1])
    if not behind:
        return done, _follow(done[-1], run[-1])[1]
    first, turn = _follow(done[-1], behind[0])
    return [*done, first, *(reorder(x, turn) for x in behind[1:])], turn


def _follow(here: PathState, there: PathState) -> tuple[PathState, np.ndarray]:
    """``there`` with its branches in the order of ``here``."""
    tracked = track(here.spectrum, there.spectrum)
    return dataclasses.replace(there, spectrum=tracked.spectrum, match=tracked.match), tracked.found


def _event(found: Approach, run: Sequence[PathState], names: tuple[str, ...]) -> GravityEvent:
    """The event, with the names that branches have after all corrections."""
    here = [x for x in run if x.s <= found.at.s][-1]
    at, _ = _follow(here, found.at)
    i, j = sorted(map(int, np.argsort(at.spectrum.lam, kind="stable")[found.rank : found.rank + 2]))
    low, high = np.sqrt(np.maximum(np.sort(at.spectrum.lam[[i, j]]), 0.0)) / (2.0 * np.pi)
    gap = float(high - low) if found.kind is EventKind.VEERING else 0.0
    return GravityEvent(
        kind=found.kind,
        s=at.s,
        gravity=at.gravity,
        branch=(i, j),
        name=(names[i], names[j]),
        frequency_hz=float(0.5 * (low + high)),
        gap_hz=gap,
    )
