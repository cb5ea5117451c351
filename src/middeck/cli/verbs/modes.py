"""``middeck modes``: rest state and natural modes of an article in an environment."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import WITHOUT, ScreenTable, case_lines, show, without_stiffness
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.structure.plants.whirl_modes import GyroscopicModes
    from middeck.structure.summary.summary import Summary

EXAMPLES = """\
  middeck modes articles/mace-simple.toml --figure modes.html -o shapes.unv
  middeck modes articles/mace-dm.toml --set suspension.bounce_hz=0.2 --json
"""
# What the document says of modes one by one.
OF_MODES = (
    *("frequency_hz", "damping", "kind", "name", "rigid_share", "strain_share", "most_strained"),
    *("mesh_error", "left_out_stiffness", "mode_residual", "residual"),
)
# What a joint of each state is held by at rest: `JointState`, which --help must not import.
HELD_BY = {"free": "motor", "sprung": "spring", "locked": "lock", "driven": "servo"}
SETTLED = "nothing"  # a hinge, which is a sprung joint without stiffness


@click.command("modes", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.count
@figures.mode_shapes
@figures.up
@options.output(
    "shapes_file",
    options.SURVEYS,
    "Write the flexible shapes at every node, as a survey that correlate reads.",
    "SHAPES.unv|json",
)
@options.common
def verb(
    case: options.TypedSetup,
    count: int,
    figure_file: str | None,
    up: str | None,
    shapes_file: str | None,
    as_json: bool,
) -> None:
    """Natural modes of ARTICLE at rest in an environment.

    Prints mass, centre of mass and inertia, the modes, the reactions of suspension and clamps, the motor
    torques at the joints, and the displacement and rotation of the nodes. Masses of an applied load case are
    included in the article's mass. With spinning wheels the modes are forward and backward whirl at the
    wheels' speeds; the modes at standstill follow.
    """
    from middeck.cli.given.typed_article import read_case, solve_in
    from middeck.cli.shown.mass_and_attitude import summary_lines, summary_numbers
    from middeck.structure.summary.summary import summarise

    figures.check_up(up, figure_file)
    structure, surroundings, *files = read_case(case)
    with reading(*files):
        summary = summarise(structure)
    if not as_json:  # at once: what is wrong with it shows here, whatever becomes of the solution
        show(False, {"warnings": summary.warnings}, *summary_lines(summary_numbers(summary)))
    modes = solve_in(structure, surroundings, *files, count=count, standstill=True)
    document = describe(modes, count, summary)
    later = [w for w in document["warnings"] if w not in summary.warnings]
    shown = document if as_json else {**document, "warnings": later}
    show(as_json, shown, *_tables(document))
    if shapes_file is not None:
        _write_shapes(modes, count, shapes_file)
    if figure_file is not None and surroundings.spins:
        figures.draw_whirls_to(_whirls(modes, count)[0], figure_file, _whirl_rows(document), up)
    elif figure_file is not None:
        figures.draw_modes_to(modes, count, figure_file, _page_rows(document), up)


def _write_shapes(modes: md.Modes, count: int, file: str) -> None:
    """Motions of nodes, inside components too: a universal file has no place for the angle of a joint."""
    from middeck.structure.correlation.measured_modes import AXES, channels_inside, measure_modes

    if modes.equilibrium.environment.spins:
        hint = "an environment whose wheels stand still"
        raise ConfigError("shapes of modes that whirl are not written yet", where=file, hint=hint)
    structure = modes.equilibrium.model.structure
    at = [(node.name, way) for node in structure.nodes for way in AXES]
    at += channels_inside(modes.equilibrium.model)
    flexible = [i for i, kind in enumerate(modes.kind[:count]) if kind != "rigid"]
    md.files.write_measured_modes(file, measure_modes(modes, at, chosen=flexible), structure)


def describe(modes: md.Modes, count: int, summary: Summary) -> dict[str, Any]:
    """The JSON document; keys as in numbers.json."""
    import numpy as np

    from middeck.cli.shown.mass_and_attitude import summary_numbers
    from middeck.files.json.results import mode_numbers, most_strained, rest_numbers
    from middeck.structure.modes.mesh_error import estimate_mesh_error
    from middeck.structure.modes.motions.left_out_stiffness import felt_stiffness
    from middeck.structure.rest.equilibrium import node_shifts, rest_imbalance

    zeta, damping_warnings = _damping(modes, count)
    rest = modes.equilibrium
    suspension, environment = rest.suspension, rest.environment
    joints = [j for j in rest.model.structure.joints if j.state.value in HELD_BY]  # no modal coordinates
    document = {
        "schema": "middeck.modes/1",
        "article": rest.model.structure.title,
        "environment": environment.title,
        **summary_numbers(summary),
        **mode_numbers(modes, count),
        "warnings": (*modes.warnings, *damping_warnings),
        "rigid_share": modes.rigid_share[:count],
        "most_strained": most_strained(modes, count),
        "damping": zeta,
        "mesh_error": [e if np.isfinite(e) else None for e in estimate_mesh_error(modes, count).tolist()],
        "left_out_stiffness": felt_stiffness(rest, modes.omega**2, modes.shapes)[:count],
        "mode_residual": modes.residual[:count],
        "equilibrium_residual": rest.residual,
        "imbalance": dataclasses.asdict(rest_imbalance(rest)),
        "gravity_m_s2": float(np.linalg.norm(environment.gravity)),
        **rest_numbers(rest),
        "node_shift_m": node_shifts(rest),
        "holding_force_n": {
            j.name: force for j, force in zip(joints, rest.holding_torque, strict=False) if j.slides
        },
        "slide_travel_m": {j.name: at for j, at in zip(joints, rest.config.angle, strict=False) if j.slides},
        "held_by": {
            j.name: SETTLED if j.state.value == "sprung" and not j.stiffness else HELD_BY[j.state.value]
            for j in joints
        },
        "stiffness_n_per_m": dict(zip(suspension.name, suspension.stiffness, strict=True)),
        "tension_n": dict(zip(rest.devices, rest.tension, strict=True)),
        "support_reactions": [
            {"at": r.at, "force_n": r.force, "moment_nm": r.moment} for r in rest.reactions
        ],
    }
    return _at_speed(document, modes, count) if environment.spins else document


def _at_speed(document: dict[str, Any], modes: md.Modes, count: int) -> dict[str, Any]:
    """The document with the modes at the wheels' speeds, and separately those at standstill."""
    import numpy as np

    found, damped = _whirls(modes, count)
    return {
        **{key: value for key, value in document.items() if key not in OF_MODES},
        "frequency_hz": found.frequency_hz,
        "damping": found.zeta.tolist() if damped else [None] * len(found.zeta),
        **fields(found, "sense", "whirl", "kind", "name"),
        "mode_residual": found.residual,
        "residual": float(found.residual.max()),
        "wheel_speed_rpm": {
            name: speed * 30.0 / np.pi for name, speed in modes.equilibrium.environment.wheel_speeds
        },
        "standstill": {key: document[key] for key in OF_MODES},
        "warnings": tuple(dict.fromkeys((*document["warnings"], *found.warnings))),
    }


