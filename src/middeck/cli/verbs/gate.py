"""``middeck gate``: the steps on paper before a controller package may run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from middeck.cli import options
from middeck.cli.screen import Table, show

if TYPE_CHECKING:
    from middeck.realtime.gate.gate import GateVerdict

EPILOG = """\
\b
Examples:
  middeck gate law.mdk model.json -o verdict.json
  middeck gate law.mdk model.json --shift 300:1000 0.5 --gain-db 3
"""


@click.command("gate", cls=options.Verb, epilog=EPILOG)
@click.argument("package_file", metavar="PACKAGE.mdk|json")
@click.argument("plants", nargs=-1, required=True, metavar="PLANT...")
@click.option(
    "--environment",
    "environments",
    multiple=True,
    metavar="NAME|PATH",
    help="Environment of the articles; may be repeated.  [default: lab]",
)
@options.load_case
@options.count
@click.option(
    "--shift",
    "shifts",
    type=(str, click.FloatRange(0.0, 100.0, min_open=True, max_open=True)),
    multiple=True,
    metavar="MODES PERCENT",
    help="Modes by name or LO:HI in Hz, moved together down and up.",
)
@options.sweep
@options.first_bending
@click.option("--delay-ms", type=click.FloatRange(min=0.0), default=0.0, help="Delay added to each plant.")
@click.option(
    "--gain-db", type=click.FloatRange(min=0.0), default=6.0, show_default=True, help="Least gain margin."
)
@click.option(
    "--phase-deg",
    type=click.FloatRange(0.0, 180.0, max_open=True),
    default=30.0,
    show_default=True,
    help="Least phase margin.",
)
@options.written(
    "-o", "--output", "verdict_file", endings=(".json",), metavar="VERDICT.json", help="Write the verdict."
)
@options.common
def verb(
    package_file: str,
    plants: tuple[str, ...],
    environments: tuple[str, ...],
    load_case: str | None,
    count: int,
    verdict_file: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
    **given: Any,
) -> None:
    """Steps on paper before a controller package may run.

    Interface, poles, test vectors, error bound, and the loop with each PLANT (an article in each environment,
    or a fitted model.json, with and without shifted modes) stable with margin at eleven points of the fade.
    Exit code 1 where a step is not passed. Dry run, shadow run and engagement belong to the computer that
    runs the package. --set takes the keys of articles and environments.
    """
    from middeck.cli.qualifying import gather_plants
    from middeck.cli.sweeping import all_plants
    from middeck.files.json_output import write_json
    from middeck.files.packages import load_package
    from middeck.files.sealed import seal
    from middeck.realtime.gate.gate import examine_package
    from middeck.realtime.gate.linear_law import linear_law
    from middeck.realtime.gate.steps import GateMargins

    package = load_package(package_file)
    linear = linear_law(package)
    gathered = gather_plants(
        plants,
        environments or ("lab",),
        linear,
        case=load_case,
        count=count,
        overrides=overrides,
        delay_s=1e-3 * given["delay_ms"],
    )
    models = all_plants(gathered, linear, given)
    margins = GateMargins(gain_db=given["gain_db"], phase_deg=given["phase_deg"])
    verdict = examine_package(package, models, margins)
    document = describe(verdict, margins)
    if verdict_file is not None:
        write_json(verdict_file, seal(document))
    show(as_json, document, *_tables(document))
    if not verdict.passed:
        click.get_current_context().exit(1)


def describe(verdict: GateVerdict, margins: Any) -> dict[str, Any]:
    """The JSON document."""
    return {
        "schema": "middeck.gate/1",
        "package": verdict.sha256,
        "name": verdict.name,
        "models": verdict.models,
        "least": margins,
        "steps": verdict.steps,
        "passed": verdict.passed,
    }


def _tables(document: dict[str, Any]) -> list[str | Table]:
    rows = [[step.name, "yes" if step.passed else "NO", step.said] for step in document["steps"]]
    return [
        f"package      {document['name']}, SHA-256 {document['package']}",
        f"verdict      {'passed' if document['passed'] else 'REFUSED'}, {len(document['models'])} models",
        Table("steps", ["step", "passed", "what was found"], rows),
    ]
