"""What happens to modes on a path of gravities: crossings, veerings, and the ends of a stable branch."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.elements.frames import Configuration
from middeck.structure.gravity.tracking import REPEATED, Spectrum
from middeck.values import record

# A veering is looked at between the places where the gap of omega^2 is this many times its least: of two
# modes that exchange their shapes, 60 of 90 degrees are turned there (tan 2 theta = coupling / detuning).
WIDENED = 2.0
# Secant steps towards a crossing; omega^2 is close to linear over one step of the path.
SECANTS = 8
CROSSED = 1e-12
# Parabolas towards the least gap of a veering, and how close in s to it is close enough.
PARABOLAS = 6
CLOSE = 1e-9


class EventKind(Enum):
    """What happened; the last four end a path."""

    CROSSING = "crossing"  # two modes change their order and keep their shapes
    VEERING = "veering"  # two modes keep their order and exchange their shapes
    UNSTABLE_START = "unstable start"  # the rest state at the first place is not stable
    UNSTABLE = "loss of stability"  # omega^2 of a mode passes through zero
    NO_REST = "no rest state"  # the branch ends: a limit point, as of a snap-through
    SLACK = "slack device"  # it would have to push


@record
class GravityEvent:
    """One event.

    Parameters
    ----------
    s, gravity:
        Where, as in `GravityPath`.
    branch, name:
        The modes concerned, or the slack devices by name alone.
    frequency_hz:
        Of the modes [Hz], the mean of two; of a mode that grows, minus its rate over 2 pi.
    gap_hz:
        Least distance of two veering modes [Hz], otherwise zero.
    """

    kind: EventKind
    s: float
    gravity: Float[np.ndarray, "3"]
    branch: tuple[int, ...]
    name: tuple[str, ...]
    frequency_hz: float
    gap_hz: float

    @property
    def ends(self) -> bool:
        """Whether the path ends here."""
        return self.kind not in (EventKind.CROSSING, EventKind.VEERING)

    @property
    def sentence(self) -> str:
        """In words."""
        at = f"at g = {np.linalg.norm(self.gravity):.6g} m/s^2"
        names = " and ".join(repr(n) for n in self.name)
        match self.kind:
            case EventKind.CROSSING:
                return f"{names} cross {at}, at {self.frequency_hz:.4g} Hz"
            case EventKind.VEERING:
                return f"{names} veer {at}: {self.gap_hz:.3g} Hz apart at {self.frequency_hz:.4g} Hz"
            case EventKind.UNSTABLE_START:
                return f"{names} is unstable where the path begins, {at}; follow it from its other end"
            case EventKind.UNSTABLE:
                return f"{names} loses stability {at}"
            case EventKind.NO_REST:
                return f"no rest state continues the branch beyond {at[3:]}; the softest mode is {names}"
            case EventKind.SLACK:
                return f"the device {names} goes slack {at}"


class Station(NamedTuple):
    """A rest state on a path, the modes that are followed, and the least omega^2 of all."""

    s: float
    gravity: np.ndarray
    config: Configuration
    spectrum: Spectrum
    match: np.ndarray
    tension: np.ndarray
    least: float


# From a station to a near place on the same branch; None where there is none.
Advance = Callable[[Station, float], Station | None]


def find_exchanges(
    stations: Sequence[Station], advance: Advance, names: tuple[str, ...]
) -> list[GravityEvent]:
    """Crossings and veerings between all pairs of modes over a continuous part of a path, in its order."""
    if len(stations) < 2:
        return []
    lam = np.array([x.spectrum.lam for x in stations])
    events: list[GravityEvent] = []
    for i, j in itertools.combinations(range(lam.shape[1]), 2):
        order = _order(lam[:, i], lam[:, j])
        events += [_crossing((stations[p], stations[q]), (i, j), advance, names) for p, q in _flips(order)]
        events += _veerings(stations, (i, j), advance, names)
    return sorted(events, key=lambda e: e.s)


def _order(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sign of a - b; 0 where they are one repeated frequency."""
    return np.where(np.abs(a - b) > REPEATED * np.maximum(np.abs(a), np.abs(b)), np.sign(a - b), 0.0)


def _flips(order: np.ndarray) -> list[tuple[int, int]]:
    """Stations on either side of each change of order."""
    apart = np.flatnonzero(order)
    return [(int(p), int(q)) for p, q in itertools.pairwise(apart) if order[p] != order[q]]


