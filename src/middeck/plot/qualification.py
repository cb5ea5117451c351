"""A compensator on many plants: the margins of each row side by side, unstable rows crossed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, new_figure, note, styled

COLUMNS = {
    "gain_db": "least gain margin [dB]",
    "phase_deg": "least phase margin [deg]",
    "disk": "least disk margin",
    "damping": "damping of the slowest pole",
    "db": "rms against open loop [dB]",
}
ROW_IN = 0.24


@styled
def qualification_figure(
    rows: Sequence[Mapping[str, Any]], limits: Sequence[tuple[str, float]], title: str
) -> Figure:
    """One line a row of `middeck qualify`, one panel a quantity; ``limits`` as dashed lines.

    A row that is not stable has a cross; one without a limit, or without the number, says so.
    """
    figure = new_figure(1.3 + ROW_IN * len(rows), 11.0)
    panels = figure.subplots(1, len(COLUMNS), sharey=True, squeeze=False)[0]
    y = np.arange(len(rows))
    for axes, (key, label) in zip(panels, COLUMNS.items(), strict=True):
        values = [row[key] if row["stable"] else None for row in rows]
        known = [(v, i) for i, v in enumerate(values) if v is not None and np.isfinite(v)]
        axes.plot([v for v, _ in known], [i for _, i in known], "o", color=COLOUR["orbit"])
        axes.hlines([i for _, i in known], 0.0, [v for v, _ in known], color=COLOUR["orbit"], linewidth=1.2)
        for i, (row, value) in enumerate(zip(rows, values, strict=True)):
            if not row["stable"]:
                axes.plot(0.02, i, "x", color=COLOUR["lab"], transform=axes.get_yaxis_transform(), zorder=4)
                note(axes, "not stable", (0.02, i), (7, 0), va="center", color=COLOUR["lab"],
                     xycoords=axes.get_yaxis_transform())  # fmt: skip
            elif value is None or not np.isfinite(value):
                words = "no number" if value is None or value < 0.0 or key == "db" else "no limit"
                note(axes, words, (0.02, i), (0, 0), va="center", xycoords=axes.get_yaxis_transform())
        for quantity, limit in limits:
            if quantity == key:
                axes.axvline(limit, color=COLOUR["lab"], linewidth=1.0, linestyle="--")
        axes.axvline(0.0, color="black", linewidth=0.7)
        axes.margins(x=0.15)
        axes.set_title(label, fontsize=8.0)
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(y, [f"{row['plant']}, {row['setting']}" for row in rows])
    panels[0].set_ylim(len(rows) - 0.5, -0.5)
    figure.suptitle(title, fontsize=9.5)
    return figure
