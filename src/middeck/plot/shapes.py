"""Shapes of an article in three dimensions: modes on one page, 0-g beside 1-g, and states of rest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from middeck.plot.style import COLOUR, new_figure, note, styled
from middeck.structure.modes.results.article_drawing import Drawing

# Largest motion of a shape, of the size of the article.
REACH = 0.12
# The eye: turned about the vertical, and above the horizon [deg].
AZIMUTH, ELEVATION = -32.0, 22.0
LEVELS = 8
# Less the brightest yellow, which white paper swallows.
SHADES = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.92, LEVELS)))
COLUMNS, PANEL_IN = 4, 1.75
# Heights of a line of the title, of one over a panel, of the scale, and of a line of the legend below [in].
TITLE_IN, LINE_IN, SCALE_IN, ENTRY_IN = 0.15, 0.12, 0.5, 0.17
LETTER_IN = 0.062  # room for a letter at 7 points
MOST_PANELS = 40  # of a picture in a file: what is longer fits no page
TINY = float(np.finfo(float).tiny)
MARKS: dict[str, dict[str, Any]] = {
    "node": {"marker": "o", "markersize": 2.2, "color": COLOUR["ink"], "markerfacecolor": "none"},
    "mass": {"marker": "o", "markersize": 3.5, "color": COLOUR["ink"]},
    "clamp": {"marker": "s", "markersize": 5.0, "color": "black"},
    "support": {"marker": "^", "markersize": 5.5, "color": "black", "markerfacecolor": "none"},
    "ground": {"marker": "D", "markersize": 4.0, "color": "black", "markerfacecolor": "none"},
    "force": {"marker": "^", "markersize": 4.5, "color": COLOUR["lab"]},
    "moment": {"marker": "$\\circlearrowleft$", "markersize": 7.0, "color": COLOUR["lab"]},
}
WORDS = {"node": "measured node", "ground": "bushing to the ground", "support": "support of some directions"}
OF_LINES = {
    "body": "body, as the uniform box of its size or inertia",
    "component": "component, between known points or from its centre of mass",
    "link": "link that leaves some motion free, or average",
}
BOXED: dict[str, Any] = {
    "linestyle": "", "marker": "s", "markersize": 6.0, "color": COLOUR["ink"], "markerfacecolor": "none",
}  # fmt: skip
ARROW: dict[str, Any] = {
    "arrowstyle": "-|>",
    "linewidth": 0.8,
    "shrinkA": 0.0,
    "shrinkB": 0.0,
    "mutation_scale": 6,
}
THICK = {"member": 1.5, "body": 0.7, "section": 0.5, "rigid": 0.8, "link": 0.8, "spring": 0.8, "bushing": 0.8,
         "component": 0.9}  # fmt: skip
DASHED = {"component": (0.0, (3.0, 1.6)), "link": (0.0, (0.8, 1.6))}


class Shown(NamedTuple):
    """One shape of a drawing: its number there, and the sign it is drawn with."""

    drawing: int
    shape: int
    sign: float = 1.0


def upright(ups: Iterable[np.ndarray | None]) -> Float[np.ndarray, "3 3"]:
    """Rows: right, up and towards the eye in W; up is the first direction there is, else y.

    >>> upright([None, np.array([0.0, 0.0, 1.0])]).tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    """
    up = next((up for up in ups if up is not None), np.array([0.0, 1.0, 0.0]))
    along = np.eye(3)[0 if abs(up[0]) < 0.8 else 2]
    right = along - (along @ up) * up
    right = right / np.linalg.norm(right)
    return np.array([right, up, np.cross(right, up)]) + 0.0


def turned(azimuth_deg: float, elevation_deg: float) -> Float[np.ndarray, "3 3"]:
    """From `upright` axes to right and up on the page, and towards the eye."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    about_up = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(e), -np.sin(e)], [0.0, np.sin(e), np.cos(e)]])
    return tilt @ about_up


def factor_of(drawing: Drawing, shape: int) -> float:
    """Factor on a shape that makes its largest motion `REACH` of the article's size."""
    largest = float(np.linalg.norm(drawing.motion[shape], axis=1).max(initial=0.0))
    return REACH * drawing.size / largest if largest > 0.0 else 0.0


