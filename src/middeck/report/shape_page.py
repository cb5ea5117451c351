"""Shapes in one HTML file that moves and turns, needs no other file, and prints as stills."""

import dataclasses
import json
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.colors import to_hex

from middeck.plot.shapes import (
    AZIMUTH,
    ELEVATION,
    LEVELS,
    REACH,
    SHADES,
    Shown,
    label_of,
    legend_words,
    shapes_figure,
    upright,
)
from middeck.plot.svg import svg_text
from middeck.report.templates import TEMPLATES
from middeck.structure.modes.results.article_drawing import Drawing
from middeck.values import record

# Steps of the largest motion, and of the article's size: finer than a pixel.
MOTION_STEPS, PLACE_STEPS = 999, 4999
SHEET = 20  # stills on a printed page
SIGNS = {
    **{"node": "\u25cb", "mass": "\u25cf", "clamp": "\u25a0", "support": "\u25b3", "ground": "\u25c7"},
    **{"force": "\u2192", "moment": "\u2192M", "body": "\u25a1", "component": "\u2504", "link": "\u2508"},
}
"""What stands for each entry of the legend."""


@record(kw_only=True)
class ShapePage:
    """The content of the page.

    Attributes:
        title: Title of the page.
        drawings, sides: Drawings, and what each is called, such as "0-g".
        rows: The shape of every drawing for each choice of mode; None where it has none.
        headers, table: A table of all modes under the pictures.
        warnings: Sentences that stand with it.
        circling: Whether shapes are complex: real parts, then as many imaginary parts, a quarter of a period
            before them.
    """

    title: str
    drawings: tuple[Drawing, ...]
    sides: tuple[str, ...]
    rows: tuple[tuple[Shown | None, ...], ...]
    headers: tuple[str, ...] = ()
    table: tuple[tuple[str, ...], ...] = ()
    warnings: tuple[str, ...] = ()
    circling: bool = False


def render_shapes(page: ShapePage) -> str:
    """The page as HTML; the same bytes for the same shapes."""
    script = resources.files("middeck.report").joinpath("shapes.js").read_text(encoding="utf-8")
    each = SHEET // len(page.drawings)
    stills = [
        _still(dataclasses.replace(page, rows=page.rows[first : first + each]), f"stills-{first}")
        for first in range(0, len(page.rows), each)
    ]
    # A script ends at its first "</", wherever that stands.
    data = json.dumps(_data(page), separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
    return TEMPLATES.get_template("report/shapes.html.j2").render(
        page=page,
        script=Markup(script),
        data=Markup(data),
        stills=[Markup(svg) for svg in stills],
        signs=[(SIGNS[what], words) for what, words in legend_words(page.drawings)],
        reach=REACH,
    )


def _still(page: ShapePage, key: str) -> str:
    titles = page.sides if len(page.drawings) > 1 else ()
    figure = shapes_figure(page.drawings, page.rows, titles)
    return svg_text(figure, key=key, title=page.title, description=describe_rows(page))


def describe_rows(page: ShapePage) -> str:
    """The shapes in words, for whoever does not see them."""
    rows = [[_line(page.drawings[c.drawing], c.shape) for c in row if c is not None] for row in page.rows]
    return "; ".join(" | ".join(row) for row in rows)


def _line(drawing: Drawing, shape: int) -> str:
    """The label of a shape in one line."""
    return label_of(drawing, shape).replace("\n(", " (").replace("\n", ", ")


def _data(page: ShapePage) -> dict[str, Any]:
    base = upright(d.up for d in page.drawings)
    size, rest = max(d.size for d in page.drawings), page.drawings[0].rest
    middle = 0.5 * (rest.max(axis=0) + rest.min(axis=0)) if len(rest) else np.zeros(3)
    return {
        "size": float(f"{size:.4g}"),
        "reach": REACH,
        "steps": [PLACE_STEPS, MOTION_STEPS],
        "axes": np.round(base.T, 6).tolist(),
        "eye": [AZIMUTH, ELEVATION],
        "day": [to_hex(SHADES(i)) for i in range(LEVELS)],
        "night": [to_hex(colormaps["viridis"](x)) for x in np.linspace(0.3, 1.0, LEVELS)],
        "sides": [
            {
                "label": label,
                "gravity": np.round(base @ d.gravity, 4).tolist(),
                "points": _whole((d.rest - middle) @ base.T / size * PLACE_STEPS),
                "lines": [[line.what, line.first, line.last] for line in d.lines],
                "marks": [
                    [mark.what, mark.point, *np.round(base @ mark.direction, 3).tolist()] for mark in d.marks
                ],
            }
            for label, d in zip(page.sides, page.drawings, strict=True)
        ],
        "rows": [[None if c is None else _cell(page, c, base) for c in row] for row in page.rows],
    }


def _cell(page: ShapePage, shown: Shown, base: np.ndarray) -> dict[str, Any]:
    drawing = page.drawings[shown.drawing]
    motion = drawing.motion[shown.shape]
    before = drawing.motion[shown.shape + len(drawing.number) // 2] if page.circling else 0.0 * motion
    largest = max(float(np.linalg.norm(np.hstack([motion, before]), axis=1).max(initial=0.0)), 1e-300)
    return {
        "text": _line(drawing, shown.shape),
        "hz": float(f"{drawing.frequency_hz[shown.shape]:.5g}"),
        "motion": _whole(shown.sign * motion @ base.T / largest * MOTION_STEPS),
        "quarter": _whole(before @ base.T / largest * MOTION_STEPS) if page.circling else None,
        "strain": _whole(100.0 * drawing.strain[shown.shape]),
    }


def _whole(values: np.ndarray) -> list[int]:
    return np.rint(values).astype(int).ravel().tolist()
