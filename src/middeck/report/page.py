"""The page: claims first, then each figure beside its sentence with the numbers under it."""

from __future__ import annotations

from collections.abc import Mapping

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from middeck.report.first_screen import came_out, chapters_of, claim_rows, does_not_hold, warned
from middeck.study.words import Numbers


def render_page(title: str, numbers: Numbers, drawings: Mapping[str, str], *, account: str | None) -> str:
    """The whole report as HTML that needs no other file; ``numbers`` is the document of numbers.json.

    The claims and assumptions are those of a published ``account``; without one there are none.
    """
    figures: Numbers = numbers["figures"]
    environment = Environment(
        loader=PackageLoader("middeck", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    sections = [drawing for chapter in chapters_of(figures) for drawing in chapter.drawings]
    headings = {d.key: d.heading(figures, numbered=account is not None) for d in sections}
    claims = claim_rows(figures) if account else []
    inputs = dict(numbers["inputs"])
    overrides, seed = inputs.pop("overrides"), inputs.pop("seed")
    return environment.get_template("report/report.html.j2").render(
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