def label_of(drawing: Drawing, shape: int) -> str:
    """Number, frequency and name of a shape.

    A shape that shares its frequency with others is one of any basis of theirs, and is called so.
    """
    many = drawing.alike[shape]
    alike = f"\n(one of {many} of equal frequency)" if many > 1 else ""
    return f"{drawing.number[shape]}: {drawing.frequency_hz[shape]:.4g} Hz\n{drawing.name[shape]}{alike}"


def first_panels(rows: Sequence[Sequence[Shown | None]]) -> tuple[Sequence[Sequence[Shown | None]], int]:
    """The first rows of `shapes_figure` that `MOST_PANELS` hold, and how many shapes are left out."""
    ends = np.cumsum([sum(cell is not None for cell in row) for row in rows], dtype=int)
    kept = int(np.searchsorted(ends, MOST_PANELS, side="right"))
    return rows[:kept], int(ends[-1] - ends[kept - 1]) if kept < len(rows) else 0


def draw_shapes(drawing: Drawing) -> Figure:
    """Every shape of ``drawing`` in a panel of its own."""
    return shapes_figure([drawing], [[Shown(drawing=0, shape=i)] for i in range(len(drawing.name))])


@styled
def shapes_figure(
    drawings: Sequence[Drawing],
    rows: Sequence[Sequence[Shown | None]],
    titles: Sequence[str] = (),
    left_out: int = 0,
) -> Figure:
    """A panel for every entry of ``rows``; with several drawings a row has one entry for each, or None.

    Full rows come first, then the entries of the others one after the other. All panels have one view and one
    scale of length; each shape has its own scale of motion. The heading says how many shapes were
    ``left_out``.
    """
    cells = [cell for row in rows if None not in row for cell in row]
    wide = len(rows[0]) if rows and len(rows[0]) > 1 else 1
    single = [cell for row in rows if None in row for cell in row if cell is not None]
    columns = max(wide, min(COLUMNS - COLUMNS % wide, len(cells) + len(single)))
    cells += [None] * (-len(cells) % columns if single else 0) + single
    view = turned(AZIMUTH, ELEVATION) @ upright(d.up for d in drawings)
    low, high = _limits([(drawings[c.drawing], c) for c in cells if c], view)
    inches = _size_of_panel(columns, high - low)
    words = [None if c is None else _over(drawings[c.drawing], c, titles, inches[0]) for c in cells]
    lines = max((w.count("\n") + 1 for w in words if w), default=0)
    heading, legend = _heading(drawings, columns, left_out), _entries(drawings)
    beside = _beside(legend, _wide(columns))
    foot = SCALE_IN + ENTRY_IN * -(-len(legend) // beside)
    figure, panels = _panels(
        max(-(-len(cells) // columns), 1), columns, inches[1],
        top=TITLE_IN * (heading.count("\n") + 2), words=LINE_IN * (lines + 1), foot=foot,
    )  # fmt: skip
    first: dict[int, Axes] = {}
    for k, axes in enumerate(panels):
        axes.set_axis_off()
        cell = cells[k] if k < len(cells) else None
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal")
        if cell is None:
            continue
        drawing = drawings[cell.drawing]
        if cell.drawing not in first:
            first[cell.drawing] = axes
            draw_axes(axes, drawing, view)
        motion = cell.sign * factor_of(drawing, cell.shape) * drawing.motion[cell.shape]
        size = np.linalg.norm(motion, axis=1)
        draw_state(axes, drawing, drawing.rest, view, None)
        draw_state(axes, drawing, drawing.rest + motion, view, size / max(float(size.max(initial=0.0)), TINY))
        axes.set_title(words[k] or "", y=1.0, fontsize=7.0, loc="left")  # nothing above it to be sought
    _scale(figure, heading, foot)
    if legend:
        figure.legend(handles=legend, loc="lower left", ncols=beside, fontsize=7.0, borderaxespad=0.2)
    return figure


def _over(drawing: Drawing, shown: Shown, titles: Sequence[str], wide_in: float) -> str:
    """The lines over a panel, no longer than it is wide; a long title has one of its own."""
    first, *others = label_of(drawing, shown.shape).split("\n")
    room = int(wide_in / LETTER_IN)
    if titles:
        apart = "  " if len(titles[shown.drawing]) + 2 + len(first) <= room else "\n"
        first = f"{titles[shown.drawing]}{apart}{first}"
    return "\n".join(fill(line, room) for line in [*first.split("\n"), *others])


def _size_of_panel(columns: int, shown: np.ndarray) -> tuple[float, float]:
    """Width and height [in]."""
    return max(columns, 3) * PANEL_IN / columns, min(max(PANEL_IN * shown[1] / shown[0], 0.9), 2.6)


def _panels(
    rows: int, columns: int, panel_in: float, *, top: float, words: float, foot: float
) -> tuple[Figure, list[Axes]]:
    """Panels in places of their own: matplotlib's layout would look at every point for each of them."""
    high, wide = top + rows * (panel_in + words) + foot, _wide(columns)
    figure = Figure(figsize=(wide, high))
    grid = figure.add_gridspec(
        rows, columns, left=0.1 / wide, right=1.0 - 0.1 / wide, top=1.0 - (top + words) / high,
        bottom=foot / high, hspace=words / panel_in, wspace=0.06,
    )  # fmt: skip
    return figure, list(grid.subplots(squeeze=False).ravel())


def _wide(columns: int) -> float:
    return max(columns, 3) * PANEL_IN + 0.3


def _heading(drawings: Sequence[Drawing], columns: int, left_out: int) -> str:
    places = " and ".join(dict.fromkeys(d.environment for d in drawings))
    reach = REACH * drawings[0].size
    lines = [
        f"{drawings[0].title}: mode shapes in {places}",
        f"grey: at rest; colour: motion, the largest drawn as {reach:.2g} m, "
        f"{REACH:.0%} of the article's size",
        *([f"{left_out} more shapes are not drawn here; a page (.html) has all"] if left_out else []),
    ]
    return "\n".join(fill(line, int(17 * _wide(columns))) for line in lines)


def _scale(figure: Figure, heading: str, foot: float) -> None:
    """The heading, and the scale of colours above the legend, ``foot`` the height of both [in]."""
    wide, high = figure.get_size_inches()
    figure.text(0.1 / wide, 1.0 - 0.08 / high, heading, fontsize=8.0, va="top")
    place = figure.add_axes((0.1 / wide, (foot - 0.14) / high, 2.2 / wide, 0.08 / high))
    norm = BoundaryNorm(np.linspace(0.0, 1.0, LEVELS + 1), LEVELS)
    bar = figure.colorbar(ScalarMappable(norm, SHADES), cax=place, orientation="horizontal")
    bar.set_ticks([0.0, 0.5, 1.0])
    bar.ax.tick_params(labelsize=6.0, length=2.0)
    bar.set_label("motion, of the largest of each shape", fontsize=6.5)


def _entries(drawings: Sequence[Drawing]) -> list[Line2D]:
    """Entries of the legend."""
    looks: dict[str, dict[str, Any]] = {what: {"linestyle": "", **look} for what, look in MARKS.items()}
    looks["body"] = BOXED
    for what, dashes in DASHED.items():
        looks[what] = {"linestyle": dashes, "linewidth": THICK[what], "color": COLOUR["ink"]}
    return [Line2D([], [], label=words, **looks[what]) for what, words in legend_words(drawings)]


def legend_words(drawings: Sequence[Drawing]) -> list[tuple[str, str]]:
    """Marks, boxes and dashed lines that are drawn, each with its words."""
    seen = dict.fromkeys(mark.what for drawing in drawings for mark in drawing.marks)
    lines = {line.what for drawing in drawings for line in drawing.lines}
    found = [(what, WORDS.get(what, what)) for what in seen]
    return found + [(what, words) for what, words in OF_LINES.items() if what in lines]


def _beside(entries: Sequence[Line2D], wide_in: float) -> int:
    """How many entries a line of the legend holds."""
    longest = max((len(str(e.get_label())) for e in entries), default=0)
    return max(1, min(len(entries), int(wide_in / (LETTER_IN * (longest + 6)))))


@styled
def rest_figure(drawings: Sequence[Drawing], titles: Sequence[str]) -> Figure:
    """States of rest side by side, each beside what was drawn; displacements of all in one scale."""
    view = turned(AZIMUTH, ELEVATION) @ upright(d.up for d in drawings)
    moved = max(float(np.linalg.norm(d.rest - d.drawn, axis=1).max(initial=0.0)) for d in drawings)
    factor = round_down(REACH * drawings[0].size / moved) if moved > 0.0 else 1.0
    states = [(d.drawn + factor * (d.rest - d.drawn), d) for d in drawings]
    flat = np.concatenate([x @ view[:2].T for shown, d in states for x in (d.drawn, shown)])
    low, high = _roomy(flat.min(axis=0), flat.max(axis=0), drawings[0].size)
    width = 7.2 / len(drawings)
    figure = new_figure(1.2 + min(max(width * (high - low)[1] / (high - low)[0], 1.5), 4.0))
    for axes, (x, drawing), title in zip(figure.subplots(1, len(drawings), squeeze=False)[0], states, titles,
                                         strict=True):  # fmt: skip
        axes.set_axis_off()
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal")
        draw_axes(axes, drawing, view)
        size = np.linalg.norm(drawing.rest - drawing.drawn, axis=1)
        draw_state(axes, drawing, drawing.drawn, view, None)
        draw_state(axes, drawing, x, view, size / moved if moved > 0.0 else size)
        axes.set_title(title, y=1.0, fontsize=8.0)
    times = "as they are" if factor == 1.0 else f"times {factor:g}"
    figure.suptitle(
        f"{fill(drawings[0].title, 90)}: rest in {drawings[0].environment}\ngrey: as drawn; colour: at rest, "
        f"displacements {times}, the largest {1e3 * moved:.3g} mm",
        fontsize=8.5,
    )
    legend = _entries(drawings)
    if legend:
        beside = _beside(legend, figure.get_figwidth())
        figure.legend(handles=legend, loc="outside lower left", ncols=beside, fontsize=7.0)
    return figure


def round_down(x: float) -> float:
    """The largest of 1, 2, 5, 10, 20 ... that does not exceed ``x``; at least 1."""
    return _round_bar(max(x, 1.0))


def _limits(cells: Sequence[tuple[Drawing, Shown]], view: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Around all shapes both ways, with room below for the axes."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for drawing, cell in cells:
        motion = factor_of(drawing, cell.shape) * drawing.motion[cell.shape]
        for x in (drawing.rest, drawing.rest + motion, drawing.rest - motion):
            flat = x @ view[:2].T
            low = np.minimum(low, flat.min(axis=0, initial=np.inf))
            high = np.maximum(high, flat.max(axis=0, initial=-np.inf))
    if not np.all(np.isfinite([low, high])):  # nothing is drawn
        low, high = np.zeros(2), np.ones(2)
    return _roomy(low, high, max((drawing.size for drawing, _ in cells), default=1.0))


def _roomy(low: np.ndarray, high: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """A margin around what may be a point, as a line along the view is."""
    less = 0.5 * max(REACH * size - float((high - low).max()), 0.0)
    low, high = low - less, high + less
    margin = 0.03 * float((high - low).max())
    return low - [margin, 0.16 * float((high - low).max())], high + margin


def draw_state(
    axes: Axes, drawing: Drawing, x: Float[np.ndarray, "point 3"], view: np.ndarray, value: np.ndarray | None
) -> None:
    """The lines through the points ``x``, coloured by ``value`` from 0 to 1 at each, grey without it."""
    flat = x @ view[:2].T
    for what in ("cable", *THICK):
        lines = [line for line in drawing.lines if line.what == what]
        if what == "cable":
            if value is not None:
                _stroke(axes, flat, lines, COLOUR["ink"], 0.6, 2.0)
        elif value is None:
            _stroke(axes, flat, lines, COLOUR["ghost"], 0.6 * THICK[what], 1.0, DASHED.get(what, "solid"))
        else:
            for level, parts in _by_level(lines, value).items():
                _stroke(axes, flat, parts, SHADES(level), THICK[what], 3.0, DASHED.get(what, "solid"))
    if value is not None:
        for what, look in MARKS.items():
            at = [mark.point for mark in drawing.marks if mark.what == what]
            if at:
                axes.add_artist(Line2D(*flat[at].T, linestyle="", zorder=4.0, **look))
        for mark in (mark for mark in drawing.marks if any(mark.direction)):
            arrow = 0.1 * drawing.size * np.array(mark.direction) @ view[:2].T
            _arrow(axes, flat[mark.point] - arrow, flat[mark.point], COLOUR["lab"])


def _by_level(lines: Sequence[Any], value: np.ndarray) -> dict[int, list[tuple[int, int]]]:
    """Stretches of the lines by the level of their colour, so that a picture has few paths."""
    found: dict[int, list[tuple[int, int]]] = {}
    for line in lines:
        v = value[line.first : line.last]
        level = np.minimum((0.5 * (v[1:] + v[:-1]) * LEVELS).astype(int), LEVELS - 1)
        cuts = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), len(level)]
        for a, b in pairwise(cuts):
            found.setdefault(int(level[a]), []).append((line.first + a, line.first + b + 1))
    return found


def _stroke(
    axes: Axes, flat: np.ndarray, lines: Sequence[Any], colour: Any, width: float, zorder: float,
    style: Any = "solid",
) -> None:  # fmt: skip
    """All lines as one path."""
    ends = [(line[-2], line[-1]) for line in lines]
    if ends:
        codes = np.concatenate([[Path.MOVETO, *[Path.LINETO] * (b - a - 1)] for a, b in ends])
        path = Path(np.concatenate([flat[a:b] for a, b in ends]), codes)
        path.should_simplify = True  # short ones too: straight members need no points between their ends
        axes.add_artist(PathPatch(path, facecolor="none", edgecolor=colour, linewidth=width, zorder=zorder,
                                 linestyle=style, capstyle="round"))  # fmt: skip


def draw_axes(axes: Axes, drawing: Drawing, view: np.ndarray) -> None:
    """The axes of W and a bar of round length in the lower left corner, gravity beside them."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    span = max(right - left, high - low)
    length = _round_bar(0.25 * span)
    corner = np.array([left + 0.07 * span, low + 0.08 * span])
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        tip = corner + 0.075 * span * view[:2] @ axis
        _arrow(axes, corner, tip, COLOUR["ink"])
        note(axes, name, tip + 0.2 * (tip - corner), (0, 0), fontsize=6.0, ha="center", va="center")
    bar = np.array([left + 0.2 * span, low + 0.025 * span]) + np.outer([0.0, length], [1.0, 0.0])
    axes.plot(*bar.T, color=COLOUR["ink"], linewidth=1.6, solid_capstyle="butt", clip_on=False)
    note(axes, f"{length:g} m", bar.mean(axis=0), (0, 3), fontsize=6.0, ha="center")
    size = float(np.linalg.norm(drawing.gravity))
    if size > 0.0:
        top = np.array([bar[1, 0] + 0.1 * span, low + 0.12 * span])
        _arrow(axes, top, top + 0.1 * span * view[:2] @ drawing.gravity / size, COLOUR["lab"])
        words = f"g {size:.3g} m/s²"
        note(axes, words, top, (4, -8), fontsize=6.0, ha="left", color=COLOUR["lab"])


def _round_bar(x: float) -> float:
    """1, 2 or 5 times a power of ten, no longer than ``x``.

    >>> [_round_bar(x) for x in (0.61, 3.0, 17.0)]
    [0.5, 2.0, 10.0]
    """
    power = 10.0 ** np.floor(np.log10(x))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= x))


def _arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str) -> None:
    axes.annotate(
        "",
        (end[0], end[1]),
        (start[0], start[1]),
        arrowprops=ARROW | {"color": colour},
        annotation_clip=False,
    )
