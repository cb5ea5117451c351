"""The budget of gravity's effects: stacked bars, and under them their range over the orders of switching."""

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, new_figure, styled
from middeck.structure.gravity.budget import EFFECTS, GravityBudget

SHADE = {"suspension": COLOUR["orbit"], "stiffness": COLOUR["lab"], "deformation": COLOUR["prediction"]}
LINES = "suspension", "inner forces and weight", "deformation"
ROW_IN = 0.28
THICK = 0.44
# Offsets in a row, from its middle up to its bar and down to the whisker of each effect.
BAR, WHISKERS = -0.16, (0.17, 0.28, 0.39)
NOTE = "thin lines, in the colour of each effect: range of its share over the six orders of switching"
DOUBT = "* in some state between orbit and {place} less than half of the shape in orbit"


@styled
def budget_figure(budget: GravityBudget) -> Figure:
    """Held and flexible modes side by side in the order of the laboratory's frequencies."""
    rigid = np.array([budget.orbit.kind[i] == "rigid" for i in budget.pairs[:, 0]])
    parts = [(title, np.flatnonzero(rows)) for title, rows in
             (("rigid-body modes in orbit", rigid), ("flexible modes", ~rigid))]  # fmt: skip
    parts = [(title, rows) for title, rows in parts if len(rows)]
    figure = new_figure(1.7 + ROW_IN * max(len(rows) for _, rows in parts), 9.4)
    for axes, (title, rows) in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
        draw_shares(axes, budget, rows)
        axes.set_title(title)
    rest = budget.lab.equilibrium
    title = fill(rest.model.structure.title, 110)
    start = budget.orbit.equilibrium.environment.title
    figure.suptitle(f"{title}\nfrom {start} to {rest.environment.title}", fontsize=9.5)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    notes = [NOTE, *([DOUBT.format(place=rest.environment.title)] if budget.doubtful else [])]
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=len(labels),
        title="\n".join(notes),
        title_fontsize=8,
    )
    return figure


def draw_shares(axes: Axes, budget: GravityBudget, rows: np.ndarray) -> None:
    """Mean shares stacked away from zero; each whisker from where its bar begins to the ends of its range."""
    share, reach, shift = budget.share_hz[rows], budget.range_hz[rows], budget.shift_hz[rows]
    y = np.arange(len(rows), dtype=float)
    ends = {1.0: np.zeros(len(rows)), -1.0: np.zeros(len(rows))}
    for e, effect in enumerate(EFFECTS):
        sign = np.where(share[:, e] < 0.0, -1.0, 1.0)
        left = np.where(sign < 0.0, ends[-1.0], ends[1.0])
        axes.barh(y + BAR, share[:, e], THICK, left=left, color=SHADE[effect], label=LINES[e], zorder=2)
        _whiskers(axes, y + WHISKERS[e], left + reach[:, e, 0], left + reach[:, e, 1], SHADE[effect])
        for s in ends:
            ends[s] = np.where(sign == s, ends[s] + share[:, e], ends[s])
    axes.plot(shift, y + BAR, "D", color="black", markersize=3.0, label="shift", zorder=4)
    names = [budget.lab.name[j] for j in budget.pairs[rows, 1]]
    doubt = set(budget.doubtful)
    marked = [f"{n} *" if int(r) in doubt else n for n, r in zip(names, rows, strict=True)]
    axes.set_yticks(y, marked)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.axvline(0.0, color="black", linewidth=0.7, zorder=3)
    axes.set_xlabel("share of the shift in frequency [Hz]")


def _whiskers(axes: Axes, y: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str) -> None:
    axes.hlines(y, low, high, color=colour, linewidth=1.0, zorder=3)
    axes.plot([low, high], [y, y], "|", color=colour, markersize=3.0, zorder=3)
