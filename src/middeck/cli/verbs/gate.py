"""``middeck gate``: the steps before a controller package may run."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.screen import ScreenTable, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from collections.abc import Callable

    from middeck.cli.given.plants_to_try import Gathered
    from middeck.realtime.gate.gate import GateVerdict
    from middeck.realtime.gate.steps_on_rig import GateRig, GateTrials

EXAMPLES = """\
  middeck gate law.mdk model.json --noise 1e-6 -o verdict.json
  middeck gate law.mdk model.json --shift 300:1000 0.5 --gain-db 3 --paper
"""


@click.command("gate", cls=options.Verb, examples=EXAMPLES)
@click.argument("package_file", metavar="PACKAGE.mdk|json")
@options.tried
@options.defaulted("--gain-db", default=6.0, type=options.NOT_NEGATIVE, help="Least gain margin.")
@options.defaulted(
    "--phase-deg", default=30.0, type=options.Real(0.0, 180.0, max_open=True), help="Least phase margin."
)
@click.option("--paper", is_flag=True, help="Steps on paper only: no dry run.")
@options.defaulted(
    "--disturbance",
    default=0.01,
    type=options.NOT_NEGATIVE,
    help="Noise at each output in a dry run: rms as a share of its limit.",
)
@options.defaulted(
    "--noise",
    default=1e-4,
    type=options.NOT_NEGATIVE,
    help="Noise at each input in a dry run: rms as a share of its range.",
)
@click.option(
    "--rig-port",
    type=click.IntRange(1, 65535),
    help="Shadow run and engagement on the rig that answers at this UDP port of this machine.",
)
@click.option(
    "--driver",
    metavar="DRIVER.c",
    help="Shadow run and engagement on hardware, in real time, by this driver of its converters.",
)
@options.defaulted(
    "--share",
    default=0.25,
    type=options.Real(0.0, 1.0, min_open=True),
    help="Share of full authority at which the package engages first.",
)
@options.several(
    "--hold",
    "paths",
    metavar="SENSOR OUTPUT GAIN",
    type=(str, str, options.Real()),
    help="Gain of the engine's hold (its PD loops), closed on every PLANT; may be repeated.",
)
@click.option(
    "--engaged",
    "relieved",
    metavar="PACKAGE.mdk|json",
    help="Package to be replaced: the cross-fade from it is tested on every PLANT.",
)
@options.written(
    "--blacklist",
    "blacklist_file",
    cls=options.Updated,
    endings=(".json",),
    metavar="BLACKLIST.json",
    help="Laws that caused a trip: they are refused. A law that trips when engaged is added.",
)
@click.option(
    "--adaptive",
    type=(str, options.POSITIVE, options.POSITIVE),
    metavar="SENSOR MAXIMUM RATE",
    help="Prove stability for a gain up to MAXIMUM that changes by at most RATE [1/s], controlled by the rms "
    "of SENSOR in a band.",
)
@click.option(
    "--adaptive-band",
    "band_hz",
    type=options.Frequencies(2),
    metavar="HZ,HZ",
    help="Band of the rms that controls the adaptive gain.",
)
@click.option(
    "--adaptive-rms",
    "rms",
    type=options.Numbers(2),
    metavar="QUIET,LOUD",
    help="Rms below which the adaptive gain rises, and above which it falls.",
)
@click.option(
    "--adaptive-least",
    "least",
    type=options.NOT_NEGATIVE,
    metavar="GAIN",
    help="Least adaptive gain.  [default: 0]",
)
@options.output("verdict_file", (".json",), "Write the verdict.", "VERDICT.json")
@options.written(
    "--log",
    "log_file",
    cls=options.Updated,
    endings=(".jsonl",),
    metavar="LOG.jsonl",
    help="Append each step as it ends.  [default: beside the verdict]",
)
@options.common
def verb(
    package_file: str,
    tried: options.TypedPlants,
    verdict_file: str | None,
    log_file: str | None,
    blacklist_file: str | None,
    relieved: str | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Test a controller package before it may run.

    Steps on paper: blacklist, interface, poles, test vectors, error bound, and the loop with each PLANT. The
    loop must be stable with margins at eleven shares of full authority, and must not grow while motors are
    limited. A PLANT is an article in each environment, a fitted model.json, or a promise.json with its drawn
    plants, with and without shifted modes. --engaged adds the cross-fade from the package that runs now,
    --adaptive a proof of stability with an adaptive gain.

    Runs: a dry run with noise on each PLANT and, on a rig, a shadow run (outputs discarded) and engagement at
    a share of authority, then at full authority. They use the engine or, without a C compiler, the reference
    law in Python. Each step is logged as it ends, with the package's SHA-256, beside the verdict or in --log:
    a gate that is killed leaves its steps. The exit code is 1 if a step fails. --set takes the keys of
    articles and environments.
    """
    from middeck.cli.given.plants_to_try import promised_hold_warnings
    from middeck.files.json.hash_seal import seal
    from middeck.files.json.output import write_json

    trials = _trials(given)
    gain = _adaptive_gain(given)
    package = md.load_package(package_file)
    engaged = None if relieved is None else md.load_package(relieved)
    beside = [package] if engaged is None else [package, engaged]
    engine = _held(beside, given["paths"]) if given["paths"] else None
    blacklist = {} if blacklist_file is None else md.files.load_blacklist(blacklist_file)
    gathered, models = _plants(tried, beside, given["paths"])
    margins = md.realtime.GateMargins(gain_db=given["gain_db"], phase_deg=given["phase_deg"])
    rig = _rig(package, engine, given["rig_port"], given["driver"], given["paper"])
    if log_file is None and verdict_file is not None:
        log_file = str(Path(verdict_file).with_suffix(".jsonl"))
    with nullcontext() if log_file is None else md.files.GateLog(log_file, package, models) as log:
        verdict = md.examine_package(
            package, models, margins, gain=gain, trials=trials, rig=rig, blacklist=blacklist, settings=engine,
            engaged=engaged, log=log, on_trip=_blame(blacklist_file),
        )  # fmt: skip
        if log is not None:
            log.end(verdict)
    document = describe(verdict, margins, trials) | {
        "promises": [promise.sha256 for promise in gathered.promises],
        "warnings": promised_hold_warnings(gathered, [1.0 / package.period_s]),
    }
    if verdict_file is not None:
        write_json(verdict_file, seal(document))
    show(as_json, document, *_tables(document))
    if not verdict.passed:
        click.get_current_context().exit(1)


