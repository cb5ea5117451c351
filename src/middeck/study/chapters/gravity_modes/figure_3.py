"""Figure 3: the article as it floats in 0-g and as it hangs in 1-g, its static shape exaggerated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull

from middeck.plot.shapes import round_down
from middeck.plot.style import COLOUR, WIDTH_IN, new_figure, note, styled
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import points_in_world
from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.structure.model.environment import Environment
from middeck.structure.modes.results.article_drawing import Drawing, build_rest_drawing
from middeck.structure.rest.equilibrium import Equilibrium

# Lengths over the size of the article: the largest exaggerated displacement, the room for names of nodes, and
# the distance of cables with words of their own.
SHOWN, LABELS, APART = 0.04, 0.08, 0.2
TALL = 0.5  # height over both widths, from which on all four views stand in one row
WIDE_IN, TALLEST_IN, AROUND_IN = 4.3, 7.0, 1.6
COUNTS = {1: "one point", 2: "two points", 3: "three points"}
AXIS = "xyz"


class ViewAxes(NamedTuple):
    """World axes to the right and up; ``falls`` where gravity is along the axis that points up."""

    right: int
    up: int
    falls: bool


@styled
def figure_3(comparison: ModeComparison) -> Figure:
    """The article in both environments, from the side and from the end of it."""
    lab = comparison.lab.equilibrium
    extent = np.ptp(points_in_world(lab.model.points, lab.model.drawn), axis=0)
    moved, size = _largest_displacement(lab), float(extent.max())
    factor = max(round_down(SHOWN * size / moved), 1.0) if moved > 0.0 else 1.0
    times = "" if factor == 1.0 else f", displacements drawn {factor:g} times"
    titles = {"orbit": "0-g: free and undeformed", "lab": f"1-g: {_held(lab)}{times}"}
    looks = _looks(lab.environment, extent)
    figure, grid = _panels(extent, looks)
    for row, (environment, title) in zip(grid, titles.items(), strict=True):
        rest = getattr(comparison, environment).equilibrium
        for axes, look in zip(row, looks, strict=True):
            _draw_view(axes, rest, factor, look, COLOUR[environment])
            if _rows(grid) == 2:
                _name_cables(axes, rest, factor, look, APART * size)
            axes.set_xlabel(f"{AXIS[look.right]} [m]")
        row[0].set_title(title if _rows(grid) == 2 else title.partition(":")[0])
        _name_end(row[1])
        row[0].set_ylabel(f"{AXIS[looks[0].up]} [m]")
    if _rows(grid) == 1:
        figure.suptitle("; ".join(titles.values()), fontsize=9.0)
    _name_parts(grid[0, 0], comparison.orbit.equilibrium.model, looks[0])
    _show_all(grid, looks[0].falls, LABELS * size)
    _label_outside(grid)
    _one_scale(grid)
    return figure


def _looks(environment: Environment, extent: np.ndarray) -> tuple[ViewAxes, ViewAxes]:
    """Views from the side, with the longest level axis to the right, and along that axis."""
    up = environment.upwards
    vertical = 1 if up is None else int(np.argmax(np.abs(up)))
    falls = up is not None and float(up[vertical]) < 0.0
    side, end = sorted((k for k in range(3) if k != vertical), key=lambda k: -extent[k])
    return ViewAxes(side, vertical, falls), ViewAxes(end, vertical, falls)


def _held(rest: Equilibrium) -> str:
    count = len(rest.loads.attach_point)
    if count:
        return f"hung at {COUNTS.get(count, f'{count} points')}"
    return "clamped" if rest.environment.clamps else "at rest"


def _panels(extent: np.ndarray, looks: tuple[ViewAxes, ViewAxes]) -> tuple[Figure, np.ndarray]:
    """Rows 0-g and 1-g, columns from the side and from the end; of a tall article all beside each other."""
    across, height = sum(extent[look.right] for look in looks), extent[looks[0].up]
    if height <= TALL * across:
        figure = new_figure(WIDE_IN)
        return figure, figure.subplots(2, 2)
    wide = 2.0 * across / WIDTH_IN  # metres an inch; a mast in one line has none
    room = TALLEST_IN - AROUND_IN
    figure = new_figure(AROUND_IN + (room if height > wide * room else height / wide))
    return figure, figure.subplots(1, 4).reshape(2, 2)


def _rows(grid: np.ndarray) -> int:
    return int(grid[0, 0].get_gridspec().nrows)


def _name_end(axes: Axes) -> None:
    """Over the view, however narrow it is; its ticks few enough not to meet."""
    axes.set_title("end\nview", fontsize=8.0)
    axes.xaxis.set_major_locator(MaxNLocator(2, min_n_ticks=1))
    axes.tick_params(axis="x", labelsize=7.0)


def _show_all(grid: np.ndarray, falls: bool, labels: float) -> None:
    """One range across for the views from one side, and one upwards for those beside each other."""
    for column in grid.T:
        low, high = _range([axes.dataLim.intervalx for axes in column])
        for axes in column:
            axes.set_xlim(low, high)
    for row in grid.reshape(_rows(grid), -1):
        low, high = _range([axes.dataLim.intervaly for axes in row])
        named = grid[0, 0] in row
        low, high = (low - labels * (named and falls), high + labels * (named and not falls))
        for k, axes in enumerate(row):
            axes.set_ylim(*((high, low) if falls else (low, high)))
            axes.tick_params(axis="y", labelleft=k == 0)


def _label_outside(grid: np.ndarray) -> None:
    """Labels where panels that share an axis do not have them beside or below."""
    if _rows(grid) == 2:
        for axes in grid[0]:
            axes.set_xlabel("")
            axes.tick_params(axis="x", labelbottom=False)
    else:
        for axes in grid[:, 0]:
            axes.xaxis.set_major_locator(MaxNLocator(3, min_n_ticks=1))
        grid[1, 0].set_ylabel("")


def _range(intervals: Sequence[np.ndarray]) -> tuple[float, float]:
    low, high = float(np.min(intervals)), float(np.max(intervals))
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def _one_scale(grid: np.ndarray) -> None:
    """Give every panel room in proportion to what it shows, so that all have the same metres per inch."""
    layout = grid[0, 0].get_gridspec()
    boxes = np.array([np.abs(axes.viewLim.size) for axes in grid.ravel()])
    boxes = boxes.reshape(layout.nrows, layout.ncols, 2)
    layout.set_width_ratios(list(boxes[:, :, 0].max(axis=0)))
    layout.set_height_ratios(list(boxes[:, :, 1].max(axis=1)))


def _name_parts(axes: Axes, model: Model, look: ViewAxes) -> None:
    """Node names above the nodes, the names of the carried bodies' last axes beside their boxes."""
    for node in model.structure.nodes:
        note(axes, node.name, node.position[[look.right, look.up]], (0, 9), ha="center")
    poses = model.drawn
    for joint in model.structure.joints:
        if np.any(joint.body.cg):
            frame = model.frames.index(joint.name)
            centre = poses.p[frame] + poses.R[frame] @ joint.body.cg
            text = f"payload\n{joint.name.partition('_')[0]}"
            middle = np.mean([node.position[look.right] for node in model.structure.nodes])
            left = centre[look.right] > middle
            place = centre[[look.right, look.up]]
            note(axes, text, place, (-16 if left else 16, -9), ha="right" if left else "left")


