"""The steering mirror: all entries of the measured response, of the fit, and of the residual."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.curves import decibels, draw_magnitude
from middeck.plot.style import COLOUR, FITTED, frequency_axis, new_figure, styled
from middeck.study.chapters.mirror.computation import PUBLISHED_NRMSE, MirrorFit

BINS = 110  # nine small panels
FLOOR_DB = 25.0  # drawn below the data's least decile


@styled
def mirror(fit: MirrorFit) -> Figure:
    """Magnitudes, rows outputs, columns inputs; each row with its held-out error beside the published one."""
    measured = fit.measured
    figure = new_figure(6.2)
    grid = figure.subplots(
        len(measured.outputs), len(measured.inputs), sharex=True, sharey=True, squeeze=False
    )
    for row, output in enumerate(measured.outputs):
        for column, port in enumerate(measured.inputs):
            axes = grid[row, column]
            _draw_entry(axes, fit, row, column)
            frequency_axis(axes, *measured.frequency_hz[[0, -1]], label=row == len(measured.outputs) - 1)
            if row == 0:
                axes.set_title(f"from {port.name}")
        grid[row, 0].set_ylabel(f"{output.name} [dB re {output.unit}/{measured.inputs[0].unit}]")
        text = f"held-out NRMSE {float(fit.held_out_nrmse[row]):.2%}\npublished {PUBLISHED_NRMSE[row]:.2%}"
        grid[row, -1].annotate(
            text, (1.03, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=8.0
        )
    level = decibels(measured.H.ravel())
    grid[0, 0].set_ylim(float(np.quantile(level, 0.1)) - FLOOR_DB, float(level.max()) + 5.0)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure


def _draw_entry(axes: Axes, fit: MirrorFit, row: int, column: int) -> None:
    f = fit.measured.frequency_hz
    data, model = fit.measured.H[:, row, column], fit.fitted.H[:, row, column]
    draw_magnitude(axes, f, data, BINS, color=COLOUR["rig"], linewidth=1.8, label="data")
    draw_magnitude(
        axes, f, model, BINS, color=COLOUR["prediction"], linewidth=0.9, linestyle=FITTED, label="fit"
    )
    left = {"color": COLOUR["ghost"], "label": "data less fit"}
    draw_magnitude(axes, f, data - model, BINS, linewidth=0.5, zorder=1.5, **left)
