"""Figures 4 and 5: suspension modes, ratios of the flexible ones, and cross-orthogonality of both."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, draw_stems, new_figure, styled
from middeck.structure.gravity.compare_modes import ModeComparison


@styled
def figure_4(comparison: ModeComparison) -> Figure:
    """Left: suspension modes, rigid-body modes in 0-g. Right: 1-g over 0-g frequency of each pair."""
    figure = new_figure(4.1)
    if "suspension" not in comparison.lab.kind[: comparison.count]:
        draw_ratios(figure.subplots(), comparison)
        return figure
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
    draw_suspension_modes(left, comparison)
    draw_ratios(right, comparison)
    return figure


def draw_suspension_modes(axes: Axes, comparison: ModeComparison) -> None:
    """Frequency of every suspension mode, by name; all are zero in 0-g."""
    lab = comparison.lab
    hung = [i for i in range(comparison.count) if lab.kind[i] == "suspension"]
    draw_stems(axes, lab.frequency_hz[hung], 0.0, [lab.name[i] for i in hung], "{:.3f}")
    axes.set_xlim(0.0, 1.22 * float(lab.frequency_hz[hung].max(initial=1e-3)))
    axes.set_xlabel("frequency in 1-g [Hz] (0-g: 0 Hz)", loc="left")
    axes.set_title("suspension modes")


def draw_ratios(axes: Axes, comparison: ModeComparison) -> None:
    """Ratio of every pair of flexible modes, by the name and frequency of its 0-g mode."""
    orbit = comparison.orbit
    names = [f"{orbit.name[i]}, {orbit.frequency_hz[i]:.2f} Hz" for i in comparison.pairs[:, 0]]
    draw_stems(axes, comparison.ratio, 1.0, names, "{:.4f}")
    span = float(np.abs(comparison.ratio - 1.0).max(initial=1e-4))
    low = min(float(comparison.ratio.min(initial=1.0)) - 0.1 * span, 1.0 - 0.1 * span)
    axes.set_xlim(low, 1.0 + 1.4 * span)
    axes.axvline(1.0, color=COLOUR["orbit"], linewidth=1.0)
    axes.set_xlabel("1-g frequency / 0-g frequency", loc="right")
    axes.set_title("flexible modes")


FLOOR = 1e-3  # below this a coupling is drawn white


@styled
def figure_5(comparison: ModeComparison) -> Figure:
    """Left: the matrix in logarithmic colour. Right: for each flexible 1-g mode its pair and the next."""
    figure = new_figure(4.2)
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1.0])
    _draw_matrix(figure, left, comparison)
    _draw_couplings(right, comparison)
    return figure


def _draw_matrix(figure: Figure, axes: Axes, comparison: ModeComparison) -> None:
    matrix = np.ma.masked_less(comparison.cross_orthogonality, FLOOR)
    edges = np.arange(comparison.count + 1) - 0.5
    scale = LogNorm(FLOOR, 1.0)
    image = axes.pcolormesh(
        edges, edges, matrix, cmap="viridis_r", norm=scale, edgecolors="face", linewidth=0.1
    )
    axes.set_aspect("equal")
    axes.invert_yaxis()
    for count, line in (
        (_rigid(comparison.orbit.kind[: comparison.count]), axes.axhline),
        (_rigid(comparison.lab.kind[: comparison.count]), axes.axvline),
    ):
        line(count - 0.5, color="black", linewidth=0.7, linestyle="--")
    axes.plot(
        comparison.pairs[:, 1], comparison.pairs[:, 0], "o", mfc="none", mec=COLOUR["lab"], markersize=6
    )
    axes.set_xlabel("1-g mode (suspension | flexible)")
    axes.set_ylabel("0-g mode (flexible | rigid)")
    axes.set_title("|cross-orthogonality|; circles: pairs")
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, fraction=0.05, pad=0.02)
    bar.ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _rigid(kinds: tuple[str, ...]) -> int:
    return sum(kind != "flexible" for kind in kinds)


def _draw_couplings(axes: Axes, comparison: ModeComparison) -> None:
    matrix, pairs = comparison.cross_orthogonality, comparison.pairs
    rows = np.arange(len(pairs))
    flexible = [i for i, kind in enumerate(comparison.orbit.kind[: comparison.count]) if kind == "flexible"]
    rigid = [i for i, kind in enumerate(comparison.orbit.kind[: comparison.count]) if kind != "flexible"]
    other = np.array([max((matrix[k, j] for k in flexible if k != i), default=0.0) for i, j in pairs])
    axes.plot(matrix[pairs[:, 0], pairs[:, 1]], rows, "o", color=COLOUR["lab"], label="its pair")
    axes.plot(other, rows, "s", mfc="none", color=COLOUR["orbit"], label="largest other flexible")
    axes.plot(matrix[rigid][:, pairs[:, 1]].max(axis=0, initial=0.0), rows, "x", color=COLOUR["ink"],
              label="largest rigid-body")  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlim(FLOOR / 3.0, 1.5)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_yticks(rows, [str(j) for j in pairs[:, 1]])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_ylabel("flexible 1-g mode")
    axes.set_xlabel("|cross-orthogonality| with 0-g modes")
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=3)