def _whirls(modes: md.Modes, count: int) -> tuple[GyroscopicModes, bool]:
    """Modes at the wheels' speeds, and whether the article has a damping ratio for each."""
    try:
        return md.solve_gyroscopic_modes(modes, count=count), True
    except ConfigError:
        return md.solve_gyroscopic_modes(modes, md.Damping(), count=count), False


def _damping(modes: md.Modes, count: int) -> tuple[list[float | None], tuple[str, ...]]:
    """Ratios of the lowest modes, and warnings of them; none where the article's damping refuses one."""
    from middeck.structure.plants.damping import estimate_damping

    try:
        found = estimate_damping(modes, count=count)
    except ConfigError as error:
        return [None] * min(count, len(modes.omega)), (f"no damping ratios: {error.what}; {error.hint}",)
    return found.zeta.tolist(), found.warnings


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    still = document.get("standstill", document)
    blocks: list[str | ScreenTable] = [
        *case_lines(document),
        f"residual     {_imbalance(document)}",
        *_whirl_blocks(document),
        _modes_table(still),
        "\nrigid: share of kinetic energy in motions that do not strain the free article;"
        "\nstrain: share of strain energy in the potential energy",
        *([WITHOUT] if any(still["left_out_stiffness"]) else []),
        _parts_table(still),
    ]
    if document["reactions_n"]:
        keys = ("reactions_n", "tension_n", "stiffness_n_per_m")
        rows = [[a, *(f"{document[k][a]:z.4f}" for k in keys)] for a in document["reactions_n"]]
        headers = ["device", "load N", "tension N", "stiffness N/m"]
        blocks.append(ScreenTable("suspension", headers, rows))
    if document["support_reactions"]:
        rows = [
            [r["at"], *(f"{f:z.4f}" for f in (*r["force_n"], *r["moment_nm"]))]
            for r in document["support_reactions"]
        ]
        headers = ["at", "x N", "y N", "z N", "x N m", "y N m", "z N m"]
        blocks += _if_any(
            "reactions of clamps and bushings, world axes", headers, rows, "no support is loaded"
        )
    by = {j: held if held == SETTLED else f"its {held}" for j, held in document["held_by"].items()}
    torques = [[j, f"{t:z.5f}", by[j]] for j, t in document["holding_torque_nm"].items()]
    moved = document["node_shift_m"]
    turned = [
        [n, *(f"{1e3 * a:z.5f}" for a in moved[n]), *(f"{a:z.5f}" for a in v)]
        for n, v in document["node_rotation_deg"].items()
    ]
    forces = [
        [j, f"{f:z.5f}", f"{1e3 * document['slide_travel_m'][j]:z.4f}", by[j]]
        for j, f in document["holding_force_n"].items()
    ]
    return [
        *blocks,
        *([ScreenTable("holding torque", ["joint", "N m", "held by"], torques)] if torques else []),
        *([ScreenTable("holding force", ["slide", "N", "travel mm", "held by"], forces)] if forces else []),
        *_if_any(
            "displacement and rotation vector of the nodes at rest, world axes",
            ["node", "x mm", "y mm", "z mm", "x deg", "y deg", "z deg"],
            turned,
            "no node moves",
        ),
    ]