def _trials(given: dict[str, Any]) -> GateTrials | None:
    if given["paper"]:
        options.refuse_unused("beside --paper", "disturbance", "noise", "share")
        return None
    return md.realtime.GateTrials(
        disturbance=given["disturbance"], noise=given["noise"], share=given["share"]
    )


def _plants(
    tried: options.TypedPlants,
    packages: list[md.ControllerPackage],
    paths: tuple[tuple[str, str, float], ...],
) -> tuple[Gathered, dict[str, md.Plant]]:
    """What was named, and its plants, shifted ones too, none of which may have the loops that are closed."""
    from middeck.cli.given.plants_to_try import all_plants, also_held, gather_plants
    from middeck.realtime.gate.linear_law import faded_laws

    linear = faded_laws(packages)([1.0] * len(packages))
    gathered = also_held(gather_plants(tried, linear), linear, tried.delay_s)
    closed = [(output, "--hold") for _, output, _ in paths]
    closed += [(p.outputs[path.output].name, f"package {p.name}") for p in packages for path in p.paths]
    for output, where in closed:
        if any(output in promise.inner for promise in gathered.promises):
            what = f"the plants of the promise have an inner loop at {output}"
            raise ConfigError(what, where=where, hint="a plan without [inner], or no second loop there")
    return gathered, all_plants(gathered, linear, tried)