def _crossing(
    ends: tuple[Station, Station], pair: tuple[int, int], advance: Advance, names: tuple[str, ...]
) -> GravityEvent:
    i, j = pair

    def gap(x: Station) -> float:
        return float(x.spectrum.lam[i] - x.spectrum.lam[j])

    a, b = ends
    nearest = min(ends, key=lambda x: abs(gap(x)))
    for _ in range(SECANTS):
        s = a.s - gap(a) * (b.s - a.s) / (gap(b) - gap(a))
        middle = advance(ends[0], s)
        if middle is None:
            break
        nearest = middle
        if abs(gap(middle)) <= CROSSED * abs(float(middle.spectrum.lam[i])):
            break
        a, b = (middle, b) if gap(middle) * gap(a) > 0.0 else (a, middle)
    f = _hz(nearest.spectrum.lam[list(pair)])
    return GravityEvent(
        EventKind.CROSSING, nearest.s, nearest.gravity, pair, (names[i], names[j]), float(f.mean()), 0.0
    )


def _veerings(
    stations: Sequence[Station], pair: tuple[int, int], advance: Advance, names: tuple[str, ...]
) -> list[GravityEvent]:
    gap = np.array([_gap(x, pair) for x in stations])
    least = [p for p in range(1, len(gap) - 1) if gap[p] < gap[p - 1] and gap[p] <= gap[p + 1]]
    found: list[GravityEvent] = []
    for p in least:
        left = next((q for q in range(p, -1, -1) if gap[q] >= WIDENED * gap[p]), 0)
        right = next((q for q in range(p, len(gap)) if gap[q] >= WIDENED * gap[p]), len(gap) - 1)
        if _neighbours(stations[p], pair) and _exchanged(stations[left], stations[right], pair):
            found.append(_veering(stations[p - 1 : p + 2], pair, advance, names))
    return found


def _gap(x: Station, pair: tuple[int, int]) -> float:
    return abs(float(x.spectrum.lam[pair[0]] - x.spectrum.lam[pair[1]]))


def _neighbours(x: Station, pair: tuple[int, int]) -> bool:
    """Whether no third mode stands between the two."""
    low, high = sorted(x.spectrum.lam[list(pair)])
    return not np.any((x.spectrum.lam > low) & (x.spectrum.lam < high))


def _exchanged(before: Station, after: Station, pair: tuple[int, int]) -> bool:
    """Whether each shape is, at the end, more of what the other was than of itself."""
    columns = list(pair)
    cross = np.abs(
        before.spectrum.shapes[:, columns].T @ (before.spectrum.mass @ after.spectrum.shapes[:, columns])
    )
    return bool(min(cross[0, 1], cross[1, 0]) > max(cross[0, 0], cross[1, 1]))


def _veering(
    near: Sequence[Station], pair: tuple[int, int], advance: Advance, names: tuple[str, ...]
) -> GravityEvent:
    """The least gap: of parabolas through its square, which a 2x2 problem linear in gravity makes exact."""
    for _ in range(PARABOLAS):
        s = _lowest(near, pair)
        between = advance(near[1], s) if abs(s - near[1].s) > CLOSE else None
        if between is None:
            break
        four = sorted([*near, between], key=lambda x: x.s)
        k = min((1, 2), key=lambda m: _gap(four[m], pair))
        near = four[k - 1 : k + 2]
    at = near[1]
    low, high = _hz(np.sort(at.spectrum.lam[list(pair)]))
    return GravityEvent(
        EventKind.VEERING, at.s, at.gravity, pair, (names[pair[0]], names[pair[1]]),
        float(0.5 * (low + high)), float(high - low),
    )  # fmt: skip


def _lowest(near: Sequence[Station], pair: tuple[int, int]) -> float:
    """Where the parabola through the squares of three gaps, the middle one the least, is lowest."""
    s0, s1, s2 = (x.s for x in near)
    y0, y1, y2 = (_gap(x, pair) ** 2 for x in near)
    rise, further = (y1 - y0) / (s1 - s0), (y2 - y1) / (s2 - s1)
    curved = further - rise
    return s1 if curved <= 0.0 else 0.5 * (s0 + s1 - rise * (s2 - s0) / curved)


def _hz(lam: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(lam, 0.0)) / (2.0 * np.pi)