def _if_any(title: str, headers: list[str], rows: list[list[str]], none: str) -> list[str | ScreenTable]:
    """The table, or a sentence where all its numbers are zero."""
    some = any(float(cell) != 0.0 for row in rows for cell in row[1:])
    return [ScreenTable(title, headers, rows) if some else f"\n{title}: {none}"]


def _whirl_blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    """The modes at the wheels' speeds, if they spin."""
    if "standstill" not in document:
        return []
    headers, *rows = _whirl_rows(document)
    speeds = ", ".join(f"{name} {rpm:g}" for name, rpm in document["wheel_speed_rpm"].items())
    return [
        ScreenTable(f"modes with the wheels at their speeds, in rpm: {speeds}", ["", *headers[1:]], rows),
        "\nwhirl: change of the frequency in per cent for 1 % more speed of all wheels;"
        "\nforward: with the spin. Below, the same article with its wheels at standstill",
    ]


def _whirl_rows(document: dict[str, Any]) -> list[list[str]]:
    """Headers, then one row a mode."""
    keys = ("frequency_hz", "damping", "sense", "whirl", "kind", "name")
    return [["mode", "frequency Hz", "damping %", "sense", "whirl", "kind", "name"], *(
        [str(i), f"{f:.5f}", "" if z is None else f"{100.0 * z:z.3f}", way, f"{w:z.4f}" if way else "", k, n]
        for i, (f, z, way, w, k, n) in enumerate(zip(*(document[key] for key in keys), strict=True))
    )]  # fmt: skip


def _modes_table(document: dict[str, Any]) -> ScreenTable:
    keys = ("frequency_hz", "damping", "kind", "name", "rigid_share", "strain_share")
    rows = [
        [str(i), f"{f:.5f}", "" if z is None else f"{100.0 * z:.3f}", k, n, f"{r:.1%}", f"{s:.1%}"]
        for i, (f, z, k, n, r, s) in enumerate(zip(*(document[key] for key in keys), strict=True))
    ]
    table = ScreenTable("modes", ["", "frequency Hz", "damping %", "kind", "name", "rigid", "strain"], rows)
    return without_stiffness(table, document["left_out_stiffness"])


def _parts_table(document: dict[str, Any]) -> ScreenTable:
    """Apart from the modes: together they are too wide for a terminal."""
    rows = [
        [str(i), f"{f:.5f}", most["part"], f"{most['share']:.1%}"]
        for i, (f, most) in enumerate(zip(document["frequency_hz"], document["most_strained"], strict=True))
        if most is not None
    ]
    return ScreenTable(
        "largest share of the article's own strain energy", ["", "frequency Hz", "part", "share"], rows
    )


def _page_rows(document: dict[str, Any]) -> list[list[str]]:
    """Headers, then one row a mode, with the part that is strained most."""
    table, most = _modes_table(document), document["most_strained"]
    parts = ["" if m is None else f"{m['part']} {m['share']:.0%}" for m in most]
    return [["mode", *table.headers[1:], "most strain in"],
            *([*row, part] for row, part in zip(table.rows, parts, strict=True))]  # fmt: skip


def _imbalance(document: dict[str, Any]) -> str:
    """Forces over the weight, moments over weight times a length."""
    left = document["imbalance"]
    weight = "weight at rest" if document["gravity_m_s2"] else "weight under 1 g"
    return (
        f"unbalanced force {left['force']:.1e} of the {weight},\n"
        f"{'':13}moment {left['moment']:.1e} of that weight times {left['length']:.3g} m"
    )
