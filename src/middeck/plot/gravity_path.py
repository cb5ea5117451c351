"""Frequency against gravity: modes as branches, with what happens to them on the way."""

from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, PlainNumbers, new_figure, styled
from middeck.structure.gravity.path import GravityPath
from middeck.structure.gravity.path_events import EventKind, GravityEvent

KIND = {
    **{"rigid": COLOUR["ink"], "suspension": COLOUR["orbit"], "pendulum": COLOUR["orbit"]},
    "flexible": COLOUR["lab"],
}
MARK = {EventKind.CROSSING: "x", EventKind.VEERING: "s"}
WORD = {EventKind.CROSSING: "crossing", EventKind.VEERING: "veering"}
# Relative variation of gravity below which a path is drawn against the angle that gravity has turned.
SAME_SIZE = 1e-6
# Room between two names at the edge, in the height of the axes.
ROOM = 0.034
PAPER: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}
LEADER: dict[str, Any] = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 1.0, "shrinkB": 0.0}


@styled
def gravity_path_figure(path: GravityPath) -> Figure:
    """Held branches beside flexible ones; events marked, places as dashed lines.

    Flexible branches stand on a logarithmic axis, unless one of them reaches zero. The end of a path is red.
    """
    if not len(path.s):
        figure = new_figure(5.4, 7.4)
        axes = figure.add_subplot()
        axes.set_axis_off()
        axes.text(0.5, 0.5, "\n".join(e.sentence for e in path.events), ha="center", wrap=True)
        return figure
    groups = [
        [b for b in range(len(path.name)) if (path.kind[b] == "flexible") is flexible]
        for flexible in (False, True)
    ]
    groups = [group for group in groups if group]
    figure = new_figure(5.4, 4.6 * len(groups) + 1.0)
    for panel, group in zip(figure.subplots(1, len(groups), squeeze=False)[0], groups, strict=True):
        draw_branches(panel, path, group)
        if len(groups) == 1 or panel.get_legend_handles_labels()[1] != ["flexible"]:
            panel.legend(loc="best", ncols=2)
    title = fill(path.structure.title, 60 * len(groups))
    figure.suptitle(f"{title}\n{path.environment.title}, devices {path.rule.value}", fontsize=9.5)
    return figure


def draw_branches(axes: Axes, path: GravityPath, branches: list[int]) -> None:
    """Frequencies against the size of gravity, or against its turn where the size stays."""
    x, label = _abscissa(path)
    f = path.frequency_hz[:, branches]
    seen: set[str] = set()
    for b in branches:
        kind = path.kind[b]
        axes.plot(
            x, path.frequency_hz[:, b], color=KIND[kind], linewidth=1.1, label="_" if kind in seen else kind
        )
        seen.add(kind)
    if all(path.kind[b] == "flexible" for b in branches) and float(f.min()) > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(0.8 * float(f.min()), 1.25 * float(f.max()))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(PlainNumbers())
    else:
        axes.set_ylim(min(0.0, 1.05 * float(f.min())), 1.05 * float(f.max()))
    axes.set_xlabel(label)
    axes.set_ylabel("frequency [Hz]")
    for event in path.events:
        if event.ends or (event.branch and not set(event.branch) - set(branches)):
            _mark(axes, path, x, event, seen)
    for place, station in zip(path.places, path.reached, strict=False):
        axes.axvline(x[station], color=COLOUR["ghost"], linestyle="--", linewidth=0.8, zorder=1)
        axes.annotate(place.name, (x[station], 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                      textcoords="offset points", ha="center", fontsize=7.5)  # fmt: skip
    most = int(np.argmax(x))
    ends = [(path.frequency_hz[most, b], path.name[b], KIND[path.kind[b]]) for b in branches]
    _name_branches(axes, float(x[most]), ends)


def _abscissa(path: GravityPath) -> tuple[np.ndarray, str]:
    size = path.size
    if np.ptp(size) > SAME_SIZE * size.max():
        return size, "gravity [m/s²]"
    along = path.gravity @ path.gravity[0] / (size * size[0])
    across = np.linalg.norm(np.cross(path.gravity, path.gravity[0]), axis=1) / (size * size[0])
    return np.degrees(np.arctan2(across, along)), "angle that gravity has turned [deg]"


def _mark(axes: Axes, path: GravityPath, x: np.ndarray, event: GravityEvent, seen: set[str]) -> None:
    at = float(np.interp(event.s, path.s, x))
    if event.ends:
        axes.axvline(at, color="#B00020", linewidth=1.0)
        aside, near = (4, "left") if at < 0.5 * (x.min() + x.max()) else (-4, "right")  # into the axes
        axes.annotate(event.sentence, (at, 0.5), xycoords=("data", "axes fraction"), rotation=90,
                      xytext=(aside, 0), textcoords="offset points", ha=near, va="center", fontsize=7.5,
                      color="#B00020", bbox=PAPER)  # fmt: skip
        return
    word = WORD[event.kind]
    axes.plot(at, event.frequency_hz, MARK[event.kind], color="black", markerfacecolor="none",
              markersize=5.0, linestyle="", label="_" if word in seen else word, zorder=4)  # fmt: skip
    seen.add(word)


def _name_branches(axes: Axes, x: float, ends: list[tuple[float, str, str]]) -> None:
    """Names beside the greatest gravity, outside the axes, pushed apart where they would touch."""
    to_axes = axes.transData + axes.transAxes.inverted()
    floor = -1.0
    for f, name, colour in sorted(ends):
        height = float(to_axes.transform((x, f))[1])
        floor = max(height, floor + ROOM)
        axes.annotate(name, (1.0, height), xycoords="axes fraction", xytext=(1.04, floor),
                      textcoords="axes fraction", color=colour, ha="left", va="center", fontsize=7.0,
                      arrowprops=LEADER | {"color": colour, "relpos": (0.0, 0.5)})  # fmt: skip
