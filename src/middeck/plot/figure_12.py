"""Figures 12a and 12b: payload and bus under a penalty on both, beside the open loop and Figure 11's."""

from __future__ import annotations

from matplotlib.figure import Figure

from middeck.plot.loops import begin_loops, draw_measured, draw_predicted, end_loops
from middeck.plot.ports import port_words
from middeck.plot.style import COLOUR, styled
from middeck.study.two_sensor_control import FLEXIBLE_HZ, TwoSensorControl


@styled
def figure_12a(control: TwoSensorControl) -> Figure:
    """The payload."""
    return _draw(control, 0)


@styled
def figure_12b(control: TwoSensorControl) -> Figure:
    """The bus; shaded where its penalty is meant to act."""
    return _draw(control, 2)


def _draw(control: TwoSensorControl, output: int) -> Figure:
    measured = control.sensors.measured
    torque, angle = measured.inputs[0].name, measured.outputs[output].name
    title = f"{port_words(torque)} torque to {port_words(angle)} angle"
    payload = output == 0
    if payload:
        title += "; dB: rms angle in the band over the open loop's"
    figure, axes = begin_loops(measured, title, output=output)
    axes.axvspan(*FLEXIBLE_HZ, color=COLOUR["shade"], linewidth=0.0, zorder=0)
    draw_measured(axes, control.payload, "payload penalty alone, with lead", output=output, decibels=payload)
    draw_measured(axes, control.both, "payload and bus penalty", output=output, decibels=payload)
    draw_predicted(axes, control.both, "payload and bus penalty", output=output, decibels=payload)
    return end_loops(figure, axes)
