"""A sweep of authority: decibels of every stable loop, and where a loop is unstable."""

import numpy as np
from matplotlib.figure import Figure

from middeck.control.loop.authority import AuthoritySweep
from middeck.plot.style import COLOUR, new_figure, styled

ORDER = ("orbit", "lab", "prediction", "robust", "low", "high", "rig")
MARKERS = "os^DvPX"


@styled
def draw_authority(sweep: AuthoritySweep) -> Figure:
    """Improvement of each plant by authority; a cross below the curves where its loop is unstable."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    level = np.log10(sweep.authority)
    for k, name in enumerate(sweep.plants):
        colour, marker = COLOUR[ORDER[k % len(ORDER)]], MARKERS[k % len(MARKERS)]
        shown = np.where(sweep.stable[k], sweep.db[k], np.nan)
        axes.plot(level, shown, marker=marker, markersize=3.5, color=colour, label=name)
        bad = level[~sweep.stable[k]]
        height = np.full(len(bad), 0.03 + 0.04 * k)
        axes.plot(
            bad, height, "x", color=colour, transform=axes.get_xaxis_transform(), clip_on=False,
            label=f"{name}, unstable" if len(bad) else None,
        )  # fmt: skip
    axes.margins(y=0.1)
    axes.set_xlabel("log10 of control authority")
    axes.set_ylabel("performance [dB]")
    axes.set_title("performance by authority")
    axes.legend(loc="best")
    return figure