def _largest_displacement(rest: Equilibrium) -> float:
    return float(np.linalg.norm(rest.config.x - rest.model.rest.x, axis=1).max(initial=0.0))


def _draw_view(axes: Axes, rest: Equilibrium, factor: float, look: ViewAxes, colour: str) -> None:
    """Members, bodies on their arms and cables, displaced ``factor`` times; behind them members as drawn."""
    drawing, hung = build_rest_drawing(rest), bool(np.any(rest.loads.gravity))
    structure = rest.model.structure
    shade = {node.name: "#555555" for node in structure.nodes}
    shade |= {joint.name: colour for joint in structure.joints if np.any(joint.body.cg)}
    arms = {joint.name for joint in structure.joints}
    flat, at = _flat(drawing, factor, look)
    for line in drawing.lines:
        some = slice(line.first, line.last)
        if line.what == "member":
            if hung:
                axes.plot(*flat[some].T, color=COLOUR["ghost"], linewidth=1.0, zorder=2)
            axes.plot(*at[some].T, color=colour, linewidth=2.2, zorder=2)
        elif line.what == "body" and line.name in shade:
            _draw_box(axes, at[some], shade[line.name])
        elif line.what == "rigid" and line.name in arms:
            axes.plot(*at[some].T, color="black", linewidth=0.9, zorder=2.5)
        elif line.what == "cable" and hung:
            axes.plot(*at[some].T, color=COLOUR["ink"], linewidth=0.9, zorder=1.5)
            axes.plot(*at[line.last - 1], marker=(2, 0, 60), color=COLOUR["ink"], markersize=9)
    axes.set_aspect("equal", adjustable="box")
    axes.margins(0.05)


def _flat(drawing: Drawing, factor: float, look: ViewAxes) -> tuple[np.ndarray, np.ndarray]:
    """Points as drawn, and displaced from there ``factor`` times as far as at rest."""
    drawn, rest = (x[:, [look.right, look.up]] for x in (drawing.drawn, drawing.rest))
    return drawn, drawn + factor * (rest - drawn)


def _draw_box(axes: Axes, corners: Float[np.ndarray, "corner 2"], colour: str) -> None:
    if np.linalg.matrix_rank(corners - corners[0], tol=1e-9) == 2:
        outline = corners[ConvexHull(corners).vertices]
        # Where the hull begins hangs on last digits; the lowest along a direction of no edge is one corner.
        outline = np.roll(outline, -int(np.argmin(outline @ (0.618, 1.0))), axis=0)
        box = Polygon(outline, facecolor=colour, edgecolor="black", linewidth=0.6, alpha=0.55, zorder=3)
        axes.add_patch(box)


def _name_cables(axes: Axes, rest: Equilibrium, factor: float, look: ViewAxes, apart: float) -> None:
    """Tension and length of each cable at its upper end, where there is room for words."""
    drawing = build_rest_drawing(rest)
    at, cables = _flat(drawing, factor, look)[1], [line for line in drawing.lines if line.what == "cable"]
    feet = np.array([line.first for line in cables], dtype=int)
    if not np.any(rest.loads.gravity) or np.any(np.diff(np.sort(at[feet, 0])) <= apart):
        return
    length = np.linalg.norm(rest.loads.anchor - drawing.rest[feet], axis=1)
    for k, line in enumerate(cables):
        text = f"{line.name}: {rest.tension[k]:.1f} N\n{length[k]:.2f} m cable"
        last = k == len(cables) - 1
        place = (-6 if last else 6, -14)
        note(axes, text, at[line.last - 1], place, ha="right" if last else "left")
