"""Nyquist's plot of broken loops, with the disk that they must not enter, and Nichols's, with contours of the
closed loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from middeck.control.analysis.margins.margins import LoopMargins, Margins
from middeck.control.analysis.margins.return_ratio import ReturnRatio
from middeck.plot.curves import decibels
from middeck.plot.style import COLOUR, legend_below, square_pictures, styled

REACH = 2.5
"""Half width of the drawn square around the critical point."""


@styled
def draw_nyquist(ratio: ReturnRatio, margins: Margins) -> Figure:
    """L(j omega) of each channel for positive frequencies, one picture each, critical point -1.

    Shaded is the disk of the channel's own disk margin: the curve touches it, and no more. Dots are unit gain
    (phase margins), squares the negative real axis (gain margins).
    """
    return _pictures(ratio, margins, _on_the_plane)


def _pictures(
    ratio: ReturnRatio, margins: Margins, draw: Callable[[Axes, np.ndarray, LoopMargins, bool], None]
) -> Figure:
    figure, pictures = square_pictures(len(ratio.channels))
    for axes, L, loop in zip(pictures, ratio.L.T, margins.loops, strict=True):
        draw(axes, L, loop, margins.stable)
    legend_below(figure, pictures)
    return figure


def _on_the_plane(axes: Axes, L: np.ndarray, margins: LoopMargins, stable: bool) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(
        np.cos(turn), np.sin(turn), color=COLOUR["ghost"], linewidth=0.8, linestyle="--", label="unit circle"
    )
    low, high = margins.disk.gain
    if stable and np.isfinite(high):
        centre = -0.5 * (low + high), 0.0
        colours = {"facecolor": COLOUR["shade"], "edgecolor": COLOUR["ghost"]}
        axes.add_patch(Circle(centre, 0.5 * (high - low), label="disk of the disk margin", **colours))
    axes.plot(*_near(L), color=COLOUR["orbit"], label="L")
    unit = -np.exp(1j * margins.phase_rad)
    axes.plot(np.real(unit), np.imag(unit), "o", color=COLOUR["prediction"], label="unit gain: phase margins")
    crossing = -1.0 / margins.gain
    shown = crossing[crossing > -2.0 * REACH]
    axes.plot(shown, np.zeros(len(shown)), "s", color=COLOUR["low"], label="negative real axis: gain margins")
    draw_critical_point(axes, -1.0)
    axes.set_xlim(-1.0 - REACH, -1.0 + REACH)
    axes.set_ylim(-REACH, REACH)
    axes.set_aspect("equal")
    axes.set_xlabel("real part of L")
    axes.set_ylabel("imaginary part of L")
    axes.set_title(title_of(margins, stable=stable))


def _near(L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The curve with gaps where it is far outside the picture."""
    inside = np.abs(L) < 4.0 * REACH
    return np.where(inside, np.real(L), np.nan), np.where(inside, np.imag(L), np.nan)


def draw_critical_point(axes: Axes, at: float) -> None:
    """A cross on the horizontal axis."""
    look: dict[str, Any] = {"markersize": 11.0, "markeredgewidth": 1.8, "label": "critical point"}
    axes.plot([at], [0.0], "+", color=COLOUR["lab"], **look)


def title_of(margins: LoopMargins, *, stable: bool) -> str:
    """Name and margins of a loop in two lines."""
    if not stable:
        return f"broken at {margins.channel}:\nthe closed loop is unstable"
    phase = np.degrees(margins.phase_limit_rad)
    phase_words = f"{phase:.1f} deg" if np.isfinite(phase) else "any phase"
    gain_words = f"{margins.gain_db:.1f} dB" if np.isfinite(margins.gain_db) else "any gain"
    return f"broken at {margins.channel}:\n{gain_words}, {phase_words}, disk {margins.disk.alpha:.2f}"


CONTOURS_DB = (0.0, 3.0, 6.0, 12.0)
REACH_DB = 40.0


@styled
def draw_nichols(ratio: ReturnRatio, margins: Margins) -> Figure:
    """Gain [dB] of L over its phase, from -360 to 0 degrees, one picture a channel.

    The critical point is at -180 degrees and 0 dB; grey are contours of |L/(1 + L)|. Dots are unit gain,
    squares -180 degrees.
    """
    return _pictures(ratio, margins, _by_phase)


def _by_phase(axes: Axes, L: np.ndarray, margins: LoopMargins, stable: bool) -> None:
    _contours(axes)
    axes.plot(*_curve(L), color=COLOUR["orbit"], label="L")
    phase = np.degrees(_lag(-np.exp(1j * margins.phase_rad)))
    axes.plot(phase, np.zeros(len(phase)), "o", color=COLOUR["prediction"], label="unit gain: phase margins")
    level = -20.0 * np.log10(margins.gain)
    axes.plot(np.full(len(level), -180.0), level, "s", color=COLOUR["low"], label="-180 deg: gain margins")
    draw_critical_point(axes, -180.0)
    axes.set_xlim(-360.0, 0.0)
    axes.set_xticks([-360, -270, -180, -90, 0])
    axes.set_ylim(-REACH_DB, REACH_DB)
    axes.set_xlabel("phase of L [deg]")
    axes.set_ylabel("gain of L [dB]")
    axes.set_title(title_of(margins, stable=stable))


def _contours(axes: Axes) -> None:
    phase, level = np.meshgrid(np.linspace(-359.0, -1.0, 359), np.linspace(-REACH_DB, REACH_DB, 321))
    x = 10.0 ** (level / 20.0) * np.exp(1j * np.radians(phase))
    # On the critical point itself the closed loop is infinite: the grid keeps off it.
    closed = decibels(x / (1.0 + x + 1e-9))
    axes.contour(phase, level, closed, levels=CONTOURS_DB, colors=COLOUR["ghost"], linewidths=0.8)
    words = ", ".join(f"{x:g}" for x in CONTOURS_DB)
    axes.plot([], [], color=COLOUR["ghost"], linewidth=0.8, label=f"|L/(1 + L)|: {words} dB")


def _lag(L: np.ndarray) -> np.ndarray:
    """Phase from -2 pi to 0."""
    return np.mod(np.angle(L), 2.0 * np.pi) - 2.0 * np.pi


def _curve(L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Phase and level, with a gap where the phase goes round."""
    phase, level = np.degrees(_lag(L)), decibels(L)
    broken = np.append(np.abs(np.diff(phase)) > 180.0, False)
    return np.where(broken, np.nan, phase), level
