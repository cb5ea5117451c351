"""Frequency lines for a loop: around every pole and zero, then refined where the ratio still changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import (
    At,
    FeedbackLoop,
    approximate_halves,
    channels_at,
    close_channels,
    open_channel,
)
from middeck.control.analysis.loop.returned_wave import ReturnedWave, returned_wave
from middeck.systems.poles.stability import growth_rates
from middeck.systems.poles.transmission_zeros import transmission_zeros

Response = Callable[[np.ndarray], np.ndarray]
Curve = tuple[Float[np.ndarray, " line"], Complex[np.ndarray, "line channel"]]
"""Angular frequencies and the ratio there."""

WIDEST = 1e4
"""Loop gain (or its inverse) beyond which crossings are left out: 80 dB."""
PER_DECADE = 30
HALF_WIDTHS = np.array([0.0, 0.3, 1.0, 3.0, 10.0, 30.0])
TURN, STRETCH = 0.35, 0.7
"""Largest change of phase [rad] and of the logarithm of the gain from line to line."""
ROUNDS, FINEST = 40, 1e-10
SLOWEST_DECADES = 16
AT_REST = 1e-9
"""Poles slower than this fraction of the fastest count as zero: rounding splits double poles. Zeros beyond
the fastest pole by the inverse count as infinite: rounding brings such zeros back."""
UNDAMPED = 1e-8
"""Damping ratio below which a pole counts as undamped: rounding of a zero that cancels a pole."""
BESIDE, OFF_MIDDLE = 1e-4, 0.47
"""Relative position of a new line between two others: not half-way, where a pole on the axis may lie, beside
which two cancelling loops leave rounding only."""
SAME = 0.05
MOST_DELAY_LINES = 20_000
PHASES = 16
"""Phases of each turn of the longest delay at which the ratio is compared with that at twice the
frequency."""
SETTLED, NEAREST = 0.1, 1e-3
"""Change of the ratio over the distance of its gain from one, or over `NEAREST`, within which it counts as
repeated by each turn of the delay. Its limit is known (`returned_wave`)."""
SHORT_OF_NYQUIST = 1e-9
"""Relative distance of the last line from half the sampling rate, which is an end point (`ends`)."""


def place_lines(
    loop: FeedbackLoop, at: At, ratio: Response, *, zeros: bool = True
) -> Float[np.ndarray, " line"]:
    """Angular frequencies [rad/s] from well below the slowest pole or zero to a negligible loop gain.

    Poles and zeros are those of the loop broken at each channel with the others closed, delays by a Pade
    approximation of high order: they place the lines, no more. Crossings need the zeros; the sensitivity
    peaks at poles, and `refine_lines` follows the rest.
    """
    features, fastest = _features(loop, at, zeros=zeros)
    size = np.abs(features)
    moving = size[size > AT_REST * fastest]
    low, high = (0.01 * moving.min(), 3.0 * moving.max()) if len(moving) else (0.01, 100.0)
    low = _where_settled(ratio, low)
    period = loop.period_s
    wave = returned_wave(loop)
    if wave is not None and fastest > 0.0:
        high = 3.0 * fastest  # zeros of approximated delays and direct terms lie a thousand times higher
    if period is not None:
        top = (1.0 - SHORT_OF_NYQUIST) * np.pi / period
    else:
        top = _where_gone(ratio, high) if wave is None else _where_repeated(ratio, high, wave)
    lines = [np.geomspace(low, top, int(PER_DECADE * np.log10(top / low)) + 2), _clusters(features)]
    longest_s = float(loop.plant.delay_s.max(initial=0.0))
    if longest_s > 0.0:
        lines.append(np.arange(1, min(int(2.0 * top * longest_s) + 1, MOST_DELAY_LINES)) * 0.5 / longest_s)
    omega: np.ndarray = np.unique(np.concatenate(lines))
    return omega[(omega >= low) & (omega <= top) & ~_on_pole(features, omega)]


def _features(loop: FeedbackLoop, at: At, *, zeros: bool) -> tuple[np.ndarray, float]:
    """Poles, finite zeros where asked for, and the size of the fastest pole."""
    halves = approximate_halves(loop)
    channels = [open_channel(halves, i) for i in channels_at(loop, at)]
    systems = (halves, close_channels(halves), *channels)
    poles = _finite(np.concatenate([growth_rates(one) for one in systems]))
    fastest = float(np.abs(poles).max(initial=0.0))
    found = np.concatenate([np.zeros(0), *(transmission_zeros(one) for one in channels if zeros)])
    if loop.period_s is not None:
        found = _finite(np.log(found[np.abs(found) > 0.0]) / loop.period_s)
    return np.append(poles, found[np.abs(found) <= fastest / AT_REST] if fastest > 0.0 else found), fastest


def _finite(rates: np.ndarray) -> np.ndarray:
    return rates[np.isfinite(rates)]


def _on_pole(features: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Whether each line lies on a pole on the axis."""
    centre = np.abs(np.imag(features))
    bare = np.sort(centre[(np.abs(np.real(features)) < UNDAMPED * centre) & (centre > 0.0)])
    if not len(bare):
        return np.zeros(len(omega), dtype=bool)
    above = np.searchsorted(bare, omega)
    near = np.minimum(
        np.abs(omega - bare[np.maximum(above - 1, 0)]), np.abs(omega - bare[np.minimum(above, len(bare) - 1)])
    )
    return near < 0.5 * BESIDE * omega


