"""A loop on the rig itself, by eigenvalues and return ratio: whether it holds, how well, how near to not.

This is asked of the rig without limits, steps, Coulomb friction and noise (`linearise_rig`), sampled and
with its true delay. No design sees it; it says what a drift would do, for which no run is spent.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.compensator import Compensator
from middeck.realtime.linear_view import linearise_rig
from middeck.realtime.rig import close_sampled_loop
from middeck.study.bench import Bench, law_on
from middeck.systems.response import statespace_response
from middeck.systems.stability import GROWTH_LIMIT, growth_rates
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record

LOWEST_HZ = 0.02  # margins are sought from here to half the sampling rate
DECADE_POINTS = 300
# Points about each resonance, in half-widths: they part its circle in the Nyquist diagram into even arcs.
AROUND = np.tan(np.linspace(-1.45, 1.45, 25))


@record
class RigView:
    """A bench seen through its linear rig: responses on a grid on which every resonance is resolved.

    ``lines`` are the indices of the lines that the excitation has, on which decibels are taken.
    """

    bench: Bench
    sampled: SampledStateSpace
    frequency_hz: Float[np.ndarray, " point"]
    H: Complex[np.ndarray, "point output input"]
    lines: tuple[int, ...]


@record
class RigLoop:
    """One law on one bench.

    Parameters
    ----------
    percent:
        Shift of the pair of modes.
    stable:
        By the eigenvalues of the sampled loop.
    growth_hz, growth_rad_s:
        Frequency and real part of the pole that grows fastest or decays slowest.
    improvement_db:
        20 log10 of the closed-loop rms of the first output in the band over the open-loop one on the same
        bench; None for an unstable loop, as are the margins.
    gain_margin_db, phase_margin_deg:
        The least change of the loop's gain, up or down, and the least turn of its phase, either way, that
        bring a pole to the axis; None where none does.
    gain_margin_hz, phase_margin_hz:
        Where.
    """

    percent: float
    stable: bool
    growth_hz: float
    growth_rad_s: float
    improvement_db: float | None
    gain_margin_db: float | None
    gain_margin_hz: float | None
    phase_margin_deg: float | None
    phase_margin_hz: float | None


def view_rig(bench: Bench) -> RigView:
    """Linearise the rig of ``bench`` and evaluate it once for all laws."""
    sampled = linearise_rig(bench.rig).sampled
    excited = _lines(bench)
    f = np.unique(np.concatenate([excited, _grid(sampled, bench.rig.sample_hz / 2.0)]))
    H = statespace_response(sampled, 2.0 * np.pi * f)
    return RigView(bench, sampled, f, H, tuple(int(i) for i in np.searchsorted(f, excited)))


def judge_loop(view: RigView, compensator: Compensator, percent: float) -> RigLoop:
    """The law on the rig of ``view``; its one input is where the loop is broken."""
    fastest = fastest_pole(view, compensator)
    grows = abs(fastest.imag) / (2.0 * np.pi), fastest.real
    if fastest.real > GROWTH_LIMIT:
        return RigLoop(percent, False, *grows, None, None, None, None, None)
    law = law_on(view.bench.rig, compensator)
    K = statespace_response(law, 2.0 * np.pi * view.frequency_hz)
    L = np.einsum("fuy,fyu->f", K, view.H)  # u = K y is added: the critical point is +1
    at = list(view.lines)
    opened = view.H[at, 0, 0]
    closed = opened / (1.0 - L[at])
    better = float(20.0 * np.log10(np.linalg.norm(closed) / np.linalg.norm(opened)))
    margins = (*gain_margin(view.frequency_hz, L), *phase_margin(view.frequency_hz, L))
    return RigLoop(percent, True, *grows, better, *margins)


def fastest_pole(view: RigView, compensator: Compensator) -> complex:
    """The pole of the sampled loop [rad/s] that grows fastest or decays slowest."""
    rates = growth_rates(close_sampled_loop(view.sampled, law_on(view.bench.rig, compensator)))
    return complex(rates[int(np.argmax(np.real(rates)))])


def judge_loops(views: Mapping[float, RigView], compensator: Compensator) -> tuple[RigLoop, ...]:
    """The same law with the pair of modes wherever it may be."""
    return tuple(judge_loop(view, compensator, percent) for percent, view in views.items())


def gain_margin(
    frequency_hz: Float[np.ndarray, " point"], L: Complex[np.ndarray, " point"]
) -> tuple[float | None, float | None]:
    """Least change of gain [dB] that brings L to +1, up or down, and where; None where none does.

    >>> f = np.linspace(0.01, 1.0, 2001)
    >>> L = -4.0 / (1.0 + 2j * np.pi * f) ** 3  # three equal lags bear a gain of eight
    >>> bool(abs(gain_margin(f, L)[0] - 6.02) < 0.01)
    True
    """
    re, im = np.real(L), np.imag(L)
    k = np.flatnonzero(np.signbit(im[1:]) != np.signbit(im[:-1]))
    share = im[k] / (im[k] - im[k + 1])
    real = re[k] + share * (re[k + 1] - re[k])
    where = frequency_hz[k] + share * (frequency_hz[k + 1] - frequency_hz[k])
    good = real > 0.0
    return _least(np.abs(20.0 * np.log10(real[good])), where[good])


def phase_margin(
    frequency_hz: Float[np.ndarray, " point"], L: Complex[np.ndarray, " point"]
) -> tuple[float | None, float | None]:
    """Least turn of phase [deg] that brings L to +1, and where; None where L never has size one.

    >>> f = np.linspace(0.01, 1.0, 2001)
    >>> L = -2.0 / (1.0 + 2j * np.pi * f) ** 2  # size one at 1 rad/s, where each lag turns by 45 degrees
    >>> bool(abs(phase_margin(f, L)[0] - 90.0) < 0.1)
    True
    """
    size = np.abs(L) - 1.0
    k = np.flatnonzero(np.signbit(size[1:]) != np.signbit(size[:-1]))
    share = size[k] / (size[k] - size[k + 1])
    at = L[k] + share * (L[k + 1] - L[k])
    where = frequency_hz[k] + share * (frequency_hz[k + 1] - frequency_hz[k])
    return _least(np.abs(np.degrees(np.angle(at))), where)


def _least(margin: np.ndarray, where: np.ndarray) -> tuple[float | None, float | None]:
    if not len(margin):
        return None, None
    first = int(np.argmin(margin))
    return float(margin[first]), float(where[first])


def _lines(bench: Bench) -> Float[np.ndarray, " line"]:
    """The lines of the excitation's period within the band."""
    step = bench.rig.sample_hz / len(bench.open_loop)
    low, high = bench.band_hz
    return step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)


def _grid(sampled: SampledStateSpace, highest_hz: float) -> Float[np.ndarray, " point"]:
    """Even in logarithm, and dense about each resonance of the rig."""
    points = round(DECADE_POINTS * np.log10(highest_hz / LOWEST_HZ))
    even = np.geomspace(LOWEST_HZ, highest_hz, points)
    rates = growth_rates(sampled)
    decay, omega = np.real(rates), np.imag(rates)
    modes = np.isfinite(decay) & (omega > 0.0)
    near = (omega[modes, None] - decay[modes, None] * AROUND).ravel() / (2.0 * np.pi)
    return np.concatenate([even, near[(near > LOWEST_HZ) & (near < highest_hz)]])
