"""Figures 11, 12a and 12b: the loop under the payload's penalty, then under payload's and bus's."""

from __future__ import annotations

from matplotlib.figure import Figure

from middeck.plot.ports import path_words, port_words
from middeck.plot.style import COLOUR, styled
from middeck.study.chapters.two_sensor_control.computation import FLEXIBLE_HZ, TwoSensorControl
from middeck.study.measured_loop.drawing import Look, begin_loops, draw_measured, draw_predicted, end_loops

PAYLOAD = Look("payload penalty, with lead", COLOUR["high"], (0, (6, 3)))
ALONE = PAYLOAD._replace(who="payload penalty alone, with lead")
BOTH = Look("payload and bus penalty", COLOUR["robust"], (0, (1, 2)))


@styled
def figure_11(control: TwoSensorControl) -> Figure:
    """The open loop, and the closed one measured and predicted."""
    measured = control.sensors.measured
    title = f"{path_words(measured)}; dB: rms angle in the band over the open loop's"
    figure, axes = begin_loops(measured, title)
    draw_measured(axes, control.payload, PAYLOAD)
    draw_predicted(axes, control.payload, PAYLOAD)
    return end_loops(figure, axes)


@styled
def figure_12(control: TwoSensorControl, output: int) -> Figure:
    """The payload or the bus; shaded where the bus's penalty is meant to act."""
    measured = control.sensors.measured
    torque, angle = measured.inputs[0].name, measured.outputs[output].name
    title = f"{port_words(torque)} torque to {port_words(angle)} angle"
    payload = output == 0
    if payload:
        title += "; dB: rms angle in the band over the open loop's"
    figure, axes = begin_loops(measured, title, output=output)
    axes.axvspan(*FLEXIBLE_HZ, color=COLOUR["shade"], linewidth=0.0, zorder=0)
    draw_measured(axes, control.payload, ALONE, output=output, decibels=payload)
    draw_measured(axes, control.both, BOTH, output=output, decibels=payload)
    draw_predicted(axes, control.both, BOTH, output=output, decibels=payload)
    return end_loops(figure, axes)
