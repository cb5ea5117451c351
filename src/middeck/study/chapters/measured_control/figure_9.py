"""Figures 9a and 9b: gimbal torque to payload angle, measured and fitted; open and closed loops."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.curves import bode_figure, decibels, draw_bode
from middeck.plot.port_words import path_words
from middeck.plot.style import COLOUR, FITTED, note, styled
from middeck.study.chapters.measured_control.computation import MeasuredControl
from middeck.study.measured_loop.drawing import (
    LoopStyle,
    begin_loops,
    draw_measured,
    draw_predicted,
    end_loops,
)

LOOKS = {
    "low": LoopStyle("CL1, low authority", COLOUR["low"], (0, (1, 2))),
    "high": LoopStyle("CL2, high authority", COLOUR["high"], (0, (6, 3))),
    "robust": LoopStyle("CL3, for two records", COLOUR["robust"], (0, (6, 2, 1, 2))),
}


@styled
def figure_9a(control: MeasuredControl) -> Figure:
    """Magnitude and phase; the band of the fit is shaded, modes below it are named."""
    f, data, fit = control.open_loop.frequency_hz, control.open_loop.H[:, 0, 0], control.fitted.H[:, 0, 0]
    figure, magnitude, phase = bode_figure(4.6, f)
    for axes in (magnitude, phase):
        axes.axvspan(*control.fit_band_hz, color=COLOUR["shade"], linewidth=0.0, zorder=0)
    draw_bode(magnitude, phase, f, data, color=COLOUR["rig"], linewidth=1.8, label="data (simulated rig)")
    draw_bode(
        magnitude, phase, f, fit, color=COLOUR["prediction"], linewidth=1.1, linestyle=FITTED, label="fit"
    )
    _name_what_is_outside(magnitude, control)
    magnitude.set_ylabel("magnitude [dB re 1 rad per N m]")
    magnitude.set_title(path_words(control.open_loop))
    magnitude.legend(loc="lower left")
    return figure


def _name_what_is_outside(axes: Axes, control: MeasuredControl) -> None:
    """The band of the fit, and the mode below it that the fit leaves out."""
    f = control.open_loop.frequency_hz
    low, high = control.fit_band_hz
    top = axes.get_ylim()[1]
    axes.set_ylim(top=top + 8.0)
    axes.annotate(f"fitted: {low:g} to {high:g} Hz", (np.sqrt(low * high), top + 7.0), ha="center", va="top",
                  fontsize=8.0)  # fmt: skip
    mode = control.below_fit
    if mode is None:
        return
    at = int(np.argmin(np.abs(f - mode.frequency_hz)))
    near = slice(max(at - 2, 0), at + 3)  # the peak, wherever on the lines it falls
    text = f"{mode.kind} mode at {mode.frequency_hz:.2f} Hz:\noutside the fit"
    peak = mode.frequency_hz, float(decibels(control.open_loop.H[near, 0, 0]).max())
    arrow = {"arrowstyle": "-", "linewidth": 0.7, "color": COLOUR["ink"]}
    note(axes, text, peak, (0, -48), ha="center", va="top", fontsize=8.0, arrowprops=arrow)


@styled
def figure_9b(control: MeasuredControl) -> Figure:
    """The open loop and the three closed ones."""
    title = f"{path_words(control.open_loop)}; dB: rms angle in the band over the open loop's"
    figure, axes = begin_loops(control.open_loop, title)
    for loop in control.loops:
        draw_measured(axes, loop, LOOKS[loop.name])
    for loop in control.loops:
        draw_predicted(axes, loop, LOOKS[loop.name])
    return end_loops(figure, axes)