def _clusters(features: np.ndarray) -> np.ndarray:
    """Lines around each resonance and antiresonance, never on an undamped one."""
    centre, width = _apart(np.abs(np.imag(features)), np.abs(np.real(features)))
    undamped = width < UNDAMPED * centre
    width = np.where(undamped, BESIDE * centre, width)
    offset = width[:, None] * HALF_WIDTHS
    offset[undamped, 0] = width[undamped]
    return np.concatenate([(centre[:, None] + offset).ravel(), (centre[:, None] - offset).ravel()])


def _apart(centre: np.ndarray, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres that differ by more than a twentieth of their width: those of many channels mostly coincide."""
    size = np.maximum(width, UNDAMPED * centre) + np.finfo(float).tiny
    grain = np.exp(SAME * np.round(np.log(size) / SAME))
    _, first = np.unique(np.stack([np.round(centre / (SAME * grain)), grain]), axis=1, return_index=True)
    return centre[first], width[first]


def add_ends(loop: FeedbackLoop, ratio: Response, curve: Curve) -> Curve:
    """The curve extended to zero frequency and to half the sampling rate, where finite."""
    period = loop.period_s
    ends = np.array([0.0] if period is None else [0.0, np.pi / period])
    omega, value = (
        np.concatenate(both) for both in zip(curve, _finite_lines(ends, ratio(1j * ends)), strict=True)
    )
    order = np.argsort(omega, kind="stable")
    return omega[order], value[order]


def _where_settled(ratio: Response, omega: float) -> float:
    """Frequency at or below ``omega`` where all gains are constant, or outside 1 / `WIDEST` to `WIDEST`."""
    for _ in range(SLOWEST_DECADES):
        L = np.abs(ratio(1j * omega * np.array([0.1, 1.0])))
        beyond = np.all(~np.isfinite(L) | (L > WIDEST) | (L < 1.0 / WIDEST), axis=0)
        if np.all(beyond | (np.abs(L[1] - L[0]) < 1e-3 * L[0])):
            break
        omega *= 0.1
    return omega


def _where_gone(ratio: Response, omega: float) -> float:
    """Frequency at or above ``omega`` where no loop gain exceeds 1 / `WIDEST`; at most a thousand ``omega``.

    With a direct term the gain never falls, and with unlike delays crossings repeat.
    """
    for factor in np.geomspace(1.0, 1e3, 13):
        there = np.abs(ratio(1j * omega * factor * np.array([1.0, 1.3, 1.7])))
        if np.all(there < 1.0 / WIDEST):
            return omega * float(factor)
    return omega * 1e3


def _where_repeated(ratio: Response, omega: float, wave: ReturnedWave) -> float:
    """Frequency a turn of the delays above one, not below ``omega``, from which the ratio depends on their
    phases only; at most a thousand ``omega``."""
    turn = 2.0 * np.pi / wave.common_s
    phases = turn * np.linspace(0.0, 1.0, PHASES * int(wave.multiples.max()), endpoint=False)
    start = omega
    for factor in np.geomspace(1.0, 1e3, 13):
        start = omega * float(factor)
        L, later = (ratio(1j * (first + phases)) for first in (start, start + turn * np.ceil(start / turn)))
        away = np.abs(np.abs(later) - 1.0).min(axis=0)
        if np.all(np.abs(later - L) <= SETTLED * np.maximum(away, NEAREST)):
            break
    return start + turn


def refine_lines(ratio: Response, omega: Float[np.ndarray, " line"], finer: float = 1.0) -> Curve:
    """The ratio with lines added where gain or phase of any channel changes much from line to line.

    Only within a factor `WIDEST` of unit gain, which limits the approach to poles and zeros on the axis.
    Lines where the ratio is infinite are dropped. ``finer`` divides the steps allowed.
    """
    omega, value = _finite_lines(omega, ratio(1j * omega))
    found = [(omega, value)]
    # Ends of the steps to look at: after the first round those that a new line has cut.
    w, L = np.stack([omega[:-1], omega[1:]]), np.stack([value[:-1], value[1:]])
    for _ in range(ROUNDS):
        coarse = _coarse(L, finer) & (w[1] - w[0] > FINEST * w[1])
        if not coarse.any():
            break
        w, L = w[:, coarse], L[:, coarse]
        middle = w[0] + OFF_MIDDLE * (w[1] - w[0])
        new = ratio(1j * middle)
        cut = np.isfinite(new).all(axis=1)
        w, L, middle, new = w[:, cut], L[:, cut], middle[cut], new[cut]
        found.append((middle, new))
        w = np.hstack([np.stack([w[0], middle]), np.stack([middle, w[1]])])
        L = np.concatenate([np.stack([L[0], new]), np.stack([new, L[1]])], axis=1)
    omega, value = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(omega, kind="stable")
    return omega[order], value[order]


def _finite_lines(omega: np.ndarray, value: np.ndarray) -> Curve:
    keep = np.isfinite(value).all(axis=1)
    return omega[keep], value[keep]


def _coarse(L: Complex[np.ndarray, "2 step channel"], finer: float) -> np.ndarray:
    """Whether each step, from the first of the two values to the second, is too long."""
    size = np.maximum(np.abs(L), 1e-300)
    level = np.log(size)
    inside = np.abs(level) < np.log(WIDEST)
    turn = np.abs(np.angle(L[1] / size[1] * np.conj(L[0] / size[0])))
    stretch = np.abs(level[1] - level[0])
    return np.any((inside[1] | inside[0]) & ((turn > TURN / finer) | (stretch > STRETCH / finer)), axis=1)
