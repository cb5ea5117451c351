"""Gain, phase and delay margins and sensitivity peaks of each loop, the others closed, delays exact."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import (
    At,
    Compensator,
    FeedbackLoop,
    Plant,
    approximate_halves,
    broken_at,
    channels_at,
    form_loop,
    moved_part,
    open_channel,
)
from middeck.control.analysis.loop.frequency_lines import WIDEST, add_ends, place_lines, refine_lines
from middeck.control.analysis.loop.returned_wave import ReturnedWave, repeating_loop
from middeck.control.analysis.margins.all_phases import all_phases, highest_of, largest_negative
from middeck.control.analysis.margins.crossings import (
    Crossings,
    Ratio,
    axis_crossings,
    circle_crossings,
    find_peaks,
    join_crossings,
)
from middeck.control.analysis.margins.delay_limit import sampled_delay_limits
from middeck.control.analysis.margins.disk import DiskMargin, disk_from_peak
from middeck.control.analysis.margins.neutral import bears_no_delay
from middeck.control.analysis.margins.return_ratio import broken_ratio, ratio_at, wave_ratio
from middeck.control.analysis.stability.stability import LoopStability, decide_loop
from middeck.control.analysis.text_table import align_columns
from middeck.control.law.rounding_of_results import measure_known
from middeck.errors import ConfigError
from middeck.systems.poles.integrators import part_integrators
from middeck.systems.state_space.statespace import LinearSystem, StateSpace
from middeck.values import record

HEAD = ("broken at", "gain dB", "at Hz", "phase deg", "at Hz", "delay ms", "disk", "max |S|", "at Hz")


@record
class Peak:
    """The largest gain of a function and where it lies."""

    gain: float
    frequency_hz: float


@record(kw_only=True)
class LoopMargins:
    """Margins of one loop, the others closed.

    Attributes:
        channel: Channel at which the loop is broken.
        gain: Factors on the loop gain, above and below one, that put a pole on the axis, ascending.
        gain_hz: Frequency [Hz] of that pole.
        phase_rad: Lag (positive) or lead (negative) that does so at each frequency of unit gain, the smaller
            of the two.
        phase_hz: Frequencies of unit gain [Hz], ascending.
        delay_s: Least additional delay that does so at each of these frequencies (possibly beyond half a
            turn), preceded by zero where the gain stays at one or above at infinite frequency: any delay is
            then unstable. Sampled loops give the smallest only; None where it was not requested, and where
            the continuous plant is unknown (samples do not determine how a delay turns a mode beyond half the
            rate).
        sensitivity: Peak of 1 / (1 + L).
        disk: The balanced disk margin of this loop alone.
    """

    channel: str
    gain: Float[np.ndarray, " axis"]
    gain_hz: Float[np.ndarray, " axis"]
    phase_rad: Float[np.ndarray, " circle"]
    phase_hz: Float[np.ndarray, " circle"]
    delay_s: Float[np.ndarray, " delay"] | None
    sensitivity: Peak
    disk: DiskMargin

    @property
    def broken(self) -> bool:
        """Whether the loop is unstable: it then has crossings, but limits of zero."""
        return self.disk.alpha == 0.0

    @property
    def gain_limits(self) -> tuple[float, float]:
        """Nearest gain factors below and above one; 0 and ``inf`` if none, both one if unstable."""
        if self.broken:
            return 1.0, 1.0
        below, above = self.gain[self.gain < 1.0], self.gain[self.gain > 1.0]
        return float(below.max(initial=0.0)), float(above.min(initial=np.inf))

    @property
    def gain_db(self) -> float:
        """Smaller gain margin [dB], not negative."""
        below, above = self.gain_limits
        down = -20.0 * np.log10(below) if below else np.inf
        return float(min(down, 20.0 * np.log10(above)))

    @property
    def phase_limit_rad(self) -> float:
        """Smallest phase margin [rad], lag or lead; ``inf`` where the gain is never one, 0 if unstable."""
        return 0.0 if self.broken else float(np.abs(self.phase_rad).min(initial=np.inf))

    @property
    def delay_limit_s(self) -> float:
        """Delay margin [s], 0 if unstable. Raises `ConfigError` where it is not known."""
        if self.broken:
            return 0.0
        if self.delay_s is None:
            raise ConfigError(
                "the delay margin of a sampled loop is not known without its continuous plant",
                hint="measure_margins of the continuous plant, with delays=True",
            )
        return float(self.delay_s.min(initial=np.inf))


@record
class Margins:
    """Margins of all loops of a plant and its compensator; ``print`` shows them as a table.

    The table has one row a loop: gain, phase and delay margins with their frequencies, disk margin and peak
    of S. ``-``: no limit. ``?``: a delay margin that was not computed. The row of an unstable loop gives its
    fastest-growing root.

    Attributes:
        stability: Stability of the loop. An unstable loop has crossings but no margins: its limits and disks
            are zero.
        loops: One for each channel.
    """

    stability: LoopStability
    loops: tuple[LoopMargins, ...]

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return self.stability.stable

    def __str__(self) -> str:
        if not self.stable:
            root = self.stability
            return f"unstable: a root at {root.frequency_hz:.4g} Hz grows by {-root.margin:.3g} 1/s"
        return align_columns([HEAD, *map(_cells, self.loops)])


def _cells(loop: LoopMargins) -> tuple[str, ...]:
    gain = np.argmin(np.abs(np.log(loop.gain))) if len(loop.gain) else None
    phase = np.argmin(np.abs(loop.phase_rad)) if len(loop.phase_rad) else None
    return (
        loop.channel,
        "-" if gain is None else f"{20.0 * np.log10(loop.gain[gain]):+.1f}",
        "-" if gain is None else f"{loop.gain_hz[gain]:.4g}",
        "-" if phase is None else f"{np.degrees(abs(loop.phase_rad[phase])):.1f}",
        "-" if phase is None else f"{loop.phase_hz[phase]:.4g}",
        "?" if loop.delay_s is None else "-" if not len(loop.delay_s) else f"{1e3 * loop.delay_limit_s:.3g}",
        f"{loop.disk.alpha:.3f}",
        f"{loop.sensitivity.gain:.3f}",
        f"{loop.sensitivity.frequency_hz:.4g}",
    )


@named_kinds
def measure_margins(
    plant: Plant, compensator: Compensator, *, at: At = "inputs", delays: bool = True
) -> Margins:
    """Margins with one loop broken at a time, all others closed, delays exact.

    L = -K G; a crossing is a frequency at which 1 + k L exp(-j phi) = 0 for a gain k or a phase phi alone.
    Crossings are bracketed on lines around every pole and zero and solved to rounding; those that need a
    change of gain beyond 80 dB are left out, and of thousands that a delay makes all but the 300 nearest to a
    gain of one on each side. Real poles through the origin, z = -1 or infinity (direct terms, no delay) count
    among the gains. Where the delays of direct terms are multiples of one time (200 at most), the limits to
    which crossings and peaks tend at infinite frequency count too, at ``inf`` Hz; without such a time, the
    nearest of them over all phases of the delays. Delays of the plant stay in
    the loop. The poles of an undamped loop are on the axis: its phase margin is zero, and its limits of gain
    are where two poles meet and leave the axis.

    For a sampled compensator L(exp(j w T)) includes hold and delays. Its delay margin is the least additional
    delay of a channel with which the plant, sampled anew, gives an unstable loop
    (`middeck.control.analysis.margins.delay_limit`): most of the work, skipped with ``delays=False``.

    Raises `ConfigError` for halves that do not fit (`form_loop`), `NumericalError` where rounding hides which
    integrators the loop moves (`moved_part`). Warns (`UserWarning`) where rounding of the matrices makes
    limits, disks or peaks uncertain (`measure_known`).

    >>> import middeck as md
    >>> integrator = md.make_plant([[0.0]], [[1.0]], [[1.0]])
    >>> none, gain = np.zeros((0, 1)), -np.eye(1)
    >>> law = md.systems.StateSpace(none @ none.T, none, none.T, gain)
    >>> P = md.Compensator(law, integrator.outputs, integrator.inputs)
    >>> one = measure_margins(md.delay_plant(integrator, 0.1), P).loops[0]
    >>> one.gain_limits[1].__round__(9), one.phase_limit_rad.__round__(9)    # pi/(2 tau), pi/2 - tau
    (15.707963268, 1.470796327)
    >>> print(measure_margins(integrator, P))
    broken at  gain dB  at Hz  phase deg  at Hz   delay ms  disk   max |S|  at Hz
    u1         -        -      90.0       0.1592  1.57e+03  2.000  1.000    477.5
    """
    return measure_known("margins", lambda *both: _measure(*both, at, delays), _numbers, plant, compensator)


def _numbers(margins: Margins) -> Float[np.ndarray, " number"]:
    """Limits, disks and peaks as logarithms, and angles [rad]; none of an unstable loop."""
    return np.concatenate([_numbers_of(loop) for loop in margins.loops if margins.stable] or [np.zeros(0)])


def _numbers_of(loop: LoopMargins) -> Float[np.ndarray, " number"]:
    # Around the time of a radian a delay counts as an angle: that of an undamped loop is zero.
    radian_s = 1.0 / (2.0 * np.pi * loop.phase_hz.max(initial=1e-300))
    delay_s = np.inf if loop.delay_s is None else loop.delay_limit_s
    sizes = [*loop.gain_limits, radian_s + delay_s, loop.sensitivity.gain, loop.disk.alpha]
    return np.append(np.log(sizes), loop.phase_limit_rad)


def _measure(plant: Plant, compensator: Compensator, at: At, delays: bool) -> Margins:
    loop = form_loop(plant, compensator)
    stability, loop = decide_loop(loop), moved_part(loop)
    ratio = broken_ratio(loop, at)
    even, wave = repeating_loop(loop)
    lines = place_lines(even, at, ratio if even is loop else broken_ratio(even, at))
    curve = refine_lines(ratio, lines)
    # The ends are real: no change of sign shows a crossing there.
    axis, circle = axis_crossings(ratio, *curve), circle_crossings(ratio, *curve)
    beyond: list[Curve] = []
    peaks: list[Peaks] = [(0.0, 0.0)] * len(broken_at(loop, at))
    if wave is not None and even is loop:
        beyond = [_trace_turn(wave, at)]
        axis = join_crossings(axis, _at_infinity(axis_crossings(*beyond[0])))
    elif wave is not None and stability.stable:
        far, peaks = _over_all_phases(loop, wave, at)
        axis = join_crossings(axis, far)
    omega, L = add_ends(loop, ratio, curve)
    ends = find_ends(loop, at)
    held, stable = loop.period_s is not None, stability.stable
    limits = [0.0] * len(broken_at(loop, at))
    if held and stable and delays and plant.period_s is None:
        limits = sampled_delay_limits(loop, plant, compensator, at, curve[0])
    loops: list[LoopMargins] = []
    for i, (name, none) in enumerate(zip(broken_at(loop, at), bears_no_delay(loop, at), strict=True)):
        curves = [(ratio, omega, L), *beyond]
        own = [_one_channel(curve, i) for curve in curves]
        one = _describe(name, i, (own, peaks[i]), (axis, circle), ends, stable)
        delay_s = one.delay_s
        if held:
            known = delays and plant.period_s is None
            delay_s = np.array([limits[i]] if 0.0 < limits[i] < np.inf else []) if known else None
        elif none and stable:
            delay_s = np.append(0.0, [] if delay_s is None else delay_s)
        loops.append(dataclasses.replace(one, delay_s=delay_s))
    return Margins(stability, tuple(loops))


def _one_channel(curve: Curve, i: int) -> Curve:
    ratio, omega, L = curve
    return lambda s: ratio(s)[:, i], omega, L[:, i]


def _trace_turn(wave: ReturnedWave, at: At) -> Curve:
    """The ratio at infinite frequency over one turn of the delays."""
    ratio = wave_ratio(wave, at)
    return ratio, *refine_lines(ratio, wave.turn)


def _at_infinity(found: Crossings) -> Crossings:
    return dataclasses.replace(found, omega=np.full(len(found.omega), np.inf))


def _over_all_phases(loop: FeedbackLoop, wave: ReturnedWave, at: At) -> tuple[Crossings, list[Peaks]]:
    """The nearest gain, and the peaks of each channel, at infinite frequency, over all phases of the delays.

    Of a stable loop with unlike delays all gains there are above one (`direct_gain`).
    """
    phases, found, peaks = all_phases(loop, wave), [], []
    for i in range(len(broken_at(loop, at))):

        def ratio(lag: np.ndarray, i: int = i) -> Complex[np.ndarray, " point"]:
            return ratio_at(wave, lag, at)[:, i]

        found.append(largest_negative(phases, ratio))
        S, skewed = (
            highest_of(phases, lambda lag, size=size: size(ratio(lag))) for size in (_sensitivity, _skewed)
        )
        peaks.append((S, skewed))
    channel = np.array([i for i, size in enumerate(found) if size > 1.0 / WIDEST], dtype=int)
    far = Crossings(np.zeros(len(channel)), channel, -np.array(found)[channel] + 0.0j)
    return _at_infinity(far), peaks


def _describe(
    name: str,
    i: int,
    sizes: tuple[list[Curve], Peaks],
    crossings: tuple[Crossings, Crossings],
    ends: Ends,
    stable: bool,
) -> LoopMargins:
    axis, circle = crossings
    real = [(w, float(-1.0 / value[i].real)) for w, value in ends if _bears_gain(value[i])]
    gain = np.concatenate([-1.0 / np.real(axis.L[axis.channel == i]), [k for _, k in real]])
    gain_at = np.concatenate([axis.omega[axis.channel == i], [w for w, _ in real]])
    order = np.argsort(gain, kind="stable")
    at, value = circle.omega[circle.channel == i], circle.L[circle.channel == i]
    lag = np.mod(np.angle(value) + np.pi, 2.0 * np.pi)
    turn = 2.0 * np.pi

    curves, far = sizes
    (at_S, S), (worst, skewed) = (
        max(_highest(curves, one), (np.inf, least), key=lambda each: each[1])
        for one, least in zip((_sensitivity, _skewed), far, strict=True)
    )
    return LoopMargins(
        channel=name,
        gain=gain[order],
        gain_hz=gain_at[order] / turn,
        phase_rad=np.where(lag > np.pi, lag - turn, lag),
        phase_hz=at / turn,
        delay_s=lag / at,
        sensitivity=Peak(S, at_S / turn),
        disk=disk_from_peak(skewed if stable else np.inf, worst),
    )


def _highest(curves: list[Curve], size: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Largest value and its frequency: on the lines of the first curve, or at infinite frequency on the turn
    of the second."""
    found = [_peak(curve, size) for curve in curves]
    beyond = [(np.inf, value) for _, value in found[1:]]
    return max([found[0], *beyond], key=lambda each: each[1])


