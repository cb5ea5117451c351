"""Figure 4: eigenfrequencies of the suspension modes, eigenratios of the flexible ones."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, new_figure, styled
from middeck.structure.gravity.comparison import ModeComparison


@styled
def figure_4(comparison: ModeComparison) -> Figure:
    """Left: what rigid-body modes become on the suspension. Right: 1-g over 0-g frequency of each pair."""
    figure = new_figure(4.1)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
    draw_suspension_modes(left, comparison)
    draw_ratios(right, comparison)
    return figure


def draw_suspension_modes(axes: Axes, comparison: ModeComparison) -> None:
    """Frequency of every suspension mode, by name; all are zero in 0-g."""
    lab = comparison.lab
    hung = [i for i in range(comparison.count) if lab.kind[i] == "suspension"]
    _stems(axes, lab.frequency_hz[hung], 0.0, [lab.name[i] for i in hung], "{:.3f}")
    axes.set_xlim(0.0, 1.22 * float(lab.frequency_hz[hung].max(initial=1e-3)))
    axes.set_xlabel("frequency in 1-g [Hz] (0-g: 0 Hz)")
    axes.set_title("suspension modes")


def draw_ratios(axes: Axes, comparison: ModeComparison) -> None:
    """Ratio of every pair of flexible modes, by the name and frequency of its 0-g mode."""
    orbit = comparison.orbit
    names = [f"{orbit.name[i]}, {orbit.frequency_hz[i]:.2f} Hz" for i in comparison.pairs[:, 0]]
    _stems(axes, comparison.ratio, 1.0, names, "{:.4f}")
    span = float(np.abs(comparison.ratio - 1.0).max(initial=1e-4))
    low = min(float(comparison.ratio.min(initial=1.0)) - 0.1 * span, 1.0 - 0.1 * span)
    axes.set_xlim(low, 1.0 + 1.4 * span)
    axes.axvline(1.0, color=COLOUR["orbit"], linewidth=1.0)
    axes.set_xlabel("1-g frequency / 0-g frequency")
    axes.set_title("flexible modes")


def _stems(axes: Axes, values: np.ndarray, base: float, names: list[str], form: str) -> None:
    """Horizontal stems from ``base``, the first on top, each with its value beside it."""
    rows = np.arange(len(values))
    axes.hlines(rows, base, values, color=COLOUR["lab"], linewidth=1.6)
    axes.plot(values, rows, "o", color=COLOUR["lab"])
    for row, value in zip(rows, values, strict=True):
        axes.annotate(
            form.format(value),
            (max(value, base), row),
            (6, 0),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
        )
    axes.set_yticks(rows, names)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(values) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
