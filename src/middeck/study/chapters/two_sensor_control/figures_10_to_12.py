"""Figures 10 to 12: paths measured and fitted with their zeros, then loops under one and two penalties."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.curves import bode_figure, decibels, draw_bode
from middeck.plot.port_words import path_words, port_words
from middeck.plot.style import COLOUR, FITTED, note, styled
from middeck.study.chapters.two_sensor_control.computation import FLEXIBLE_HZ, TwoSensorControl
from middeck.study.chapters.two_sensor_control.measured_sensors import MeasuredSensors
from middeck.study.measured_loop.drawing import (
    LoopStyle,
    begin_loops,
    draw_measured,
    draw_predicted,
    end_loops,
)

BELOW_DB = 9.0  # room under the curves for the zeros' marks


@styled
def figure_10(control: TwoSensorControl, output: int) -> Figure:
    """The path to one sensor."""
    sensors = control.sensors
    f, data = sensors.measured.frequency_hz, sensors.measured.H[:, output, 0]
    fitted = (f >= sensors.fit_band_hz[0]) & (f <= sensors.fit_band_hz[1])
    fit = sensors.fitted.H[fitted, output, 0]
    figure, magnitude, phase = bode_figure(4.9, f)
    draw_bode(magnitude, phase, f, data, color=COLOUR["rig"], linewidth=1.8, label="data (simulated rig)")
    look = {"color": COLOUR["prediction"], "linestyle": FITTED, "label": "fit"}
    draw_bode(magnitude, phase, f[fitted], fit, linewidth=1.1, **look)
    _mark_zeros(magnitude, sensors, output, float(decibels(data).min()))
    magnitude.set_ylabel("magnitude [dB re 1 rad per N m]")
    torque, angle = sensors.measured.inputs[0].name, sensors.measured.outputs[output].name
    magnitude.set_title(f"{port_words(torque)} torque to {port_words(angle)} angle")
    figure.legend(*magnitude.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    return figure


def _mark_zeros(axes: Axes, sensors: MeasuredSensors, output: int, floor_db: float) -> None:
    """A row of marks under the curves: rings as in a pole-zero plot, diamonds for the wrong half-plane."""
    zeros, band_hz = sensors.sensors[output].zeros, sensors.fit_band_hz
    inside = (zeros.frequency_hz >= band_hz[0]) & (zeros.frequency_hz <= band_hz[1])
    wrong = zeros.is_nonminimum_phase
    level = floor_db - BELOW_DB
    for chosen, marker, colour, label in (
        (inside & ~wrong, "o", COLOUR["ink"], "zeros of the fit"),
        (inside & wrong, "D", COLOUR["lab"], "zeros, non-minimum phase"),
    ):
        if chosen.any():
            f = zeros.frequency_hz[chosen]
            face, order = ("none", 3.0) if marker == "o" else (colour, 2.5)
            axes.plot(f, np.full(len(f), level), linestyle="none", marker=marker, label=label,
                      markerfacecolor=face, markeredgecolor=colour, zorder=order)  # fmt: skip
    for k in np.flatnonzero(inside & wrong):
        hz, kind = float(zeros.frequency_hz[k]), "pair" if zeros.is_pair[k] else "real"
        look = {"color": COLOUR["lab"], "ha": "right" if hz > 0.5 * band_hz[1] else "center", "va": "top"}
        note(axes, f"{hz:.2f} Hz, {kind}", (hz, level), (0, -5), fontsize=8.0, **look)
    axes.set_ylim(bottom=level - 1.3 * BELOW_DB)


PAYLOAD = LoopStyle("payload penalty, with lead", COLOUR["high"], (0, (6, 3)))
ALONE = PAYLOAD._replace(who="payload penalty alone, with lead")
BOTH = LoopStyle("payload and bus penalty", COLOUR["robust"], (0, (1, 2)))


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
    """The payload or the bus; shaded where the penalty on the bus acts."""
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
