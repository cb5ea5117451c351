"""``middeck compare``: what gravity and suspension do to the modes (Figures 4 and 5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.screen import WITHOUT, ScreenTable, show, without_stiffness

if TYPE_CHECKING:
    from collections.abc import Iterator

    from middeck.structure.gravity.compare_modes import ModeComparison

EXAMPLES = """\
  middeck compare articles/mace-simple.toml --figure shapes.html
  middeck compare articles/mace-dm.toml --set constants.gravity=3.71 --json
"""


CROSS_NOTE = """\
cross-orthogonality: with the mass matrix in orbit, in which the shapes in the
environment have not quite unit modal mass: values slightly above 1 are possible"""


@click.command("compare", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.count
@figures.shapes
@figures.up
@options.common
def verb(
    case: options.TypedSetup, count: int, figure_file: str | None, up: str | None, as_json: bool
) -> None:
    """Compare modes of ARTICLE in orbit and in an environment.

    Prints pairs of flexible modes with frequency ratio, cross-orthogonality and MAC, and the angles between
    the subspaces of rigid-body and suspension modes. Loads, added masses and clamps belong to the
    environment, and orbit has none of them: `middeck budget` keeps clamps and added masses in 0-g too.
    """
    from middeck.cli.given.typed_article import apply_case, read_case, solve_in

    figures.check_up(up, figure_file)
    structure, surroundings, *files = read_case(case._replace(load_case=None))
    orbit = solve_in(structure, md.Environment.orbit(), files[0], count=count)
    lab = solve_in(*apply_case(structure, surroundings, case.load_case, *files), *files, count=count)
    found = md.compare_modes(orbit, lab, count)
    document = describe(found)
    show(as_json, document, *_tables(document))
    if figure_file is not None:
        figures.draw_comparison_to(found, figure_file, document["warnings"], up)


def describe(comparison: ModeComparison) -> dict[str, Any]:
    """The JSON document; keys as in figures 4 and 5 of numbers.json."""
    import numpy as np

    from middeck.cli.given.typed_article import both_sides
    from middeck.structure.modes.motions.left_out_stiffness import felt_stiffness
    from middeck.study.chapters.gravity_modes.numbers import figure_4, figure_5

    orbit, lab = comparison.orbit, comparison.lab
    return {
        "schema": "middeck.compare/1",
        "article": orbit.equilibrium.model.structure.title,
        "environment": lab.equilibrium.environment.title,
        **figure_4(comparison),
        **figure_5(comparison),
        "unpaired": dict(zip(("orbit", "lab"), comparison.unpaired, strict=True)),
        "clamped": sorted({clamp.node for clamp in lab.equilibrium.environment.clamps}),
        "left_out_stiffness": felt_stiffness(lab.equilibrium, lab.omega**2, lab.shapes),
        "gravity_m_s2": float(np.linalg.norm(lab.equilibrium.environment.gravity)),
        "warnings": (
            *both_sides(orbit, lab),
            *comparison.warnings,
            *dict.fromkeys(_without_flexible(comparison)),
        ),
    }


def _without_flexible(comparison: ModeComparison) -> Iterator[str]:
    """Warnings for a side that has nothing to compare: its lowest modes are rigid or suspension modes."""
    clamped = bool(comparison.lab.equilibrium.environment.clamps)
    for modes in (comparison.orbit, comparison.lab):
        lowest = modes.kind[: comparison.count]
        if "flexible" not in lowest:
            title = modes.equilibrium.environment.title
            budget = "; `middeck budget` keeps the clamps in 0-g" if clamped else ""
            yield f"none of the {len(lowest)} lowest modes in {title} is flexible: increase --count{budget}"


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    orbit, lab, environment = document["orbit"], document["lab"], document["environment"]
    cost = document["left_out_stiffness"]
    lists = [
        _others("rigid-body modes in orbit", orbit, [0.0] * len(orbit["kind"])),
        _others(f"suspension modes in {environment}", lab, cost),
    ]
    pairs = [
        [
            str(i),
            f"{orbit['frequency_hz'][i]:.5f}",
            str(j),
            f"{lab['frequency_hz'][j]:.5f}",
            f"{ratio:.5f}",
            f"{document['matrix'][i, j]:.4f}",
            f"{document['mac'][i, j]:.4f}",
            orbit["name"][i],
        ]
        for (i, j), ratio in zip(document["pairs"], document["ratio"], strict=True)
    ]
    titles = ["orbit", "Hz", environment, "Hz", "ratio", "cross-orthogonality", "MAC", "name in orbit"]
    felt = [cost[j] for _, j in document["pairs"]]
    angles = ", ".join(f"{a:.3f}" for a in document["subspace_angle_deg"]) or "none"
    tables = [*lists, without_stiffness(ScreenTable("pairs of flexible modes", titles, pairs), felt)]
    return [
        f"article      {document['article']}",
        f"compared     orbit: free, no gravity; {_held(document)}",
        *(table for table in tables[:2] if table.rows),
        tables[2],
        CROSS_NOTE,
        *([WITHOUT] if any("may be off" in table.headers for table in tables) else []),
        *_unpaired(document),
        f"\nangles between the rigid-body and the suspension subspaces, deg: {angles}",
    ]


def _others(title: str, side: dict[str, Any], cost: Sequence[float]) -> ScreenTable:
    """The modes of one side that are not flexible, each with its number."""
    others = [i for i, kind in enumerate(side["kind"]) if kind != "flexible"]
    rows = [[f"{i}", f"{side['frequency_hz'][i]:.5f}", side["kind"][i], side["name"][i]] for i in others]
    table = ScreenTable(title, ["", "frequency Hz", "kind", "name"], rows)
    return without_stiffness(table, [cost[i] for i in others])


def _held(document: dict[str, Any]) -> str:
    """The environment in words."""
    from middeck.structure.model.connectivity import some_names

    clamped, gravity = document["clamped"], document["gravity_m_s2"]
    clamps = f"clamped at {some_names(clamped)}" if clamped else "not clamped"
    kept = " (`middeck budget` keeps the clamps in 0-g)" if clamped else ""
    weight = f"gravity {gravity:.4g} m/s^2" if gravity else "no gravity"
    return f"{document['environment']}: {clamps}, {weight}{kept}"


def _unpaired(document: dict[str, Any]) -> list[ScreenTable]:
    """Flexible modes of either side that no pair has."""
    rows = [
        [title, str(i), f"{document[side]['frequency_hz'][i]:.5f}", document[side]["name"][i]]
        for side, title in (("orbit", "orbit"), ("lab", document["environment"]))
        for i in document["unpaired"][side]
    ]
    title = "flexible modes without a partner among those compared"
    return [ScreenTable(title, ["in", "mode", "frequency Hz", "name"], rows)] if rows else []
