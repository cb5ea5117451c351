"""``middeck sensitivity``: derivatives of frequencies and of the rest state in named numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, case_lines, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.structure.sensitivity.frequency_derivatives import FrequencySensitivities
    from middeck.structure.sensitivity.rest import RestSensitivities

EXAMPLES = """\
  middeck sensitivity articles/mace-dm.toml \\
    --parameter "node.*.mass,members.E" --parameter environment.bounce_hz
  middeck sensitivity articles/mace-dm.toml --parameter "*" \\
    --mode "first torsion" --top 10
"""
TOP = 20  # rows of each mode that was asked for
NOTHING = 1e-12  # of dlnf/dlnp (of df/dp of what is zero): rounding
SMALL = 5e-5  # of dlnf/dlnp: four decimals would say zero


@click.command("sensitivity", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.several(
    "--parameter",
    "patterns",
    metavar="NAME",
    required=True,
    help="Parameter to differentiate by, * for any text; may be repeated.",
)
@options.defaulted("--count", default=12, type=click.IntRange(min=1), help="How many of the lowest modes.")
@options.several(
    "--mode",
    "wanted",
    metavar="NAME|NUMBER",
    help="Print this mode only, as `middeck modes` names it; may be repeated.",
)
@click.option(
    "--top",
    type=click.IntRange(min=1),
    help=f"Print the N largest of each mode, by |dlnf/dlnp|.  [default: {TOP} with --mode, else all]",
)
@options.common
def verb(
    case: options.TypedSetup,
    patterns: tuple[str, ...],
    count: int,
    wanted: tuple[str, ...],
    top: int | None,
    as_json: bool,
) -> None:
    """Derivatives of frequencies and of the rest state of ARTICLE.

    The derivatives are exact and include the shift of the rest state and the tuning of the suspension.
    Parameters are named by part and field, as in node.n1.cg.y, member.n1-n2.EI_y, joint.pri_x.angle,
    environment.gravity.y. --json has all of them for every mode up to the last one printed.
    """
    from middeck.cli.given.typed_article import find_case, solve_case

    if not all(pattern.strip(", ") for pattern in patterns):
        raise ConfigError("no parameter named", where="--parameter", hint='a name, or "*" for all')
    modes = solve_case(case)
    rest = modes.equilibrium
    chosen = find_modes(modes.name, wanted)
    with reading(*find_case(case.article, case.environment)):
        names = options.separate_names(patterns, "--parameter")
        parameters = md.structure.find_parameters(rest.model.structure, rest.environment, names)
        by_rest = md.structure.differentiate_rest(rest, parameters)
        by_modes = md.differentiate_frequencies(modes, parameters, max([count, *(m + 1 for m in chosen)]))
    document = describe(modes, by_modes, by_rest)
    show(as_json, document, *_tables(document, chosen, top or (TOP if wanted else None)))


def find_modes(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Numbers of the modes of name or number ``wanted``; fails with the nearest names.

    >>> find_modes(["bounce", "first torsion", "mixed", "mixed"], ["First torsion", "0", "mixed"])
    [1, 0, 2, 3]
    """
    from middeck.files.toml.faults import nearest

    found: dict[int, None] = {}
    for one in wanted:
        number = int(one) if one.isascii() and one.isdigit() else -1
        fits = [i for i, name in enumerate(names) if i == number or name.lower() == one.strip().lower()]
        if not fits:
            advice = f"a number from 0 to {len(names) - 1}" if number >= 0 else nearest(one, names)
            raise ConfigError(f"no mode {one!r}", where="--mode", hint=advice)
        found |= dict.fromkeys(fits)
    return list(found)


