"""``--figure``: a drawing of the result, in the form that the file's ending asks for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli.options import FIGURES, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from middeck.plot.shapes import Shown
    from middeck.report.shape_page import ShapePage
    from middeck.structure.correlation.correlate import Correlation
    from middeck.structure.gravity.compare_modes import ModeComparison
    from middeck.structure.plants.whirl_modes import GyroscopicModes

SHAPES = (*FIGURES, ".html")
MODES = (*SHAPES, ".vtu")
MOVES = "Also draw the shapes; .html is an animated page"
figure = written("--figure", "figure_file", endings=FIGURES, help="Also draw a figure of the result.")
shapes = written("--figure", "figure_file", endings=SHAPES, help=f"{MOVES}.")
mode_shapes = written("--figure", "figure_file", endings=MODES, help=f"{MOVES}, .vtu is for ParaView.")
up = click.option(
    "--up", type=click.Choice(["x", "y", "z"]),
    help="World axis that figures draw upwards.  [default: against gravity or its direction, else y]",
)  # fmt: skip
PNG_DPI = 150


def check_up(up: str | None, file: str | None) -> None:
    """Fail for an upward axis without a figure, or with a file in the world's own axes."""
    if up is not None and file is None:
        raise click.UsageError(
            f"--up {up} turns what --figure draws, and there is no --figure; the direction of gravity is "
            "gravity_direction in the [constants] of the environment"
        )
    if up is not None and Path(str(file)).suffix.lower() == ".vtu":
        raise click.UsageError(f"--up {up} turns pictures, but a .vtu file has the axes of the world")


def write_figure(drawn: Figure, file: str, *, key: str, title: str, description: str) -> None:
    """Write ``drawn`` whole or not at all, in the form of the file's ending; no date, no versions."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    from middeck.files.disk.atomic import replacing
    from middeck.plot.style import house_style
    from middeck.plot.svg import svg_text

    with replacing(file) as temporary, house_style():
        match Path(file).suffix.lower():
            case ".png":
                words: dict[str, Any] = {"Software": None, "Title": title, "Description": description}
                drawn.set_dpi(PNG_DPI)
                FigureCanvasAgg(drawn).print_png(temporary, metadata=words)
            case ".pdf":
                words = {"Creator": None, "Producer": None, "CreationDate": None, "Title": title}
                FigureCanvasPdf(drawn).print_pdf(temporary, metadata=words)
            case _:
                text = svg_text(drawn, key=key, title=title, description=description)
                temporary.write_text(text, encoding="utf-8", newline="\n")


def draw_modes_to(
    modes: md.Modes, count: int, file: str, table: Sequence[Sequence[str]], up: str | None
) -> None:
    """The lowest ``count`` shapes; those of rigid-body modes only if there are no others."""
    lowest = range(min(count, len(modes.omega)))
    shown = [i for i in lowest if modes.kind[i] != "rigid"] or lowest
    drawing = _upright(md.structure.build_mode_drawing(modes, shown), up)
    _draw_listed(drawing, len(shown), file, table, modes.warnings)


def draw_whirls_to(found: GyroscopicModes, file: str, table: Sequence[Sequence[str]], up: str | None) -> None:
    """Shapes at the wheels' speeds: a page moves through both parts of them, a still shows the real part."""
    moving = [i for i, kind in enumerate(found.kind) if kind != "rigid"]
    drawing = _upright(
        md.structure.build_mode_drawing(found.parts, [*moving, *(len(found.kind) + i for i in moving)]), up
    )
    drawing = dataclasses.replace(drawing, alike=(1,) * len(drawing.number))
    _draw_listed(
        drawing, len(moving), file, table, (*found.standstill.warnings, *found.warnings), spinning=True
    )


def _draw_listed(
    drawing: md.structure.Drawing,
    count: int,
    file: str,
    table: Sequence[Sequence[str]],
    warnings: Sequence[str],
    *,
    spinning: bool = False,
) -> None:
    """The first ``count`` shapes of one drawing, above their table, whose first row has the headers."""
    from middeck.files.exchange.vtu import write_vtu
    from middeck.plot.shapes import Shown
    from middeck.report.shape_page import ShapePage

    if file.lower().endswith(".vtu"):
        write_vtu(file, drawing)
        return
    page = ShapePage(
        title=f"Modes of {drawing.title} in {drawing.environment}{', wheels spinning' if spinning else ''}",
        drawings=(drawing,),
        sides=("",),
        rows=tuple((Shown(0, i),) for i in range(count)),
        headers=tuple(table[0]),
        table=tuple(tuple(row) for row in table[1:]),
        warnings=tuple(warnings),
        circling=spinning,
    )
    _write_shapes(page, file)


