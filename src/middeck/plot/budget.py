"""The budget of gravity's effects: stacked bars, with their range over the orders of switching."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, new_figure, styled
from middeck.structure.gravity.budget import EFFECTS, GravityBudget

SHADE = {"suspension": COLOUR["orbit"], "stiffness": COLOUR["lab"], "deformation": COLOUR["prediction"]}
LINES = "suspension", "inner forces and weight", "deformation"
ROW_IN = 0.24
THICK = 0.62


@styled
def budget_figure(budget: GravityBudget) -> Figure:
    """Held and flexible modes side by side in the order of the laboratory's frequencies."""
    rigid = np.array([budget.orbit.kind[i] == "rigid" for i in budget.pairs[:, 0]])
    parts = [(title, np.flatnonzero(rows)) for title, rows in
             (("rigid-body modes in orbit", rigid), ("flexible modes", ~rigid))]  # fmt: skip
    parts = [(title, rows) for title, rows in parts if len(rows)]
    figure = new_figure(1.3 + ROW_IN * max(len(rows) for _, rows in parts), 9.4)
    for axes, (title, rows) in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
        draw_shares(axes, budget, rows)
        axes.set_title(title)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    title = "* in some corner of the cube less than half of the shape in orbit" if budget.doubtful else None
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(labels), title=title, title_fontsize=8
    )
    return figure


def draw_shares(axes: Axes, budget: GravityBudget, rows: np.ndarray) -> None:
    """Mean shares stacked away from zero; whiskers from the smallest to the largest over the orders."""
    share, reach, shift = budget.share_hz[rows], budget.range_hz[rows], budget.shift_hz[rows]
    y = np.arange(len(rows), dtype=float)
    ends = {1.0: np.zeros(len(rows)), -1.0: np.zeros(len(rows))}
    for e, effect in enumerate(EFFECTS):
        sign = np.where(share[:, e] < 0.0, -1.0, 1.0)
        left = np.where(sign < 0.0, ends[-1.0], ends[1.0])
        axes.barh(y, share[:, e], THICK, left=left, color=SHADE[effect], label=LINES[e], zorder=2)
        _whiskers(
            axes,
            y + 0.2 * (e - 1),
            left + reach[:, e, 0],
            left + reach[:, e, 1],
            "_" if e else "range over the orders",
        )
        for s in ends:
            ends[s] = np.where(sign == s, ends[s] + share[:, e], ends[s])
    axes.plot(shift, y, "D", color="black", markersize=3.5, label="shift, 0-g to 1-g", zorder=4)
    names = [budget.lab.name[j] for j in budget.pairs[rows, 1]]
    doubt = set(budget.doubtful)
    marked = [f"{n} *" if int(r) in doubt else n for n, r in zip(names, rows, strict=True)]
    axes.set_yticks(y, marked)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.axvline(0.0, color="black", linewidth=0.7, zorder=3)
    axes.set_xlabel("share of the shift in frequency [Hz]")


def _whiskers(axes: Axes, y: np.ndarray, low: np.ndarray, high: np.ndarray, label: str) -> None:
    axes.hlines(y, low, high, color="black", linewidth=0.8, label=label, zorder=3)
    axes.plot([low, high], [y, y], "|", color="black", markersize=4.0, zorder=3)
