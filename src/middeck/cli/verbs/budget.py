"""``middeck budget``: how much of each mode's shift each effect of gravity makes."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.screen import ScreenTable, case_lines, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.structure.gravity.budget import GravityBudget

EXAMPLES = """\
  middeck budget articles/mace-simple.toml
  middeck budget articles/mace-dm.toml --figure budget.svg --json
"""


@click.command("budget", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.count
@figures.figure
@options.common
def verb(case: options.TypedSetup, count: int, figure_file: str | None, as_json: bool) -> None:
    """Frequency shift of each mode by each effect of gravity.

    Between orbit and an environment, three effects are switched on one at a time, in all six orders:
    suspension, stiffness from internal forces and weight, and static pre-deformation. Prints the mean
    contribution of each to the frequency, and its range over the orders. Clamps and the masses of a load case
    act in orbit too.
    """
    import numpy as np

    from middeck.cli.given.typed_article import read_case, solve_in

    structure, surroundings, *files = read_case(case)
    if not np.any(surroundings.gravity) and not surroundings.hung and not surroundings.springs:
        raise ConfigError(
            "from orbit to orbit there is nothing to budget",
            where="--environment",
            hint="give a laboratory, or an environment file with gravity or springs",
        )
    title = f"{surroundings.title} without gravity" if surroundings.clamps else "orbit"
    floating = dataclasses.replace(md.Environment.orbit(), clamps=surroundings.clamps, title=title)
    orbit = solve_in(structure, floating, files[0], count=count)
    found = md.build_budget(orbit, solve_in(structure, surroundings, *files, count=count), count)
    document = describe(found)
    if figure_file is not None:
        from middeck.plot.budget import budget_figure

        figures.write_figure(
            budget_figure(found),
            figure_file,
            key="budget",
            title=f"Gravity budget of {document['article']}",
            description="Shares of the shift of each mode from 0-g to 1-g by effect.",
        )
    show(as_json, document, *_tables(document))


def describe(found: GravityBudget) -> dict[str, Any]:
    """The JSON document; ``omega2`` has an axis off/on for each of the effects, in their order."""
    from middeck.cli.given.typed_article import both_sides
    from middeck.structure.gravity.budget import EFFECTS, ORDERS

    lab = found.lab
    return {
        "schema": "middeck.budget/1",
        "article": lab.equilibrium.model.structure.title,
        "environment": lab.equilibrium.environment.title,
        "effects": EFFECTS,
        "orders": ORDERS,
        "pairs": found.pairs,
        "name": [lab.name[j] for j in found.pairs[:, 1]],
        "kind_in_orbit": [found.orbit.kind[i] for i in found.pairs[:, 0]],
        **fields(found, "frequency_hz", "shift_hz", "share_hz", "range_hz"),
        "by_order_omega2": found.by_order,
        "omega2": found.corner,
        "match": found.match,
        "doubtful": found.doubtful,
        "warnings": both_sides(found.orbit, lab),
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    spread = (document["range_hz"][:, :, 1] - document["range_hz"][:, :, 0]).max(axis=1)
    doubt = set(document["doubtful"])
    rows = [
        [
            f"{name} *" if m in doubt else name,
            *(f"{f:.4f}" for f in document["frequency_hz"][m]),
            *(f"{x:+z.4f}" for x in (document["shift_hz"][m], *document["share_hz"][m])),
            f"{spread[m]:.4f}",
        ]
        for m, name in enumerate(document["name"])
    ]
    headers = ["", "0-g Hz", "1-g Hz", "shift", "susp.", "stiff.", "deform.", "order"]
    return [
        *case_lines(document),
        ScreenTable("shares of the shift, Hz", headers, rows),
        "\nsusp.: devices, springs to the ground; stiff.: internal forces, weight; deform.: sag."
        "\nShares are means over the six orders of switching and add up to the shift."
        "\norder: widest range of a share over the six orders",
        *(
            ["* with some effects off less than half of the 0-g shape is left: shares are unclear"]
            if doubt
            else []
        ),
    ]
