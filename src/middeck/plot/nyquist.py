"""Nyquist's plot of broken loops, with the disk that they must not enter."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from middeck.control.analysis.margins.margins import LoopMargins, Margins
from middeck.control.analysis.margins.return_ratio import ReturnRatio
from middeck.plot.style import COLOUR, legend_below, square_pictures, styled

REACH = 2.5
"""Half width of the drawn square around the critical point."""


@styled
def draw_nyquist(ratio: ReturnRatio, margins: Margins) -> Figure:
    """L(j omega) of each channel for positive frequencies, one picture each, critical point -1.

    Shaded is the disk of the channel's own disk margin: the curve touches it, and no more. Dots are unit gain
    (phase margins), squares the negative real axis (gain margins).
    """
    return draw_loops(ratio, margins, _draw)


def _draw(axes: Axes, L: np.ndarray, margins: LoopMargins, *, stable: bool) -> None:
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


def draw_loops(ratio: ReturnRatio, margins: Margins, draw: Callable[..., None]) -> Figure:
    """One picture a channel: ``draw(axes, L, loop, stable=...)``; the legend below all."""
    figure, pictures = square_pictures(len(ratio.channels))
    for axes, L, loop in zip(pictures, ratio.L.T, margins.loops, strict=True):
        draw(axes, L, loop, stable=margins.stable)
    legend_below(figure, pictures)
    return figure


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
