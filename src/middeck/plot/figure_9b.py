"""Figure 9b: gimbal disturbance to payload angle, open and closed, predicted and measured."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from middeck.plot.curves import draw_magnitude
from middeck.plot.ports import path_words
from middeck.plot.style import COLOUR, frequency_axis, new_figure, styled
from middeck.study.measured_control import MeasuredControl

DASHES = {"low": (0, (2, 1.5)), "high": (0, (5, 1.5))}


@styled
def figure_9b(control: MeasuredControl) -> Figure:
    """Magnitudes: measured loops in full lines, predictions dashed over them."""
    figure = new_figure(4.4)
    axes = figure.subplots()
    f, open_loop = control.open_loop.frequency_hz, control.open_loop.H[:, 0, 0]
    draw_magnitude(axes, f, open_loop, color=COLOUR["rig"], linewidth=1.6, label="open loop, measured")
    for loop in control.loops:
        who = f"{loop.name} authority"
        full: dict[str, Any] = {"color": COLOUR[loop.name], "linewidth": 1.6}
        if loop.measured is None:
            axes.plot([], [], **full, label=f"{who}: unstable on the rig")
        else:
            label = f"{who}, measured{_decibels(loop.measured_db)}"
            draw_magnitude(axes, loop.measured.frequency_hz, loop.measured.H[:, 0, 0], **full, label=label)
        dashed: dict[str, Any] = {"color": COLOUR["prediction"], "linestyle": DASHES[loop.name]}
        label = f"{who}, predicted{_decibels(loop.predicted_db)}"
        draw_magnitude(
            axes, loop.predicted.frequency_hz, loop.predicted.H[:, 0, 0], linewidth=1.0, label=label, **dashed
        )
    axes.set_ylabel("magnitude [dB re 1 rad per N m]")
    axes.set_title(f"{path_words(control.open_loop)}; dB: rms angle in the band over the open loop's")
    axes.legend(loc="lower left")
    frequency_axis(axes, *control.open_loop.frequency_hz[[0, -1]])
    return figure


def _decibels(value: float | None) -> str:
    return "" if value is None else f": {value:.2f} dB"