def describe(modes: md.Modes, found: FrequencySensitivities, rest: RestSensitivities) -> dict[str, Any]:
    """The JSON document; a derivative that does not exist (of omega at zero) is null."""
    import numpy as np

    equilibrium = modes.equilibrium
    joints = equilibrium.model.structure.joints
    relative = found.relative

    def held(parameter: int, slides: bool) -> dict[str, float]:
        by_joint = zip(joints, rest.holding_torque[:, parameter], strict=True)
        return {j.name: d for j, d in by_joint if j.slides == slides}

    parameters = [
        {
            **fields(p, "name", "unit", "value"),
            "d_lambda": found.d_lambda[i],
            "d_hz": [float(d) if np.isfinite(d) else None for d in found.d_hz[i]],
            "relative": [float(d) if np.isfinite(d) else None for d in relative[i]],
            "d_reactions_n": dict(zip(equilibrium.suspension.name, rest.reaction[:, i], strict=True)),
            "d_tension_n": dict(zip(equilibrium.devices, rest.tension[:, i], strict=True)),
            "d_holding_torque_nm": held(i, slides=False),
            "d_holding_force_n": held(i, slides=True),
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


def _tables(document: dict[str, Any], chosen: list[int], top: int | None) -> list[str | ScreenTable]:
    """All in one table; or one for each mode, its largest first, and the rest state by what is left."""
    every = range(len(document["parameters"]))
    modes = range(len(document["frequency_hz"]))
    blocks: list[str | ScreenTable] = [*case_lines(document)]
    if not any(f > 0.0 for f in document["frequency_hz"]):
        blocks.append("\nall modes shown are rigid: omega = 0 has no derivative; a larger --count shows more")
    if not chosen and top is None:
        idle = [p for p in every if all(_is_nothing(document, p, m) for m in modes)]
        busy = [p for p in every if p not in idle]
        rows = [_row(document, p, m) for p in busy for m in modes if _has_slope(document, p, m)]
        blocks.append(ScreenTable("derivatives of the frequencies", FREQUENCIES, rows))
        return [*blocks, *_idle_note(document, idle), *_rest_table(document, list(every))]
    left: set[int] = set()
    for m in chosen or modes:
        kept = [p for p in _largest_first(document, m) if _has_slope(document, p, m)][:top]
        left |= set(kept)
        title = f"derivatives of the frequency of mode {m}, {document['name'][m]}"
        blocks.append(ScreenTable(title, FREQUENCIES, [_row(document, p, m) for p in kept]))
    return [*blocks, *_rest_table(document, sorted(left))]


FREQUENCIES = ["parameter", "value", "unit", "mode", "Hz", "dHz per unit", "dlnf/dlnp"]


def _has_slope(document: dict[str, Any], parameter: int, mode: int) -> bool:
    return document["parameters"][parameter]["d_hz"][mode] is not None


def _is_nothing(document: dict[str, Any], parameter: int, mode: int) -> bool:
    """Whether a mode's frequency has a slope there, and that is none but for rounding."""
    p = document["parameters"][parameter]
    share = p["d_hz"][mode] if p["relative"][mode] is None else p["relative"][mode]
    return _has_slope(document, parameter, mode) and abs(share) <= NOTHING


def _idle_note(document: dict[str, Any], idle: list[int]) -> list[str]:
    from middeck.structure.model.connectivity import some_names

    if not idle:
        return []
    named = some_names([document["parameters"][p]["name"] for p in idle])
    return [
        f"\nno frequency shown depends on {named} to first order: in these modes it neither strains nor "
        "moves, or works by its square; a larger --count shows other modes"
    ]


def _largest_first(document: dict[str, Any], mode: int) -> list[int]:
    """Order by |dlnf/dlnp|; parameters that are zero last, by |df/dp|."""

    def size(p: dict[str, Any]) -> tuple[bool, float]:
        share = p["relative"][mode]
        return share is not None, abs((p["d_hz"][mode] if share is None else share) or 0.0)

    parameters = document["parameters"]
    return sorted(range(len(parameters)), key=lambda i: size(parameters[i]), reverse=True)


def _row(document: dict[str, Any], parameter: int, mode: int) -> list[str]:
    p = document["parameters"][parameter]
    share = p["relative"][mode]
    return [
        p["name"],
        f"{p['value']:g}",
        p["unit"],
        str(mode),
        f"{document['frequency_hz'][mode]:.5f}",
        f"{p['d_hz'][mode]:+.5e}",
        "-" if share is None else _share(share),
    ]


def _share(share: float) -> str:
    return f"{share:+z.4f}" if abs(share) >= SMALL or abs(share) <= NOTHING else f"{share:+.0e}"


def _rest_table(document: dict[str, Any], shown: list[int]) -> list[ScreenTable]:
    """Tensions of devices and torques of joints, a row for each that a parameter changes."""
    kinds = (
        ("d_tension_n", "tension of", "N"),
        ("d_holding_torque_nm", "torque at", "N m"),
        ("d_holding_force_n", "force at", "N"),
    )
    rows = [
        [p["name"], f"{what} {name}", unit, f"{d:+.5e}"]
        for p in (document["parameters"][i] for i in shown)
        for key, what, unit in kinds
        for name, d in p[key].items()
        if d != 0.0
    ]
    headers = ["parameter", "of", "", "per unit"]
    return [ScreenTable("derivatives of the rest state, where not zero", headers, rows)] if rows else []
