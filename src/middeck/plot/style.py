"""The house style: one size of letters, one colour per environment, nothing from the user's own settings."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

P = ParamSpec("P")

# Okabe and Ito 2008: told apart with any colour vision; line styles and markers differ as well.
COLOUR = {
    "orbit": "#0072B2",
    "lab": "#D55E00",
    "rig": "#808080",
    "prediction": "#009E73",
    "low": "#B0508A",
    "high": "#4B1438",
    "robust": "#E69F00",
    "ghost": "#B5B5B5",
    "ink": "#4D4D4D",
    "shade": "#E9EEF3",
}
# Told apart in grey as well, wherever curves cross: full for 1-g, dashed for 0-g.
DASHES: dict[str, Any] = {"orbit": (0, (5, 1.5)), "lab": "-", "rig": "-"}
FITTED: Any = (0, (4, 1.5))
LABEL = {"orbit": "0-g", "lab": "1-g", "rig": "measured (simulated rig)"}
WIDTH_IN = 7.2

STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "Helvetica"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "legend.fontsize": 8.0,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
    "svg.fonttype": "none",
}


@contextmanager
def house_style(**more: Any) -> Generator[None]:
    """Matplotlib's defaults and ours, whatever the user's configuration says; restored at the end."""
    with mpl.rc_context():
        mpl.rcdefaults()
        settings: Any = mpl.rcParams  # typed by a list of keys; ours are checked when they are set
        settings.update(STYLE | more)
        yield


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw within the house style."""

    @wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with house_style():
            return draw(*args, **kwargs)

    return wrapped


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """An empty figure of the house's width, without pyplot's global state."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def square_pictures(count: int) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` square pictures, two in a row, with room for a legend."""
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = new_figure(0.75 + rows * WIDTH_IN / 2.0)
    axes: list[Axes] = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in axes[count:]:
        spare.set_visible(False)
    return figure, axes[:count]


def legend_below(figure: Figure, pictures: Sequence[Axes]) -> None:
    """One legend for all pictures, under them, where nothing is drawn."""
    named = {
        label: handle
        for axes in pictures
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named.keys(), loc="outside lower left", ncols=3)


def note(
    axes: Axes, text: str, at: Any, offset: tuple[float, float], *, fontsize: float = 7.5, **look: Any
) -> None:
    """Small text beside a point, ``offset`` in points, beyond the limits of the axes too."""
    axes.annotate(
        text, at, offset, textcoords="offset points", fontsize=fontsize, annotation_clip=False, **look
    )


class PlainNumbers(LogFormatter):
    """Labels between decades where matplotlib wants some, as plain numbers."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label at ``x``."""
        return f"{x:g}" if super().__call__(x, pos) else ""


def frequency_axis(axes: Axes, low_hz: float, high_hz: float, *, label: bool = True) -> None:
    """Logarithmic frequency [Hz] with plain numbers."""
    axes.set_xscale("log")
    axes.set_xlim(low_hz, high_hz)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(PlainNumbers())
    if label:
        axes.set_xlabel("frequency [Hz]")
    else:
        axes.tick_params(labelbottom=False)


def phase_axis(axes: Axes) -> None:
    """Phase [deg], wrapped to one turn."""
    axes.set_ylim(-180.0, 180.0)
    axes.set_yticks([-180, -90, 0, 90, 180])
    axes.set_ylabel("phase [deg]")


def draw_stems(axes: Axes, values: np.ndarray, base: float, names: Sequence[str], form: str) -> None:
    """Horizontal stems from ``base``, the first on top, each with its value beside it."""
    rows = np.arange(len(values))
    axes.hlines(rows, base, values, color=COLOUR["lab"], linewidth=1.6)
    axes.plot(values, rows, "o", color=COLOUR["lab"])
    for row, value in zip(rows, values, strict=True):
        note(axes, form.format(value), (max(value, base), row), (6, 0), va="center")
    axes.set_yticks(rows, names)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(values) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
