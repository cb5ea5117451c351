"""Figure 9b: gimbal disturbance to payload angle, open and closed, predicted and measured."""

from __future__ import annotations

from matplotlib.figure import Figure

from middeck.plot.ports import path_words
from middeck.plot.style import COLOUR, styled
from middeck.study.chapters.measured_control.computation import MeasuredControl
from middeck.study.measured_loop.drawing import Look, begin_loops, draw_measured, draw_predicted, end_loops

LOOKS = {
    "low": Look("CL1, low authority", COLOUR["low"], (0, (1, 2))),
    "high": Look("CL2, high authority", COLOUR["high"], (0, (6, 3))),
    "robust": Look("CL3, for two records", COLOUR["robust"], (0, (6, 2, 1, 2))),
}


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
