"""``middeck check``: what an article weighs and measures, and what is wrong or doubtful about it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from middeck.cli import options
from middeck.cli.screen import show

if TYPE_CHECKING:
    from middeck.errors import NumericalError
    from middeck.structure.article import Structure
    from middeck.structure.environment import Environment

EPILOG = """\
\b
Examples:
  middeck check articles/mace-simple.toml
  middeck check articles/mace-simple.toml lab --require
"""
# Of the lowest modes: what is loose or unstable is among them.
COUNT = 40


@click.command("check", epilog=EPILOG)
@options.article
@click.argument("environment", required=False, metavar="[ENVIRONMENT]")
@click.option("--require", is_flag=True, help="End with exit code 1 if anything was found.")
@options.common
def verb(
    article: str, environment: str | None, require: bool, overrides: tuple[str, ...], as_json: bool
) -> None:
    """Weigh and measure ARTICLE; find what is wrong.

    Mass, centre of mass, inertia and size come first, then doubts about units and mesh. With an ENVIRONMENT
    (orbit, lab, or a file) also whether the article comes to rest there, what is loose, and what is unstable.
    Mistakes in the files are errors as everywhere.
    """
    from middeck.cli.blame import reading
    from middeck.cli.cases import find_case
    from middeck.cli.summary import measure_lines, summary_lines, summary_numbers
    from middeck.files.documents import find_document, load_case, load_structure
    from middeck.structure.checks.summary import summarise

    if environment is None:
        files: tuple[Path, ...] = (find_document(article, "article"),)
        structure, surroundings = load_structure(files[0], overrides), None
    else:
        body, around = files = find_case(article, environment)
        structure, surroundings = load_case(body, around, overrides)
    with reading(*files):
        summary = summarise(structure)
    numbers = summary_numbers(summary)
    if not as_json:  # before anything is solved
        show(False, {}, *summary_lines(numbers), *measure_lines(numbers))
    found = [_doubt(text) for text in summary.warnings]
    found += [] if surroundings is None else _in_environment(structure, surroundings)
    document = {
        "schema": "middeck.check/1",
        "article": structure.title,
        "environment": None if surroundings is None else surroundings.title,
        **numbers,
        "sound": not found,
        "findings": found,
    }
    show(as_json, document, *_lines(found))
    if require and found:
        click.get_current_context().exit(1)


def _in_environment(structure: Structure, environment: Environment) -> Iterator[dict[str, Any]]:
    from middeck.errors import NumericalError
    from middeck.structure.equilibrium import solve_equilibrium
    from middeck.structure.modes import solve_modes

    try:
        modes = solve_modes(solve_equilibrium(structure, environment), COUNT)
    except NumericalError as error:
        yield _fault(error)
    else:
        yield from (_doubt(text) for text in modes.warnings)


def _doubt(text: str) -> dict[str, Any]:
    return {"grade": "doubt", "where": "", "what": text, "hint": ""}


def _fault(error: NumericalError) -> dict[str, Any]:
    return {"grade": "fault", "where": error.where, "what": error.what, "hint": error.hint}


def _lines(found: list[dict[str, Any]]) -> list[str]:
    if not found:
        return ["", "nothing found"]
    lines = [""]
    for f in found:
        place = f"{f['where']}: " if f["where"] else ""
        lines.append(f"{f['grade']:<12} {place}{f['what']}")
        lines += [f"             try: {f['hint']}"] if f["hint"] else []
    return lines
