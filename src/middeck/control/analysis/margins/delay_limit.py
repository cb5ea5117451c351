"""Delay margin of each channel of a sampled loop.

A further delay of n whole periods multiplies L(exp(j w T)) by exp(-j w n T): only frequencies of unit gain
can become roots on the circle, and each does whenever its phase has turned to the critical point. The number
of unstable roots thus follows for all n from that at n = 0 and from the frequencies of unit gain (Walton and
Marshall 1987, IEE Proceedings D 134, "Direct method for TDS stability analysis", for sampled loops).

A delay of a part of a period does not turn L: each mode turns at its own frequency, also beyond half the
rate, where its image may turn the other way. So the channel's own paths are sampled anew at every part
(`delayed_channel`); unstable roots are counted by how often 1 + L then goes round the origin.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.optimize as opt
from jaxtyping import Bool, Complex, Float

from middeck.control.analysis.loop.feedback_loop import At, FeedbackLoop, loop_path
from middeck.control.analysis.loop.frequency_lines import refine_lines
from middeck.control.analysis.margins.crossings import Crossings, circle_crossings
from middeck.control.analysis.margins.delayed_channel import DelayedChannel, delayed_channels
from middeck.control.law.compensator import Compensator
from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.state_space.statespace import StateSpace, poles
from middeck.values import record

TURN = 0.5
"""Phase step [rad] of the fastest light mode between delays tried: a loop of this mode alone that is unstable
over less of a turn, 2 arccos(1/L), has a gain within 3 % of the limit."""
MOST_STEPS = 20000
LOOKED = 20
"""Periods searched beyond the first turn of the slowest frequency of falling unit gain."""
AT_ONCE = 2**16
FORWARD = 1.0
"""Largest step ahead [rad] of the phase from line to line: a longer one passes a pole on the circle, by half
a turn back."""
PRECISION = 1e-10
BESIDE = np.arange(3)
"""Whole periods tried from the one in which L turns through the critical point: rounding may be one off."""


@record(kw_only=True)
class UnitGain:
    """Frequencies of unit gain of a loop delayed by part of a period.

    Attributes:
        growing: Number of unstable roots without further delay.
        angle: w T of each frequency of unit gain, ascending.
        lag: Phase lag there that turns L to the critical point, from 0 to 2 pi.
        falling: Whether the gain falls through one there; otherwise it rises.
        open_end: Whether the gain is above one at half the rate: a real or complex root then grows with each
            period.
    """

    growing: int
    angle: Float[np.ndarray, " crossing"]
    lag: Float[np.ndarray, " crossing"]
    falling: Bool[np.ndarray, " crossing"]
    open_end: bool


def sampled_delay_limits(
    loop: FeedbackLoop, plant: Plant, compensator: Compensator, at: At, lines: Float[np.ndarray, " line"]
) -> list[float]:
    """Least additional delay [s] of each channel alone that makes the sampled loop unstable; ``inf`` if none.

    ``loop`` is ``plant`` sampled, with ``compensator``, and stable; ``lines`` [rad/s] resolve its ratios.
    """
    path, period = loop_path(plant, compensator), compensator.sampled.period_s
    system = remove_delays(path).system
    limits: list[float] = []
    for channel in delayed_channels(loop, path, at, lines):
        gain_at = functools.partial(_unit_gain, channel, period, lines, _trace(channel, lines, 0.0))
        limits.append(find_delay_limit(gain_at, system, period))
    return limits


@record
class _Curve:
    """The ratio of a channel on lines, its frequencies of unit gain, and how far 1 + L turns [rad]."""

    omega: Float[np.ndarray, " line"]
    L: Complex[np.ndarray, " line"]
    found: Crossings
    turned: float


def _trace(channel: DelayedChannel, lines: np.ndarray, part: float) -> _Curve:
    ratio = channel(part)
    omega, L = refine_lines(ratio, lines)
    found = circle_crossings(ratio, omega, L)
    order = np.argsort(found.omega, kind="stable")
    found = Crossings(found.omega[order], found.channel[order], found.L[order])
    return _Curve(omega, L[:, 0], found, _turn(omega, L[:, 0], found))


def _unit_gain(
    channel: DelayedChannel, period_s: float, lines: np.ndarray, now: _Curve, part: float
) -> UnitGain:
    """The loop with one channel delayed by ``part`` of a period, from the stable one ``now``."""
    curve = _trace(channel, lines, part) if part else now
    # A delay does not change the ratio at rest, where both would start.
    apart = float(np.angle((1.0 + curve.L[0]) / (1.0 + now.L[0])))
    above = np.abs(curve.L) > 1.0
    return UnitGain(
        growing=-round((curve.turned - now.turned + apart) / np.pi),
        angle=curve.found.omega * period_s,
        lag=np.mod(np.angle(curve.found.L) + np.pi, 2.0 * np.pi),
        falling=(np.arange(len(curve.found.omega)) % 2 == 0) == bool(above[0]),
        open_end=bool(above[-1]),
    )


def _turn(omega: np.ndarray, L: np.ndarray, found: Crossings) -> float:
    """Change of the argument of 1 + L along the lines [rad].

    Where the gain is below one it stays within a quarter turn; above, 1 + L turns as L and 1 + 1/L.
    """
    place = np.searchsorted(omega, found.omega)
    unit = found.L / np.abs(found.L)
    values = np.insert(L, place, unit)
    crossed = np.insert(np.zeros(len(L), dtype=bool), place, True)
    above = (np.cumsum(crossed)[:-1] % 2 == 0) == bool(np.abs(L[0]) > 1.0)
    inverse = np.abs(values) > 1.0
    small = np.where(inverse, 1.0 / np.where(inverse, values, 1.0), values)
    # At unit gain the angles of 1 + L and of 1 + 1/L are half of that of L, ahead and back.
    inside = np.where(crossed, 0.5 * np.angle(values), np.angle(1.0 + small))
    outside = np.where(crossed, -inside, inside)
    step = np.mod(np.diff(np.angle(values)) - FORWARD, 2.0 * np.pi) + FORWARD - 2.0 * np.pi
    return float(np.sum(np.where(above, step + np.diff(outside), np.diff(inside))))


def find_delay_limit(gain_at: Callable[[float], UnitGain], system: StateSpace, period_s: float) -> float:
    """Least additional delay [s] at which the loop is unstable; ``inf`` where none is found.

    ``gain_at`` takes fractions of a period from 0 to 1.
    """
    gain_at = functools.cache(gain_at)  # the ends are asked for again
    parts = np.arange(count := _steps(system, period_s)) / count
    first = [_first_unstable(gain_at(float(part))) for part in parts]
    k = int(np.argmin(first + parts))
    if not np.isfinite(first[k]):
        return np.inf
    whole, high = int(first[k]), float(parts[k])
    if k == 0:  # on this side of a whole number of periods the state of the one before is what is known
        if whole == 0:
            return 0.0
        whole, high = whole - 1, 1.0
    low = float(parts[k - 1])
    tolerance = max(PRECISION * (whole + high), 1e-14)

    def clearance(part: float) -> float:
        return _clearance(gain_at(part), whole)

    # At the stability limit rounding alone may separate the two ends: return the unstable one.
    if clearance(low) <= 0.0 or clearance(high) >= 0.0:
        return period_s * (whole + high)
    solve: Any = opt.brentq
    return period_s * (whole + float(solve(clearance, low, high, xtol=tolerance)))


def _steps(system: StateSpace, period_s: float) -> int:
    """Number of fractions of a period tried."""
    rates = np.asarray(poles(system))
    turning = np.abs(np.imag(rates))
    light = turning[turning > np.abs(np.real(rates))]
    steps = float(np.ceil(light.max(initial=0.0) * period_s / TURN))
    if not steps <= MOST_STEPS:
        turned = steps * TURN / (2.0 * np.pi)
        raise NumericalError(
            f"a mode turns {turned:.3g} times in a period: its delay margin is not found",
            hint="a higher rate, or a plant without the modes far above it",
        )
    return max(1, int(steps))


def _first_unstable(gain: UnitGain) -> float:
    """The least whole number of periods at which roots grow."""
    falling = gain.angle[gain.falling]
    turn = 2.0 * np.pi / float(falling.min()) if len(falling) else 0.0
    end = int(turn) + LOOKED
    # Roots begin to grow just after a turn through the critical point, or with each period.
    rare = float(falling.sum()) / (2.0 * np.pi)
    each = end <= AT_ONCE or gain.open_end or rare > 1.0 / len(BESIDE)
    width = AT_ONCE if each else int(AT_ONCE / max(rare, 1.0 / end))
    for start in range(0, end, width):
        stop = min(start + width, end)
        whole = np.arange(start, stop) if each else _after_turns(gain, start, stop)
        unstable = np.flatnonzero(_growing(gain, whole) > 0)
        if len(unstable):
            return float(whole[unstable[0]])
    return np.inf


def _after_turns(gain: UnitGain, start: int, stop: int) -> np.ndarray:
    """``start``, and the numbers of periods before ``stop`` within one of which L has turned through the
    critical point where its gain falls through one."""
    found = [np.array([start])]
    for angle, lag in zip(gain.angle[gain.falling], gain.lag[gain.falling], strict=True):
        low, high = ((n * angle - lag) / (2.0 * np.pi) for n in (start, stop))
        at = (lag + 2.0 * np.pi * np.arange(np.floor(low), np.ceil(high) + 1.0)) / angle
        found.append((np.floor(at)[:, None] + BESIDE).ravel().astype(int))
    whole = np.unique(np.concatenate(found))
    return whole[(whole >= start) & (whole < stop)]


def _growing(gain: UnitGain, whole: np.ndarray) -> np.ndarray:
    """Number of unstable roots: two more each time L turns through the critical point where its gain falls
    through one, two fewer where it rises."""
    passed = np.ceil((whole[:, None] * gain.angle - gain.lag) / (2.0 * np.pi))
    pairs = passed @ np.where(gain.falling, 1.0, -1.0)
    return gain.growing + 2.0 * pairs + whole * float(gain.open_end)


def _clearance(gain: UnitGain, whole: int) -> float:
    """Periods to the nearest root on the circle; negative where roots grow."""
    turned = (whole * gain.angle - gain.lag) / (2.0 * np.pi)
    away = np.abs(turned - np.round(turned)) * 2.0 * np.pi / gain.angle
    sign = -1.0 if _growing(gain, np.array([whole]))[0] > 0 else 1.0
    return sign * float(away.min(initial=1.0))
