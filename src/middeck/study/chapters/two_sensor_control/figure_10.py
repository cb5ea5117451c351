"""Figures 10a and 10b: gimbal torque to encoder and bus angle, measured and fitted, with the zeros."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.curves import decibels, draw_bode
from middeck.plot.ports import port_words
from middeck.plot.style import COLOUR, FITTED, frequency_axis, new_figure, phase_axis, styled
from middeck.study.chapters.two_sensor_control.computation import TwoSensorControl
from middeck.study.chapters.two_sensor_control.measured_sensors import MeasuredSensors

BELOW_DB = 9.0  # room under the curves for the zeros' marks


@styled
def figure_10a(control: TwoSensorControl) -> Figure:
    """The encoder."""
    return _draw(control.sensors, 1)


@styled
def figure_10b(control: TwoSensorControl) -> Figure:
    """The bus."""
    return _draw(control.sensors, 2)


def _draw(sensors: MeasuredSensors, output: int) -> Figure:
    figure = new_figure(4.9)
    magnitude, phase = figure.subplots(2, 1, sharex=True, height_ratios=[1.35, 1.0])
    f, data = sensors.measured.frequency_hz, sensors.measured.H[:, output, 0]
    fitted = (f >= sensors.fit_band_hz[0]) & (f <= sensors.fit_band_hz[1])
    fit = sensors.fitted.H[fitted, output, 0]
    draw_bode(magnitude, phase, f, data, color=COLOUR["rig"], linewidth=1.8, label="data (simulated rig)")
    draw_bode(
        magnitude,
        phase,
        f[fitted],
        fit,
        color=COLOUR["prediction"],
        linewidth=1.1,
        linestyle=FITTED,
        label="fit",
    )
    low, high = f[[0, -1]]
    _mark_zeros(magnitude, sensors, output, float(decibels(data).min()))
    magnitude.set_ylabel("magnitude [dB re 1 rad per N m]")
    torque, angle = sensors.measured.inputs[0].name, sensors.measured.outputs[output].name
    magnitude.set_title(f"{port_words(torque)} torque to {port_words(angle)} angle")
    figure.legend(*magnitude.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    frequency_axis(magnitude, low, high, label=False)
    frequency_axis(phase, low, high)
    phase.tick_params(labelbottom=True)
    phase_axis(phase)
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
        kind = "pair" if zeros.is_pair[k] else "real"
        axes.annotate(
            f"{zeros.frequency_hz[k]:.2f} Hz, {kind}",
            (float(zeros.frequency_hz[k]), level),
            (0, -5),
            textcoords="offset points",
            ha="right" if zeros.frequency_hz[k] > 0.5 * band_hz[1] else "center",
            va="top",
            fontsize=8.0,
            color=COLOUR["lab"],
        )
    axes.set_ylim(bottom=level - 1.3 * BELOW_DB)
