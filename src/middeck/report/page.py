"""The page: claims first, then each figure beside its sentence with the numbers under it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from middeck.report.drawings import DRAWINGS
from middeck.report.summary import ClaimRow, came_out, does_not_hold, warned, with_unit
from middeck.report.tables import TABLES
from middeck.report.words import Numbers, Table, percent

CLAIMS = {
    "figure_6": "figure-6a",
    "figure_7": "figure-7a",
    "figure_9b": "figure-9b",
    "figure_10b": "figure-10b",
    "figure_11": "figure-11",
    "figure_12": "figure-12a",
}


class Section(NamedTuple):
    """One figure with its sentence and tables."""

    key: str
    title: str
    sentence: str
    svg: Markup
    tables: list[Table]
    warnings: list[str]


def render_page(title: str, numbers: Numbers, drawings: Mapping[str, str]) -> str:
    """The whole report as HTML that needs no other file; ``numbers`` is the document of numbers.json."""
    figures: Numbers = numbers["figures"]
    environment = Environment(
        loader=PackageLoader("middeck.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    claims = claim_rows(figures)
    inputs = dict(numbers["inputs"])
    overrides, seed = inputs.pop("overrides"), inputs.pop("seed")
    return environment.get_template("report.html.j2").render(
        title=title,
        claims=claims,
        came_out=came_out(figures, claims),
        lacking=does_not_hold(figures, claims),
        sections=_sections(figures, drawings),
        versions=numbers["versions"],
        inputs=inputs,
        overrides=overrides,
        seed=seed,
    )


def claim_rows(figures: Numbers) -> list[ClaimRow]:
    """Every claim that a figure of ``figures`` judges, the mirror's outputs last."""
    rows = [
        ClaimRow(
            section,
            row["claim"],
            row["holds"],
            with_unit(row["number"], row["unit"]),
            with_unit(row["asked"], row["unit"]),
        )
        for figure, section in CLAIMS.items()
        if figure in figures
        for row in figures[figure]["claims"]
    ]
    return [*rows, *_mirror_claims(figures)]


def _mirror_claims(figures: Numbers) -> list[ClaimRow]:
    if "mirror" not in figures:
        return []
    mirror = figures["mirror"]
    pairs = zip(mirror["held_out_nrmse"], mirror["published_nrmse"], strict=True)
    return [
        ClaimRow(
            "mirror",
            f"mirror, output {k + 1}: held-out NRMSE no worse than the published {percent(theirs)}",
            ours <= theirs,
            percent(ours),
            f"≤ {percent(theirs)}",
        )
        for k, (ours, theirs) in enumerate(pairs)
    ]


def _sections(figures: Numbers, drawings: Mapping[str, str]) -> list[Section]:
    told = warned(figures)
    return [
        Section(
            d.key,
            d.heading(figures),
            d.sentence(figures),
            Markup(drawings[d.key]),  # our own SVG, whose texts are escaped already
            TABLES[d.key](figures) if d.key in TABLES else [],
            [text for section, text in told if section == d.key],
        )
        for stage in DRAWINGS.values()
        for d in stage
        if d.key in drawings
    ]
