"""A fit beside its data, with the bounds of its response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.identification.fit.fit_response import FitResult
from middeck.identification.uncertainty.response_bounds import ResponseBounds, response_bounds
from middeck.plot.curves import decibels, draw_magnitude
from middeck.plot.style import COLOUR, frequency_axis, new_figure, styled
from middeck.systems.plants.response import FrequencyResponse

# Beyond this many paths the panels are too small to read; the first outputs and inputs are drawn.
MOST_ROWS, MOST_COLUMNS = 4, 4
ROW_IN, HEAD_IN = 1.7, 0.9
BOUND_LINES = 400
FLOOR_DB = 25.0  # drawn below the data's least decile


@styled
def fit_figure(measured: FrequencyResponse, fit: FitResult) -> Figure:
    """Magnitude of each path: data, fit, and the band of 95 % on each line; rows outputs, columns inputs."""
    outputs, inputs = fit.model.outputs[:MOST_ROWS], fit.model.inputs[:MOST_COLUMNS]
    low, high = measured.frequency_hz[[0, -1]]
    bounds = response_bounds(fit.covariance, np.geomspace(low, high, BOUND_LINES))
    figure = new_figure(HEAD_IN + ROW_IN * max(len(outputs), 2))
    grid = figure.subplots(len(outputs), len(inputs), sharex=True, sharey="row", squeeze=False)
    alike = len({port.unit for port in inputs}) == 1
    for row, output in enumerate(outputs):
        level = decibels(measured.H[:, row].ravel())
        for column, port in enumerate(inputs):
            axes = grid[row, column]
            _draw_path(axes, measured, bounds, row, column)
            frequency_axis(axes, low, high, label=row == len(outputs) - 1)
            if row == 0:
                axes.set_title(f"from {port.name}" if alike else f"from {port.name} [{port.unit}]")
        ratio = f"{output.unit}/{inputs[0].unit}" if alike else f"{output.unit} per unit of the input"
        grid[row, 0].set_ylabel(f"{output.name}\n[dB re {ratio}]")
        grid[row, 0].set_ylim(float(np.quantile(level, 0.1)) - FLOOR_DB, float(level.max()) + 5.0)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure


def _draw_path(
    axes: Axes, measured: FrequencyResponse, bounds: ResponseBounds, row: int, column: int
) -> None:
    draw_magnitude(axes, measured.frequency_hz, measured.H[:, row, column], color=COLOUR["rig"],
                   linewidth=1.8, label="data")  # fmt: skip
    f = bounds.frequency_hz
    least = np.finfo(float).tiny
    low, high = (
        20.0 * np.log10(np.maximum(x[:, row, column], least))
        for x in (bounds.magnitude_low, bounds.magnitude_high)
    )
    axes.fill_between(f, low, high, color=COLOUR["prediction"], alpha=0.3,
                      linewidth=0.0, label="95 %, each line alone")  # fmt: skip
    axes.plot(f, decibels(bounds.H[:, row, column]), color=COLOUR["prediction"], linewidth=0.9, label="fit")