def draw_comparison_to(
    comparison: ModeComparison, file: str, warnings: Sequence[str], up: str | None
) -> None:
    """Pairs of flexible modes side by side with the sign that makes them alike; then modes without a pair."""
    from middeck.report.shape_page import ShapePage

    orbit, lab, pairs = comparison.orbit, comparison.lab, comparison.pairs
    alone = [j for j in range(comparison.count) if j not in pairs[:, 1] and lab.kind[j] != "rigid"]
    place = lab.equilibrium.environment.title
    sides = (
        md.structure.build_mode_drawing(orbit, pairs[:, 0].tolist()),
        md.structure.build_mode_drawing(lab, [*pairs[:, 1].tolist(), *alone]),
    )
    sides = (dataclasses.replace(sides[0], up=sides[1].up), sides[1])  # 0-g lies as the other hangs
    page = ShapePage(
        title=f"Modes of {orbit.equilibrium.model.structure.title} in 0-g and in {place}",
        drawings=tuple(_upright(side, up) for side in sides),
        sides=("0-g", place),
        rows=_pair_rows(comparison, len(alone)),
        warnings=tuple(warnings),
    )
    _write_shapes(page, file)


def draw_survey_to(found: Correlation, file: str) -> None:
    """Pairs of measured mode and mode of the model with the sign that makes them alike; then those alone."""
    from middeck.plot.shapes import Shown
    from middeck.report.shape_page import ShapePage
    from middeck.structure.correlation.measured_modes import real_shapes, sensor_rows
    from middeck.structure.correlation.survey_drawing import build_survey_drawing

    modes, measured, pairs = found.modes, found.measured, found.pairs
    seen = sensor_rows(modes, measured.node, measured.direction) @ modes.shapes
    alike = [real_shapes(measured)[:, j] @ seen[:, i] for i, j in pairs]
    rows = [
        (Shown(0, int(j)), Shown(1, p, -1.0 if alike[p] < 0.0 else 1.0)) for p, (_, j) in enumerate(pairs)
    ]
    drawings = (
        build_survey_drawing(modes, measured),
        md.structure.build_mode_drawing(modes, pairs[:, 0].tolist()),
    )
    page = ShapePage(
        title=f"Measured modes beside those of {drawings[1].title} in {drawings[1].environment}",
        drawings=drawings,
        sides=("test", "model"),
        rows=(*rows, *((Shown(0, j), None) for j in found.unpaired)),
        warnings=found.warnings,
    )
    _write_shapes(page, file)


def _upright(drawing: md.structure.Drawing, up: str | None) -> md.structure.Drawing:
    """The drawing with a world axis upwards, by its letter, if one is given."""
    import numpy as np

    return drawing if up is None else dataclasses.replace(drawing, up=np.eye(3)["xyz".index(up)])


def _pair_rows(comparison: ModeComparison, alone: int) -> tuple[tuple[Shown | None, Shown], ...]:
    from middeck.plot.shapes import Shown
    from middeck.structure.gravity.turned_modes import modes_at_rest

    lab, pairs = comparison.lab, comparison.pairs
    orbit, _ = modes_at_rest(comparison.orbit, lab)
    alike = [float(orbit.shapes[:, i] @ (orbit.mass @ lab.shapes[:, j])) for i, j in pairs]
    held = [(None, Shown(1, len(pairs) + k)) for k in range(alone)]
    paired = [(Shown(0, p), Shown(1, p, -1.0 if value < 0.0 else 1.0)) for p, value in enumerate(alike)]
    return (*paired, *held)


def _write_shapes(page: ShapePage, file: str) -> None:
    from middeck.files.disk.atomic import write_text
    from middeck.plot.shapes import first_panels, shapes_figure
    from middeck.report.shape_page import describe_rows, render_shapes

    if file.lower().endswith(".html"):
        write_text(Path(file), render_shapes(page))
        return
    rows, left_out = first_panels(page.rows)
    page = dataclasses.replace(page, rows=tuple(tuple(row) for row in rows))
    titles = page.sides if len(page.drawings) > 1 else ()
    drawn = shapes_figure(page.drawings, page.rows, titles, left_out)
    write_figure(drawn, file, key="shapes", title=page.title, description=describe_rows(page))


def write_promise(promise: Mapping[str, Any], came: Mapping[tuple[str, str], Any], file: str) -> None:
    """Draw the first environment of a promise, and the verdicts on it by their kinds and names."""
    from middeck.plot.promises import promise_figure

    place = promise["environments"][0]
    title = f"Promised in {place['name']} on {promise['date']}{'; dots: what came' if came else ''}"
    drawn = promise_figure(place, promise.get("shares", []), came, title)
    write_figure(
        drawn, file, key="promise", title=title, description="Promised intervals, and what came within them."
    )
