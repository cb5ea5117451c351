"""Figure 9b: gimbal disturbance to payload angle, open and closed, predicted and measured."""

from __future__ import annotations

from matplotlib.figure import Figure

from middeck.plot.loops import begin_loops, draw_measured, draw_predicted, end_loops
from middeck.plot.ports import path_words
from middeck.plot.style import styled
from middeck.study.measured_control import MeasuredControl

WHO = {"low": "CL1, low authority", "high": "CL2, high authority", "robust": "CL3, for two records"}


@styled
def figure_9b(control: MeasuredControl) -> Figure:
    """The open loop and the three closed ones."""
    title = f"{path_words(control.open_loop)}; dB: rms angle in the band over the open loop's"
    figure, axes = begin_loops(control.open_loop, title)
    for loop in control.loops:
        draw_measured(axes, loop, WHO[loop.name])
    for loop in control.loops:
        draw_predicted(axes, loop, WHO[loop.name])
    return end_loops(figure, axes)
