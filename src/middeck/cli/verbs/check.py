"""``middeck check``: mass, size and faults of an article, and warnings about it."""

from __future__ import annotations

from typing import Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import show
from middeck.errors import NumericalError
from middeck.study.words import fields

EXAMPLES = """\
  middeck check articles/mace-simple.toml
  middeck check articles/mace-simple.toml lab --require
"""
# Number of lowest modes examined: loose and unstable ones are among them.
COUNT = 40


@click.command("check", cls=options.Verb, examples=EXAMPLES)
@options.article
@click.argument("environment", required=False, metavar="[ENVIRONMENT]")
@click.option("--require", is_flag=True, help="End with exit code 1 if anything was found.")
@options.load_case
@options.common
def verb(
    article: str,
    environment: str | None,
    load_case: str | None,
    require: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Mass, size and plausibility of ARTICLE.

    Prints mass, centre of mass, inertia and size, then warnings about units and mesh. With an ENVIRONMENT
    (orbit, lab, or a file) it also examines the rest state: attitude, unrestrained attach points and
    directions, loose joints and instability. Mistakes in the files are errors, as everywhere.
    """
    from middeck.cli.given.typed_article import apply_case, read_case
    from middeck.cli.shown.mass_and_attitude import (
        attitude_lines,
        measure_lines,
        summary_lines,
        summary_numbers,
    )
    from middeck.files.setups import find_document, load_structure
    from middeck.structure.assembly.linked import check_links
    from middeck.structure.assembly.mesh import mesh_structure
    from middeck.structure.summary.summary import summarise

    if environment is None:
        files = [find_document(article, "article")]
        structure, surroundings = load_structure(files[0], overrides), None
        structure, _ = apply_case(structure, md.Environment.orbit(), load_case, *files)
    else:
        structure, surroundings, *files = read_case(
            options.TypedSetup(article, environment, overrides, load_case)
        )
    with reading(*files):
        summary = summarise(structure)
        check_links(mesh_structure(structure))
    numbers = summary_numbers(summary)
    if not as_json:  # before anything is solved
        show(False, {}, *summary_lines(numbers), *measure_lines(numbers))
    found = [_doubt(text) for text in summary.warnings]
    attitude = None
    if surroundings is not None:
        attitude, more = _in_environment(structure, surroundings)
        found += more
    document = {
        "schema": "middeck.check/1",
        "article": structure.title,
        "environment": None if surroundings is None else surroundings.title,
        **numbers,
        "attitude": attitude,
        "sound": not found,
        "findings": found,
    }
    show(as_json, document, *([] if attitude is None else attitude_lines(attitude)), *_lines(found))
    if require and found:
        click.get_current_context().exit(1)


def _in_environment(
    structure: md.Structure, environment: md.Environment
) -> tuple[dict[str, Any] | None, list[dict[str, Any]]]:
    """Attitude of the article (None in orbit, clamped, or without a rest state), and the findings."""
    import numpy as np

    from middeck.cli.shown.mass_and_attitude import attitude_numbers
    from middeck.structure.hanging.support_warnings import warnings_on_attitude, warnings_on_devices
    from middeck.structure.summary.environment_plausibility import warnings_on_environment

    numbers = None
    found = [_doubt(text) for text in warnings_on_environment(structure, environment)]
    found += [_doubt(d.what, d.where, d.hint) for d in warnings_on_devices(structure, environment)]
    try:
        rest = md.solve_equilibrium(structure, environment)
        if rest.converged and np.any(environment.gravity) and not environment.clamps:
            attitude = md.structure.estimate_attitude(rest)
            numbers = attitude_numbers(attitude)
            found += [_doubt(d.what, d.where, d.hint) for d in warnings_on_attitude(attitude, environment)]
        modes = md.solve_modes(rest, COUNT, standstill=True)
        found += [_doubt(text) for text in modes.warnings]
    except NumericalError as error:
        found.append({"grade": "fault", **fields(error, "where", "what", "hint")})
    return numbers, found


def _doubt(what: str, where: str = "", hint: str = "") -> dict[str, Any]:
    return {"grade": "doubt", "where": where, "what": what, "hint": hint}


WORD = {"doubt": "warning", "fault": "fault"}


def _lines(found: list[dict[str, Any]]) -> list[str]:
    if not found:
        return ["", "nothing found"]
    lines = [""]
    for f in found:
        place = f"{f['where']}: " if f["where"] else ""
        lines.append(f"{WORD[f['grade']]:<12} {place}{f['what']}")
        lines += [f"             try: {f['hint']}"] if f["hint"] else []
    return lines
