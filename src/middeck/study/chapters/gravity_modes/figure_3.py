"""Figure 3: the article as it floats in 0-g and as it hangs in 1-g, its static shape exaggerated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull

from middeck.plot.shapes import round_down
from middeck.plot.style import COLOUR, new_figure, note, styled
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import PosePoints, points_in_world
from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.structure.model.article import Body
from middeck.structure.rest.equilibrium import Equilibrium

SHOWN_M = 0.06  # about what the largest displacement is exaggerated to
LABELS_ABOVE_M = 0.12  # room for the names of the nodes
CABLE_SHOWN_M = 0.34  # of each cable; the rest is cut off
# World columns to the right and up: from the side, and along the bus from its first node.
VIEWS = {"side view": (0, 1), "end view": (2, 1)}
AXIS = "xyz"


class RestDrawing(NamedTuple):
    """A rest state whose displacements from the undeformed state are drawn ``factor`` times."""

    rest: Equilibrium
    factor: float


@styled
def figure_3(comparison: ModeComparison) -> Figure:
    """The article in both environments: side view and, from the end of the first node, end view."""
    moved = _largest_displacement(comparison.lab.equilibrium)
    factor = round_down(SHOWN_M / moved) if moved > 0.0 else 1.0
    figure = new_figure(4.3)
    grid = figure.subplots(2, 2, sharex="col", sharey="row")
    titles = {
        "orbit": "0-g: free and undeformed",
        "lab": f"1-g: hung at three points, displacements drawn {factor:g} times",
    }
    for row, (environment, title) in zip(grid, titles.items(), strict=True):
        drawing = RestDrawing(getattr(comparison, environment).equilibrium, factor)
        for axes, view in zip(row, VIEWS, strict=True):
            _draw_view(axes, drawing, view, COLOUR[environment])
        row[0].set_title(title)
        _name_end(row[1])
        row[0].set_ylabel("y [m]")
    _name_parts(grid[0, 0], comparison.orbit.equilibrium.model)
    grid[0, 0].set_ylim(top=LABELS_ABOVE_M)
    for axes, (right, _) in zip(grid[1], VIEWS.values(), strict=True):
        axes.set_xlabel(f"{AXIS[right]} [m]")
    for column in grid.T:
        _show_all(column)
    _one_scale(grid)
    return figure


def _name_end(axes: Axes) -> None:
    """Over the view, however narrow it is; its ticks few enough not to meet."""
    axes.set_title("end\nview", fontsize=8.0)
    axes.xaxis.set_major_locator(MaxNLocator(2, min_n_ticks=1))
    axes.tick_params(axis="x", labelsize=7.0)


def _show_all(column: np.ndarray) -> None:
    """One range across for the panels of a column, wide enough for what any of them draws."""
    low = min(axes.dataLim.x0 for axes in column)
    high = max(axes.dataLim.x1 for axes in column)
    margin = 0.05 * (high - low)
    column[0].set_xlim(low - margin, high + margin)


def _one_scale(grid: np.ndarray) -> None:
    """Give every panel room in proportion to what it shows, so that all have the same metres per inch."""
    boxes = np.array([[np.abs(axes.viewLim.size) for axes in row] for row in grid])
    layout = grid[0, 0].get_gridspec()
    layout.set_width_ratios(list(boxes[:, :, 0].max(axis=0)))
    layout.set_height_ratios(list(boxes[:, :, 1].max(axis=1)))


def _name_parts(axes: Axes, model: Model) -> None:
    """Node names above the nodes, the names of the carried bodies' last axes beside their boxes."""
    for node in model.structure.nodes:
        x, y, _ = node.position
        note(axes, node.name, (x, y), (0, 9), ha="center")
    poses = model.drawn
    for joint in model.structure.joints:
        if np.any(joint.body.cg):
            frame = model.frames.index(joint.name)
            centre = poses.p[frame] + poses.R[frame] @ joint.body.cg
            text = f"payload\n{joint.name.partition('_')[0]}"
            left = centre[0] > np.mean([node.position[0] for node in model.structure.nodes])
            note(axes, text, centre[:2], (-16 if left else 16, -9), ha="right" if left else "left")


def _largest_displacement(rest: Equilibrium) -> float:
    return float(np.linalg.norm(rest.config.x - rest.model.rest.x, axis=1).max(initial=0.0))


def _shown(drawing: RestDrawing, points: PosePoints) -> Float[np.ndarray, "pose 3"]:
    model = drawing.rest.model
    at_rest = points_in_world(points, model.drawn)
    now = points_in_world(points, drawing.rest.poses)
    return at_rest + drawing.factor * (now - at_rest)


