"""The one picture of the result, for the front page of the project."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from middeck.plot.style import new_figure, styled
from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.study.chapters.gravity_modes.chapter import GRAVITY_MODES
from middeck.study.chapters.gravity_modes.figures_4_5 import draw_ratios, draw_suspension_modes
from middeck.study.chapters.zero_g_control.chapter import ZERO_G_CONTROL
from middeck.study.chapters.zero_g_control.computation import ZeroGControl
from middeck.study.chapters.zero_g_control.figure_7 import draw_performance

KEY = "mace-1993"  # figures/mace-1993.svg
WORDS = "Performance of 0-g controllers in 0-g and 1-g, suspension modes, ratios of flexible modes."


def draw_picture(outcomes: Mapping[str, Any]) -> Figure | None:
    """The picture from the outcomes by chapter; None where one of its two has not run."""
    comparison, control = (outcomes.get(chapter.name) for chapter in (GRAVITY_MODES, ZERO_G_CONTROL))
    return None if comparison is None or control is None else picture(comparison, control)


@styled
def picture(comparison: ModeComparison, control: ZeroGControl) -> Figure:
    """Effects of gravity and suspension on the modes (Figure 4), and on controllers designed without (7a)."""
    figure = new_figure(7.4, 8.6)
    grid = figure.add_gridspec(2, 2, height_ratios=[1.15, 1.0], width_ratios=[1.0, 1.15])
    performance = figure.add_subplot(grid[0, :])
    draw_performance(performance, control)
    performance.set_xlabel("log10 of control authority")
    performance.set_title(headline(control))
    draw_suspension_modes(figure.add_subplot(grid[1, 0]), comparison)
    draw_ratios(figure.add_subplot(grid[1, 1]), comparison)
    return figure


def headline(control: ZeroGControl) -> str:
    """The message of the curves: whether 0-g always improves, and whether 1-g becomes unstable."""
    sweep = dict(control.sweeps)["all"].sweep
    orbit, lab = (sweep.plants.index(name) for name in ("orbit", "lab"))
    if not sweep.stable[orbit].all():
        in_orbit = "not stable throughout in 0-g"
    elif np.all(np.diff(sweep.db[orbit]) < 0.0):
        in_orbit = "better and better in 0-g"
    else:
        in_orbit = "stable in 0-g"
    in_lab = "stable in 1-g" if sweep.stable[lab].all() else "unstable in 1-g"
    return f"controllers designed in 0-g: {in_orbit}, {in_lab}"