def _peak(curve: Curve, size: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Largest value of a function of one channel's ratio, and its frequency."""
    ratio, omega, L = curve

    def gain(w: np.ndarray) -> np.ndarray:
        there = ratio(1j * w)
        # On a pole of the ratio nothing peaks: S vanishes there.
        return size(np.where(np.isfinite(there), there, 0.0))

    with np.errstate(divide="ignore"):  # all are infinite on a root of the loop
        return find_peaks(gain, omega, size(L))


def _sensitivity(L: np.ndarray) -> np.ndarray:
    return 1.0 / np.abs(1.0 + L)


def _skewed(L: np.ndarray) -> np.ndarray:
    """|S - 1/2|, see `middeck.control.analysis.margins.disk`."""
    return 0.5 * np.abs(1.0 - L) / np.abs(1.0 + L)


def _bears_gain(value: complex) -> bool:
    """Whether a real end point is a crossing within 80 dB of unit gain."""
    return bool(1.0 / WIDEST < -value.real < WIDEST)


Curve = tuple[Ratio, np.ndarray, np.ndarray]
"""The ratio as a function of s, lines [rad/s], and its values there."""
Peaks = tuple[float, float]
"""Of a channel's S, and of its S - 1/2."""
Ends = tuple[tuple[float, Complex[np.ndarray, " channel"]], ...]
"""Angular frequency [rad/s] and the ratio of each channel there; infinite on a pole."""


def find_ends(loop: FeedbackLoop, at: At) -> Ends:
    """The ratio at zero frequency, where delays have no effect, and at the other end; delayed loops have no
    limit there and give the first only."""
    halves = approximate_halves(loop)
    channels = [open_channel(halves, i) for i in channels_at(loop, at)]
    period = loop.period_s
    if period is not None:
        rest, fastest = (_values(channels, point) for point in (1.0, -1.0))
        return (0.0, rest), (np.pi / period, fastest)
    rest = _values(channels, 0.0)
    if loop.plant.delayed:
        return ((0.0, rest),)
    return (0.0, rest), (np.inf, np.array([-one.D[0, 0] for one in channels], dtype=complex))


def _values(channels: list[LinearSystem], point: float) -> Complex[np.ndarray, " channel"]:
    return np.array([-_at(one, point) for one in channels], dtype=complex)


def _at(system: LinearSystem, point: float) -> float:
    """The transfer at a real point; infinite on a pole whose residues do not vanish."""
    beside = StateSpace(system.A - point * np.eye(len(system.A)), system.B, system.C, system.D)
    parted = part_integrators(beside)
    if np.any(parted.residues):
        return np.inf
    moving = parted.moving
    return float((moving.D - moving.C @ np.linalg.solve(moving.A, moving.B))[0, 0])
