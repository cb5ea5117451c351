"""``middeck level``: the attach points at which an article hangs level."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, case_lines, show
from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.structure.hanging.levelling import Levelling

EXAMPLES = """\
  middeck level articles/mace-simple.toml --free n1.z --about x \\
    --set suspension.offsets.0.2=0
  middeck level articles/mace-simple.toml --free n1.z,n3.z,n5.z \\
    --about x --json
"""


@click.command("level", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.several(
    "--free",
    "offsets",
    metavar="ATTACH.AXIS",
    required=True,
    callback=options.names,
    help="Offset that may change, in the axes of its frame; may be repeated.",
)
@options.several(
    "--about", metavar="AXES", help="Axes of the tilts to remove, of x, y, z.  [default: both level axes]"
)
@click.option("--node", metavar="NAME", help="Level this node.  [default: the best-fit rigid body]")
@options.defaulted("--limit", default=0.1, type=options.POSITIVE, help="Largest change of an offset [m].")
@figures.figure
@options.common
def verb(
    case: options.TypedSetup,
    offsets: tuple[str, ...],
    about: tuple[str, ...],
    node: str | None,
    limit: float,
    figure_file: str | None,
    as_json: bool,
) -> None:
    """Move attach points of ARTICLE until it hangs level.

    Prints the attitude before and after, and the new offsets under their keys in the article's file, as --set
    takes them. The file is not changed. The exit code is 5 if these offsets cannot level the article.
    """
    from middeck.cli.given.typed_article import case_warnings, read_case
    from middeck.files.setups import load_offset_keys

    structure, surroundings, *files = read_case(case)
    axes = "".join(about).replace(",", "") if about else None
    free = [split_offset(text) for text in offsets]
    with reading(*files):
        found = md.level(structure, surroundings, free=free, about=axes, node=node, limit=limit)
    document = {
        **describe(found, load_offset_keys(*files, case.overrides)),
        "warnings": case_warnings(structure, surroundings, *files),
    }
    if figure_file is not None:
        _draw(structure, found, figure_file)
    show(as_json, document, *_blocks(document))


def _draw(structure: md.Structure, found: Levelling, file: str) -> None:
    """Drawing of the attitudes before and after, in one scale."""
    from middeck.plot.shapes import rest_figure
    from middeck.structure.modes.results.article_drawing import build_rest_drawing

    before = md.solve_equilibrium(structure, found.equilibrium.environment)
    moved = ", ".join(
        f"{n}.{a} {1e3 * by:+.1f} mm" for (n, a), by in zip(found.moved, found.change, strict=True)
    )
    drawn = [build_rest_drawing(rest) for rest in (before, found.equilibrium)]
    figures.write_figure(
        rest_figure(drawn, ["before", f"after {moved}"]),
        file,
        key="level",
        title=f"{found.structure.title}: rest before and after levelling",
        description=f"Rest states, displacements exaggerated; moved: {moved}.",
    )


def split_offset(text: str) -> tuple[str, str]:
    """Attach point and axis; fails where there is no axis.

    >>> split_offset("n1.z")
    ('n1', 'z')
    """
    name, dot, axis = text.rpartition(".")
    if not dot or not name:
        hint = "the name of an attach point and x, y or z, as in n1.z"
        raise ConfigError(f"no offset {text!r}", where="--free", hint=hint)
    return name, axis


def describe(found: Levelling, keys: dict[str, str]) -> dict[str, Any]:
    """The JSON document."""
    import numpy as np

    from middeck.cli.shown.mass_and_attitude import attitude_numbers

    moved = {name for name, _ in found.moved}
    return {
        "schema": "middeck.level/1",
        "article": found.structure.title,
        "environment": found.equilibrium.environment.title,
        "before": attitude_numbers(found.before),
        "after": attitude_numbers(found.after),
        "change_m": {f"{n}.{a}": by for (n, a), by in zip(found.moved, found.change, strict=True)},
        "offsets": {keys[p.name]: p.offset for p in found.structure.attach_points if p.name in moved},
        "history_deg": np.degrees(found.history),
    }


def _blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    from middeck.cli.shown.mass_and_attitude import attitude_lines

    rows = [[name, f"{1e3 * by:+z.3f}"] for name, by in document["change_m"].items()]
    keys = [f"{key}={_toml(offset)}" for key, offset in document["offsets"].items()]
    return [
        *case_lines(document),
        *attitude_lines(document["before"], "before"),
        *attitude_lines(document["after"], "after"),
        ScreenTable("moved", ["attach point", "mm"], rows),
        "",
        "new offsets, for the article's file or for --set",
        *keys,
    ]


def _toml(offset: Any) -> str:
    """To the tenth of a micrometre, far below what anybody adjusts and what a degree of tilt needs."""
    return "[" + ", ".join(repr(round(float(x), 7) + 0.0) for x in offset) + "]"
