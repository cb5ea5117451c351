"""``--figure``: a drawing of the result as an SVG file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from middeck.cli.options import FIGURES, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

figure = written("--figure", "figure_file", endings=FIGURES, help="Also draw it, as SVG.")


def write_figure(drawn: Figure, file: str, *, key: str, title: str, description: str) -> None:
    """Write ``drawn`` whole or not at all."""
    from middeck.files.atomic import replacing
    from middeck.plot.svg import svg_text

    text = svg_text(drawn, key=key, title=title, description=description)
    with replacing(file) as temporary:
        temporary.write_text(text, encoding="utf-8")