def _draw_view(axes: Axes, drawing: RestDrawing, view: str, colour: str) -> None:
    if drawing.rest.suspension.attach:
        _draw_members(axes, drawing._replace(factor=0.0), view, COLOUR["ghost"], 1.0)
        _draw_cables(axes, drawing, view)
    _draw_members(axes, drawing, view, colour, 2.2)
    _draw_bodies(axes, drawing, view, colour)
    axes.set_aspect("equal", adjustable="box")
    axes.margins(0.05)


def _draw_members(axes: Axes, drawing: RestDrawing, view: str, colour: str, width: float) -> None:
    model = drawing.rest.model
    world = _shown(drawing, model.points)
    right, up = VIEWS[view]
    for member in range(len(model.structure.members)):
        ends = model.element_ends[model.element_member == member]
        chain = world[np.concatenate([ends[:1, 0], ends[:, 1]])]
        axes.plot(chain[:, right], chain[:, up], color=colour, linewidth=width, zorder=2)


def _draw_bodies(axes: Axes, drawing: RestDrawing, view: str, colour: str) -> None:
    """Nodes as boxes of their size; a carried body as its arm and the box that has its inertia."""
    model = drawing.rest.model
    for frame, node in enumerate(model.structure.nodes):
        _draw_box(axes, drawing, view, frame, np.zeros(3), np.full(3, node.size), "#555555")
    for joint in model.structure.joints:
        frame = model.frames.index(joint.name)
        arm = [(model.frames.index(joint.parent), np.zeros(3)), (frame, np.zeros(3)), (frame, joint.body.cg)]
        _draw_line(axes, drawing, view, arm)
        if np.any(joint.body.cg):
            _draw_box(axes, drawing, view, frame, joint.body.cg, _box_size(joint.body), colour)


def _box_size(body: Body) -> Float[np.ndarray, "3"]:
    """Edges of the uniform box with this mass and these moments of inertia; zero where none exists."""
    moments = np.diag(body.inertia)
    return np.sqrt(np.maximum(6.0 / body.mass * (moments.sum() - 2.0 * moments), 0.0))


def _draw_box(
    axes: Axes, drawing: RestDrawing, view: str, frame: int, centre: np.ndarray, size: np.ndarray, colour: str
) -> None:
    signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
    corners = _shown(drawing, PosePoints(np.full(8, frame), centre + signs * size))
    right, up = VIEWS[view]
    flat = corners[:, [right, up]]
    if np.linalg.matrix_rank(flat - flat[0], tol=1e-9) == 2:
        outline = flat[ConvexHull(flat).vertices]
        axes.add_patch(
            Polygon(outline, facecolor=colour, edgecolor="black", linewidth=0.6, alpha=0.55, zorder=3)
        )


def _draw_line(axes: Axes, drawing: RestDrawing, view: str, points: list[tuple[int, np.ndarray]]) -> None:
    frames, offsets = zip(*points, strict=True)
    world = _shown(drawing, PosePoints(np.array(frames), np.array(offsets)))
    right, up = VIEWS[view]
    axes.plot(world[:, right], world[:, up], color="black", linewidth=0.9, zorder=2.5)


def _draw_cables(axes: Axes, drawing: RestDrawing, view: str) -> None:
    """The lowest part of each cable, along the straight line to its anchor."""
    rest, points = drawing.rest, drawing.rest.model.points
    at = rest.loads.attach_point
    right, up = VIEWS[view]
    feet = _shown(drawing, PosePoints(points.frame[at], points.offset[at]))
    for k in range(len(rest.suspension.attach)):
        span = rest.loads.anchor[k] - feet[k]
        top = feet[k] + span * min(1.0, CABLE_SHOWN_M / float(np.linalg.norm(span)))
        line = np.array([feet[k], top])
        axes.plot(line[:, right], line[:, up], color=COLOUR["ink"], linewidth=0.9, zorder=1.5)
        axes.plot(top[right], top[up], marker=(2, 0, 60), color=COLOUR["ink"], markersize=9)
        if view == "side view":
            length = float(np.linalg.norm(span))
            text = f"{rest.suspension.attach[k]}: {rest.tension[k]:.1f} N\n{length:.2f} m cable"
            last = k == len(feet) - 1
            note(axes, text, top[[right, up]], (-6 if last else 6, -14), ha="right" if last else "left")
