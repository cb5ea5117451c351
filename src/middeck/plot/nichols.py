"""Nichols's plot of broken loops: gain over phase, with contours of the closed loop."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.control.analysis.margins.margins import LoopMargins, Margins
from middeck.control.analysis.margins.return_ratio import ReturnRatio
from middeck.plot.curves import decibels
from middeck.plot.nyquist import draw_critical_point, draw_loops, title_of
from middeck.plot.style import COLOUR, styled

CONTOURS_DB = (0.0, 3.0, 6.0, 12.0)
REACH_DB = 40.0


@styled
def draw_nichols(ratio: ReturnRatio, margins: Margins) -> Figure:
    """Gain [dB] of L over its phase, from -360 to 0 degrees, one picture a channel.

    The critical point is at -180 degrees and 0 dB; grey are contours of |L/(1 + L)|. Dots are unit gain,
    squares -180 degrees.
    """
    return draw_loops(ratio, margins, _draw)


def _draw(axes: Axes, L: np.ndarray, margins: LoopMargins, *, stable: bool) -> None:
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
