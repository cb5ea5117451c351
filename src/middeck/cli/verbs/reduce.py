"""``middeck reduce``: an article as a reduced component."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, show
from middeck.errors import ConfigError

if TYPE_CHECKING:
    from middeck.structure.modes.craig_bampton import Reduced

EXAMPLES = """\
  middeck reduce articles/mace-simple.toml --boundary n1,n5 --modes 12
  middeck reduce articles/mace-simple.toml --boundary n1 --upto-hz 150 \\
    --residual n3 -o bus.npz --json
"""


@click.command("reduce", cls=options.Verb, examples=EXAMPLES)
@options.article
@options.several(
    "--boundary", metavar="NODES", callback=options.names, help="Nodes that remain; may be repeated."
)
@click.option("--modes", "count", type=click.IntRange(min=0), help="Number of fixed-interface modes.")
@click.option("--upto-hz", type=options.POSITIVE, help="All fixed-interface modes up to this frequency.")
@options.several(
    "--residual",
    metavar="NODES",
    callback=options.names,
    help="Nodes with residual attachment modes; may be repeated.",
)
@options.several(
    "--recover",
    metavar="NODES",
    callback=options.names,
    help="Nodes whose motion can be recovered from the file.",
)
@options.output(
    "target",
    options.COMPONENTS,
    "Write the component, and its matrices and cards for Nastran as .op4, .pch and .asm.",
    "COMPONENT.npz|mat",
)
@options.common
def verb(
    article: str,
    boundary: tuple[str, ...],
    count: int | None,
    upto_hz: float | None,
    residual: tuple[str, ...],
    recover: tuple[str, ...],
    target: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Reduce ARTICLE to a component by Craig and Bampton's method.

    The coordinates are those of the boundary nodes and the lowest modes with the boundary held, about the
    equilibrium in orbit. Modes up to three times the frequency of interest are usual. --residual adds the
    static response of the omitted modes to loads at a node. Angles of free joints are coordinates too, before
    the modal ones.
    """
    from middeck.files.articles.components import write_component
    from middeck.files.nastran.components.external_write import write_external
    from middeck.files.setups import find_document, load_structure

    if target is not None:
        for ending in (".op4", ".pch", ".asm"):
            options.to_write(str(Path(target).with_suffix(ending)), f"-o {target}")
    path = find_document(article, "article")
    structure = load_structure(path, overrides)
    if not boundary or (count is None) == (upto_hz is None):
        raise ConfigError(
            "a reduction needs boundary nodes and a number of modes",
            hint="--boundary, and one of --modes and --upto-hz",
        )
    name = "component" if target is None else Path(target).stem
    with reading(path):
        made = md.reduce_structure(
            structure,
            boundary,
            count=count,
            upto_hz=upto_hz,
            residual=residual,
            recover=recover,
            name=name,
        )
    written: list[str] = []
    if target is not None:
        files = write_external(Path(target).with_suffix(""), made.component)
        write_component(target, made.component)
        written = [target, *map(str, files.values())]
    document = {**describe(made), "article": structure.title, "written": written}
    show(as_json, document, *_blocks(document))


def describe(made: Reduced) -> dict[str, Any]:
    """The JSON document."""
    import numpy as np

    from middeck.structure.model.component import body_of

    whole = body_of(made.component)
    return {
        "schema": "middeck.reduce/1",
        "name": made.component.name,
        "boundary": made.component.grids,
        "fixed_hz": made.fixed_hz,
        "next_hz": made.next_hz if np.isfinite(made.next_hz) else None,
        "residual_vectors": made.residual,
        "free_joints": made.component.modal - len(made.fixed_hz) - made.residual,
        "coordinates": len(made.component.stiffness),
        "mass_kg": whole.mass,
        "centre_m": whole.cg,
        "inertia_kg_m2": whole.inertia,
        "warnings": made.warnings,
    }


def _blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    after = document["next_hz"]
    rows = [[str(i + 1), f"{f:.4f}"] for i, f in enumerate(document["fixed_hz"])]
    return [
        f"article      {document['article']}",
        f"boundary     {', '.join(document['boundary'])}",
        f"coordinates  {document['coordinates']}: {6 * len(document['boundary'])} of the boundary, "
        f"{document['free_joints']} free joints, {len(rows)} modes, "
        f"{document['residual_vectors']} residual vectors",
        f"omitted      modes from {after:.4f} Hz up" if after is not None else "omitted      nothing",
        f"mass         {document['mass_kg']:.6g} kg",
        ScreenTable("modes with the boundary held", ["", "frequency Hz"], rows),
        *(f"wrote {file}" for file in document["written"]),
    ]
