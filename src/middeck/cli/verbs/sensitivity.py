"""``middeck sensitivity``: derivatives of frequencies and of the rest state in named numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from middeck.cli import options
from middeck.cli.screen import Table, show

if TYPE_CHECKING:
    from middeck.structure.modes import Modes
    from middeck.structure.sensitivity.frequencies import FrequencySensitivities
    from middeck.structure.sensitivity.rest import RestSensitivities

EPILOG = """\
\b
Examples:
  middeck sensitivity articles/mace-dm.toml \\
    --parameter "node.*.mass,members.E" --parameter environment.bounce_hz
  middeck sensitivity articles/mace-dm.toml --environment orbit \\
    --parameter "joint.*" --count 20 --json
"""


@click.command("sensitivity", epilog=EPILOG)
@options.article
@options.environment
@click.option(
    "--parameter",
    "patterns",
    multiple=True,
    required=True,
    metavar="NAME",
    help="Number to differentiate by, * for any text; may be repeated.",
)
@click.option(
    "--count", type=click.IntRange(min=1), default=12, show_default=True, help="How many of the lowest modes."
)
@options.common
def verb(
    article: str,
    environment: str,
    patterns: tuple[str, ...],
    count: int,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Derivatives of frequencies and of the rest state of ARTICLE.

    Exact, with the shift of the rest state and the tuning of the suspension included. Parameters are named
    by part and field, as in node.n1.cg.y, member.n1-n2.EI_y, joint.pri_x.angle, environment.gravity.y.
    """
    from middeck.cli.blame import reading
    from middeck.cli.cases import find_case, solve_case
    from middeck.structure.sensitivity.frequencies import differentiate_frequencies
    from middeck.structure.sensitivity.parameters import find_parameters
    from middeck.structure.sensitivity.rest import differentiate_rest

    modes = solve_case(article, environment, overrides)
    rest = modes.equilibrium
    with reading(*find_case(article, environment)):
        names = options.separate_names(patterns)
        parameters = find_parameters(rest.model.structure, rest.environment, names)
        by_rest = differentiate_rest(rest, parameters)
        by_modes = differentiate_frequencies(modes, parameters, count)
    document = describe(modes, by_modes, by_rest)
    show(as_json, document, *_tables(document))


def describe(modes: Modes, found: FrequencySensitivities, rest: RestSensitivities) -> dict[str, Any]:
    """The JSON document; a derivative that does not exist (of omega at zero) is null."""
    import numpy as np

    equilibrium = modes.equilibrium
    joints = [j.name for j in equilibrium.model.structure.joints]
    relative = found.relative
    parameters = [
        {
            "name": p.name,
            "unit": p.unit,
            "value": p.value,
            "d_lambda": found.d_lambda[i],
            "d_hz": [float(d) if np.isfinite(d) else None for d in found.d_hz[i]],
            "relative": [float(d) if np.isfinite(d) else None for d in relative[i]],
            "d_reactions_n": dict(zip(equilibrium.suspension.name, rest.reaction[:, i], strict=True)),
            "d_tension_n": dict(zip(equilibrium.devices, rest.tension[:, i], strict=True)),
            "d_holding_torque_nm": dict(zip(joints, rest.holding_torque[:, i], strict=True)),
        }
        for i, p in enumerate(found.parameters)
    ]
    return {
        "schema": "middeck.sensitivity/1",
        "article": equilibrium.model.structure.title,
        "environment": equilibrium.environment.title,
        "frequency_hz": found.frequency_hz,
        "name": modes.name[: len(found.frequency_hz)],
        "groups": [list(group) for group in found.groups],
        "parameters": parameters,
        "warnings": modes.warnings,
    }


def _tables(document: dict[str, Any]) -> list[str | Table]:
    """One table a parameter would be long, one column a mode too wide: a row for both."""
    parameters = document["parameters"]
    rows = [
        [
            p["name"],
            f"{p['value']:g}",
            p["unit"],
            str(m),
            f"{hz:.5f}",
            f"{p['d_hz'][m]:+.5e}",
            f"{share:+.4f}",
        ]
        for p in parameters
        for m, hz in enumerate(document["frequency_hz"])
        if (share := p["relative"][m]) is not None
    ]
    headers = ["parameter", "value", "unit", "mode", "Hz", "dHz per unit", "dlnf/dlnp"]
    return [
        f"article      {document['article']}",
        f"environment  {document['environment']}",
        Table("derivatives of the frequencies", headers, rows),
    ]
