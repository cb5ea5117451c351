"""``middeck modes``: rest state and natural modes of an article in an environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from middeck.cli import options
from middeck.cli.screen import Table, show

if TYPE_CHECKING:
    from middeck.structure.modes import Modes

EPILOG = """\
\b
Examples:
  middeck modes articles/mace-simple.toml --environment orbit
  middeck modes articles/mace-dm.toml --set suspension.bounce_hz=0.2 --json
"""


@click.command("modes", epilog=EPILOG)
@options.article
@options.environment
@options.count
@options.common
def verb(article: str, environment: str, count: int, overrides: tuple[str, ...], as_json: bool) -> None:
    """Natural modes of ARTICLE about its rest state in an environment.

    Also the suspension's reactions, the torques that hold the joints, and how far the nodes turn.
    """
    from middeck.cli.cases import solve_case

    modes = solve_case(article, environment, overrides)
    document = describe(modes, count)
    show(as_json, document, *_tables(document))


def describe(modes: Modes, count: int) -> dict[str, Any]:
    """The JSON document."""
    import numpy as np

    from middeck.structure.equilibrium import node_rotations

    rest = modes.equilibrium
    structure, suspension = rest.model.structure, rest.suspension
    devices = [*suspension.attach, *(s.name for s in rest.environment.springs)]
    turned = node_rotations(rest).items()
    return {
        "schema": "middeck.modes/1",
        "article": structure.title,
        "environment": rest.environment.title,
        "mass_kg": structure.mass,
        **mode_list(modes, count),
        "strain_share": modes.strain_share[:count],
        "mode_residual": modes.residual[:count],
        "residual": rest.residual,
        "reactions_n": dict(zip(suspension.attach, suspension.reaction, strict=True)),
        "stiffness_n_per_m": dict(zip(suspension.attach, suspension.stiffness, strict=True)),
        "tension_n": dict(zip(devices, rest.tension, strict=True)),
        "holding_torque_nm": dict(zip((j.name for j in structure.joints), rest.holding_torque, strict=True)),
        "node_rotation_deg": {node: np.degrees(vector) for node, vector in turned},
        "warnings": modes.warnings,
    }


def mode_list(modes: Modes, count: int) -> dict[str, Any]:
    """The keys that every list of modes has."""
    return {
        "frequency_hz": modes.frequency_hz[:count],
        "kind": modes.kind[:count],
        "name": modes.name[:count],
        "rigid_residual": modes.rigid_residual,
    }


def _tables(document: dict[str, Any]) -> list[str | Table]:
    columns = (document[k] for k in ("frequency_hz", "kind", "name", "strain_share"))
    rows = [
        [str(i), f"{f:.5f}", k, n, f"{s:.1%}"] for i, (f, k, n, s) in enumerate(zip(*columns, strict=True))
    ]
    blocks: list[str | Table] = [
        f"mass         {document['mass_kg']:.3f} kg",
        f"article      {document['article']}",
        f"environment  {document['environment']}",
        f"residual     {document['residual']:.1e} of the weight",
        Table("modes", ["", "frequency Hz", "kind", "name", "strain"], rows),
    ]
    if document["reactions_n"]:
        keys = ("reactions_n", "tension_n", "stiffness_n_per_m")
        rows = [[a, *(f"{document[k][a]:.4f}" for k in keys)] for a in document["reactions_n"]]
        headers = ["attach point", "pinned reaction N", "tension N", "stiffness N/m"]
        blocks.append(Table("suspension", headers, rows))
    torques = [[j, f"{t:.5f}"] for j, t in document["holding_torque_nm"].items()]
    turned = [[n, *(f"{a:.5f}" for a in v)] for n, v in document["node_rotation_deg"].items()]
    return [
        *blocks,
        Table("holding torque", ["joint", "N m"], torques),
        Table("rotation vector of the nodes", ["node", "x deg", "y deg", "z deg"], turned),
    ]
