"""Open and closed loops over frequency: measured ones in full lines, their predictions dashed over them."""

from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from middeck.plot.curves import draw_magnitude
from middeck.plot.style import COLOUR, frequency_axis, new_figure
from middeck.study.measured_loop.computation import MeasuredLoop
from middeck.systems.plants.response import FrequencyResponse

DARKER, LIGHTER, LIGHT = 0.4, 0.3, 0.35


class LoopStyle(NamedTuple):
    """A loop's name in the legend, its colour, and the dashes of its prediction over the measured curve."""

    who: str
    colour: str
    dashes: tuple[int, tuple[int, ...]]


def contrasting(colour: str) -> tuple[float, float, float]:
    """The same hue, dark enough or light enough to stand on a line of that colour."""
    red, green, blue = to_rgb(colour)
    if 0.3 * red + 0.6 * green + 0.1 * blue > LIGHT:
        return DARKER * red, DARKER * green, DARKER * blue
    return 1.0 - LIGHTER * (1.0 - red), 1.0 - LIGHTER * (1.0 - green), 1.0 - LIGHTER * (1.0 - blue)


def begin_loops(open_loop: FrequencyResponse, title: str, *, output: int = 0) -> tuple[Figure, Axes]:
    """An empty figure with the measured open loop."""
    figure = new_figure(4.6)
    axes = figure.subplots()
    f = open_loop.frequency_hz
    style: dict[str, Any] = {"color": COLOUR["rig"], "linewidth": 1.6, "label": "open loop, measured"}
    draw_magnitude(axes, f, open_loop.H[:, output, 0], **style)
    axes.set_ylabel("magnitude [dB re 1 rad per N m]")
    axes.set_title(title)
    frequency_axis(axes, float(f[0]), float(f[-1]))
    return figure, axes


def draw_measured(
    axes: Axes, loop: MeasuredLoop, look: LoopStyle, *, output: int = 0, decibels: bool = True
) -> None:
    """The loop as measured on the rig, or a note that it was not."""
    full: dict[str, Any] = {"color": look.colour, "linewidth": 2.4}
    if loop.measured is None:
        axes.plot([], [], **full, label=f"{look.who}: unstable on the rig")
        return
    label = f"{look.who}, measured{_decibels(loop.measured_db) if decibels else ''}"
    draw_magnitude(axes, loop.measured.frequency_hz, loop.measured.H[:, output, 0], **full, label=label)


def draw_predicted(
    axes: Axes, loop: MeasuredLoop, look: LoopStyle, *, output: int = 0, decibels: bool = True
) -> None:
    """The loop as predicted from the fit."""
    colour = contrasting(look.colour)
    dashed: dict[str, Any] = {"color": colour, "linestyle": look.dashes, "linewidth": 1.0}
    label = f"{look.who}, predicted{_decibels(loop.predicted_db) if decibels else ''}"
    draw_magnitude(axes, loop.predicted.frequency_hz, loop.predicted.H[:, output, 0], **dashed, label=label)


def end_loops(figure: Figure, axes: Axes) -> Figure:
    """The legend below the axes."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=2)
    return figure


def _decibels(value: float | None) -> str:
    return "" if value is None else f": {value:.2f} dB".replace("-", "\N{MINUS SIGN}")
