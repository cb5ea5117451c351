"""The page: results and what does not hold on one screen, then each figure with its sentence and numbers."""

from collections.abc import Iterator, Mapping
from typing import Any

from markupsafe import Markup

from middeck.report.templates import TEMPLATES
from middeck.study.chapter import Chapter
from middeck.study.mission import CHAPTERS
from middeck.study.words import Line, Numbers, significant
from middeck.values import record


def render_page(title: str, numbers: Numbers, drawings: Mapping[str, str], *, account: str | None) -> str:
    """The whole report as HTML that needs no other file; ``numbers`` is the document of numbers.json.

    The claims and assumptions are those of a published ``account``; without one there are none.
    """
    figures: Numbers = numbers["figures"]
    sections = [drawing for chapter in chapters_of(figures) for drawing in chapter.drawings]
    headings = {d.key: d.heading(figures, numbered=account is not None) for d in sections}
    claims = claim_rows(figures) if account else []
    inputs = dict(numbers["inputs"])
    overrides, seed = inputs.pop("overrides"), inputs.pop("seed")
    return TEMPLATES.get_template("report/report.html.j2").render(
        title=title,
        account=account,
        claims=claims,
        came_out=came_out(figures, claims),
        lacking=does_not_hold(figures, claims),
        figures=figures,
        sections=sections,
        headings=headings,
        short={key: key.replace("-", " ") if account else heading for key, heading in headings.items()},
        svg={key: Markup(svg) for key, svg in drawings.items()},  # our own, whose texts are escaped already
        warnings=warned(figures),
        versions=numbers["versions"],
        inputs=inputs,
        overrides=overrides,
        seed=seed,
    )


@record(kw_only=True)
class ClaimRow:
    """One row of the claims: where it is shown, what is claimed, whether it holds, its number and limit."""

    section: str
    claim: str
    holds: bool
    number: str
    asked: str


def chapters_of(figures: Numbers) -> list[Chapter[Any]]:
    """The chapters whose numbers are in ``figures``."""
    return [chapter for chapter in CHAPTERS if all(e.key in figures for e in chapter.entries)]


def claim_rows(figures: Numbers) -> list[ClaimRow]:
    """Every claim that a chapter judges."""
    return [
        ClaimRow(
            section=entry.claims_at,
            claim=row["claim"].removesuffix(f" [{row['unit']}]"),  # which stands with the number
            holds=row["holds"],
            number=with_unit(row["number"], row["unit"]),
            asked=with_unit(row["asked"], row["unit"]),
        )
        for chapter in chapters_of(figures)
        for entry in chapter.entries
        for row in entry.claims(figures[entry.key])
    ]


def warned(figures: Numbers) -> list[Line]:
    """Every warning that stands anywhere in ``figures``; one that several entries share, once."""
    found: dict[str, str] = {}
    for entry in (e for chapter in chapters_of(figures) for e in chapter.entries):
        for text in _warnings(figures[entry.key]):
            found.setdefault(text, entry.warnings_at)
    return [Line(text, section) for text, section in found.items()]


def _warnings(numbers: object) -> Iterator[str]:
    if isinstance(numbers, dict):
        for key, value in numbers.items():
            yield from value if key == "warnings" else _warnings(value)
    elif isinstance(numbers, list):
        for value in numbers:
            if isinstance(value, dict | list):  # most are numbers, hundreds of thousands
                yield from _warnings(value)


def came_out(figures: Numbers, claims: list[ClaimRow]) -> list[Line]:
    """The result of each chapter that was run."""
    held = [Line(f"{sum(row.holds for row in claims)} of {len(claims)} claims hold.", "claims")]
    results = [c.result(figures) for c in chapters_of(figures) if c.result is not None]
    return [*(held if claims else []), *results]


def does_not_hold(figures: Numbers, claims: list[ClaimRow]) -> list[Line]:
    """Claims that fail, what else the chapters report, and what warns."""
    lines = [
        Line(f"{row.claim}: {row.number}, required {row.asked}.", row.section)
        for row in claims
        if not row.holds
    ]
    for chapter in chapters_of(figures):
        lines += chapter.shortfalls(figures)
    warnings = warned(figures)
    if warnings:
        many = "s" if len(warnings) > 1 else ""
        text = f"{len(warnings)} warning{many}, listed below the figures."
        lines.append(Line(text, warnings[0].section))
    return lines


def with_unit(value: float | str | None, unit: str) -> str:
    """A number of a claim and its unit.

    >>> with_unit(-4.4861, "dB"), with_unit(None, "dB"), with_unit(3.0, "")
    ('−4.486 dB', '–', '3')
    >>> with_unit("any", "%"), with_unit("> 1, or never", "decades")
    ('any', '> 1 decades, or never')
    """
    if value in (None, "", "any"):
        return significant(value)
    number, other, never = significant(value).partition(", or ")
    return f"{number} {unit}".rstrip() + other + never
