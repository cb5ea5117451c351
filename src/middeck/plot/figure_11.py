"""Figure 11: the payload held by encoder and bus alone, with the lead about the pair near 9 Hz."""

from __future__ import annotations

from matplotlib.figure import Figure

from middeck.plot.loops import begin_loops, draw_measured, draw_predicted, end_loops
from middeck.plot.ports import path_words
from middeck.plot.style import styled
from middeck.study.two_sensor_control import TwoSensorControl


@styled
def figure_11(control: TwoSensorControl) -> Figure:
    """The open loop, and the closed one measured and predicted."""
    measured = control.sensors.measured
    title = f"{path_words(measured)}; dB: rms angle in the band over the open loop's"
    figure, axes = begin_loops(measured, title)
    draw_measured(axes, control.payload, "payload penalty, with lead")
    draw_predicted(axes, control.payload, "payload penalty, with lead")
    return end_loops(figure, axes)
