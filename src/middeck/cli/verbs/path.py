"""``middeck path``: modes followed while gravity changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.structure.gravity.gravity_levels import GravityLevel
    from middeck.structure.gravity.path import GravityPath

EXAMPLES = """\
  middeck path articles/mace-simple.toml --figure path.svg
  middeck path articles/mace-dm.toml --through earth,moon --json
"""
RULES = ("kept", "retuned")  # as in structure/gravity/gravity_levels.py, which --help must not import


@click.command("path", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.count
@options.several(
    "--through",
    metavar="PLACES",
    callback=options.listed,
    help="earth, mars, moon, orbit or m/s^2, with commas.  [default: the environment's own gravity,orbit]",
)
@click.option(
    "--tilt",
    type=options.Numbers(4),
    metavar="DEG,X,Y,Z",
    help="Instead: tilt the floor by an angle about an axis.",
)
@options.defaulted(
    "--devices",
    default=RULES[0],
    type=click.Choice(RULES),
    help="Keep the devices as tuned and scale their force, or tune them again in each gravity.",
)
@click.option("--require", is_flag=True, help="End with exit code 1 if the path ends early.")
@figures.figure
@options.common
def verb(
    case: options.TypedSetup,
    count: int,
    through: tuple[str, ...] | None,
    tilt: tuple[float, ...] | None,
    devices: str,
    require: bool,
    figure_file: str | None,
    as_json: bool,
) -> None:
    """Modes of ARTICLE while gravity changes.

    Follows the modes from one gravity to the next. Reports crossings, veerings, and a loss of stability with
    its gravity and mode. Suspension devices are tuned in the environment's own gravity and released in orbit.
    A load case acts at every gravity.
    """
    from middeck.cli.given.typed_article import case_warnings, read_case
    from middeck.structure.gravity.gravity_levels import DeviceRule
    from middeck.structure.summary.environment_plausibility import warnings_on_gravity

    structure, surroundings, *files = read_case(case)
    places = _places(surroundings, through, tilt)
    with reading(*files):
        found = md.follow_gravity(structure, surroundings, places, devices=DeviceRule(devices), count=count)
    of_places = (text for place in found.places for text in warnings_on_gravity(place.gravity))
    of_case = case_warnings(structure, surroundings, *files)
    document = {
        **describe(found),
        "warnings": (*dict.fromkeys([*of_case, *of_places]), *found.warnings),
    }
    if figure_file is not None:
        from middeck.plot.gravity_path import gravity_path_figure

        figures.write_figure(
            gravity_path_figure(found),
            figure_file,
            key="path",
            title=f"Modes of {document['article']} against gravity",
            description=" ".join(e.sentence + "." for e in found.events) or "No event.",
        )
    show(as_json, document, *_tables(document))
    if require and not found.complete:
        click.get_current_context().exit(1)


def _places(
    environment: md.Environment, through: tuple[str, ...] | None, tilt: tuple[float, ...] | None
) -> tuple[GravityLevel, ...] | None:
    import numpy as np

    from middeck.structure.gravity.gravity_levels import GravityLevel, find_place, tilt_place

    if through is not None and tilt is not None:
        raise ConfigError("--through or --tilt: one of them, not both", hint="leave one of them out")
    if tilt is not None:
        start = GravityLevel(environment.title, environment.gravity)
        return start, tilt_place(start, float(np.radians(tilt[0])), np.array(tilt[1:]))
    if through is None:
        return None
    return tuple(find_place(name, environment.gravity) for name in through)


def describe(found: GravityPath) -> dict[str, Any]:
    """The JSON document; ``frequency_hz`` of a growing mode is minus its rate over 2 pi."""
    e = found.environment
    released = e.suspension or e.devices or e.springs or e.bushings  # clamps hold in orbit too
    return {
        "schema": "middeck.path/1",
        "article": found.structure.title,
        "environment": found.environment.title,
        "devices": found.rule.value if released else "none",
        "complete": found.complete,
        "places": [{"name": p.name, "gravity_m_s2": p.gravity} for p in found.places],
        **fields(found, "reached", "name", "kind", "s"),
        "gravity_m_s2": found.gravity,
        **fields(found, "frequency_hz", "match", "exchanged", "doubtful"),
        "events": [
            {
                "what": e.kind.value,
                "ends_the_path": e.ends,
                "s": e.s,
                "gravity_m_s2": e.gravity,
                "modes": e.name,
                "branches": e.branch,
                **fields(e, "frequency_hz", "gap_hz", "sentence"),
            }
            for e in found.events
        ],
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    stations = list(document["reached"])
    headers = [document["places"][k]["name"] for k in range(len(stations))]
    if stations and stations[-1] != len(document["s"]) - 1:
        stations.append(len(document["s"]) - 1)
        headers.append("the end")
    exchanged = document["exchanged"]
    rows = [
        [f"{name} ~" if exchanged[stations, b].any() else name, kind,
         *(f"{document['frequency_hz'][p, b]:.5f}{'~' if exchanged[p, b] else ' '}" for p in stations)]
        for b, (name, kind) in enumerate(zip(document["name"], document["kind"], strict=True))
    ]  # fmt: skip
    blocks: list[str | ScreenTable] = [
        f"article      {document['article']}",
        f"environment  {document['environment']}, devices: {document['devices']}",
    ]
    if rows:
        blocks.append(ScreenTable("frequencies, Hz", ["branch", "kind", *headers], rows))
        blocks += _notes(document, stations)
    events = [f"  {e['sentence']}" for e in document["events"]]
    return [
        *blocks,
        "\n".join(["", "on the way", *(events or ["  no crossing, veering or loss of stability"])]),
    ]


def _notes(document: dict[str, Any], stations: list[int]) -> list[str]:
    notes: list[str] = []
    if document["exchanged"][stations].any():
        notes.append(
            "~ past a veering: the shape is no longer the one that the name tells; a name is that of the mode"
            "\n  where the path begins"
        )
    if document["devices"] != "none" and not document["gravity_m_s2"][stations].any(axis=1).all():
        notes.append(
            "in orbit all supports but clamps are released, stiffness and moving mass: frequencies jump"
            "\nthere, from a thousandth of the gravity for which devices were tuned"
        )
    return ["", *notes] if notes else []