def _blame(blacklist_file: str | None) -> Callable[[str, str], None] | None:
    if blacklist_file is None:
        return None
    return lambda law, trip: md.files.add_to_blacklist(blacklist_file, {law: trip})


def _held(
    packages: list[md.ControllerPackage], paths: tuple[tuple[str, str, float], ...]
) -> md.realtime.EngineSettings:
    """An engine with the packages' ports, ranges and limits, and the hold that was named."""
    from middeck.realtime.gate.steps_on_rig import package_settings
    from middeck.realtime.package.filter_sections import LoopPath, static_gain

    plain, *others = (package_settings(package) for package in packages)
    for other in others:
        more = tuple(test for test in other.sensors if test.port not in plain.inputs)
        drives = tuple(drive for drive in other.drives if drive.port not in plain.outputs)
        plain = dataclasses.replace(plain, sensors=plain.sensors + more, drives=plain.drives + drives)
    hold = tuple(
        LoopPath(plain.sensor(sensor), plain.drive(output), static_gain(gain))
        for sensor, output, gain in paths
    )
    return dataclasses.replace(plain, hold=hold)


def _rig(
    package: md.ControllerPackage,
    engine: md.realtime.EngineSettings | None,
    port: int | None,
    driver: str | None,
    paper: bool,
) -> GateRig | None:
    """The rig that was named, behind this engine, or one with the ports, ranges and limits of the package."""
    from middeck.realtime.gate.steps_on_rig import GateRig, package_settings

    if port is not None and driver is not None:
        raise ConfigError("--rig-port and --driver", hint="one rig")
    if paper and (port is not None or driver is not None):
        raise ConfigError("--paper with a rig", hint="leave one of them out")
    if port is None and driver is None:
        return None
    settings = package_settings(package) if engine is None else engine
    if port is not None:
        return GateRig(md.realtime.UdpRig(port), settings)
    program = md.realtime.build_engine(driver=driver)
    return GateRig(md.realtime.DriverRig(), settings, real_time=True, program=program)


def _adaptive_gain(given: dict[str, Any]) -> md.realtime.AdaptiveGain | None:
    rest = {"--adaptive-band": given["band_hz"], "--adaptive-rms": given["rms"]}
    if given["adaptive"] is None:
        alone = [
            name for name, value in (*rest.items(), ("--adaptive-least", given["least"])) if value is not None
        ]
        if alone:
            raise click.UsageError(f"{alone[0]} belongs to --adaptive")
        return None
    missing = [name for name, value in rest.items() if value is None]
    if missing:
        raise click.UsageError(f"--adaptive needs {' and '.join(missing)}")
    sensor, maximum, rate = given["adaptive"]
    quiet, loud = given["rms"]
    return md.realtime.AdaptiveGain(
        maximum=maximum, rate=rate, sensor=sensor, band_hz=given["band_hz"], quiet_rms=quiet, loud_rms=loud,
        minimum=given["least"] or 0.0,
    )  # fmt: skip


def describe(verdict: GateVerdict, margins: Any, trials: Any) -> dict[str, Any]:
    """The JSON document."""
    from middeck.files.laws.verdicts import VERDICT

    return {
        "schema": VERDICT,
        "package": verdict.sha256,
        **fields(verdict, "law", "hold", "engaged", "name", "models"),
        "least": margins,
        "trials": trials,
        **fields(verdict, "steps", "left_out", "tripped"),
        "adaptive": verdict.gain,
        "proofs": verdict.proofs,
        "passed": verdict.passed,
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    rows = [[step.name, "yes" if step.passed else "NO", step.said] for step in document["steps"]]
    left_out = [f"left out     {', '.join(document['left_out'])}"] if document["left_out"] else []
    return [
        f"package      {document['name']}, SHA-256 {document['package']}",
        f"verdict      {'passed' if document['passed'] else 'REFUSED'}, models: {len(document['models'])}",
        *left_out,
        ScreenTable("steps", ["step", "passed", "what was found"], rows),
    ]
