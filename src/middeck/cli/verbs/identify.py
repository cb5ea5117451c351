"""``middeck identify``: a model from measured records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from middeck.cli import options
from middeck.cli.screen import Table, show

if TYPE_CHECKING:
    from middeck.cli.fitting import Identified

EPILOG = """\
\b
Examples:
  middeck identify data/cubespec-fsm/mirror-300mV-train.npz --states 16 \\
    --sampled --band 100,1000 --validate \\
    data/cubespec-fsm/mirror-300mV-test.npz
  middeck identify data/cubespec-fsm/mirror-300mV-train.npz --states 6 \\
    --band 300,1000 --continuous -o model.json --json
"""


@click.command("identify", epilog=EPILOG)
@click.argument("records", nargs=-1, required=True, metavar="RECORD...")
@options.periods
@options.states
@options.band
@click.option(
    "--sampled/--continuous",
    default=None,
    help="Kind of model.  [default: sampled if the band passes 1/8 of the sampling rate]",
)
@click.option(
    "--cost",
    type=click.Choice(["weighted", "logarithmic"]),
    help="What is made least: the weighted error, or that of log magnitude and phase.  [default: weighted]",
)
@click.option("--validate", multiple=True, metavar="RECORD", help="Held-out record; may be repeated.")
@click.option(
    "-o",
    "--output",
    "model_file",
    metavar="MODEL.json",
    callback=options.in_a_folder,
    help="Write the model.",
)
@options.common
def verb(
    records: tuple[str, ...],
    periods: int | None,
    states: int | None,
    band_hz: tuple[float, float] | None,
    sampled: bool | None,
    cost: str | None,
    validate: tuple[str, ...],
    model_file: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Fit poles, residues and delays to measured records.

    RECORDs (.npz, or .csv with --periods) hold whole steady periods; several are experiments of one test.
    --set takes states, band_hz, sampled, cost and periods.
    """
    from middeck.cli.fitting import identify
    from middeck.cli.settings import FitSettings, settle
    from middeck.files.models import write_model

    given = {"states": states, "band_hz": band_hz, "sampled": sampled, "cost": cost, "periods": periods}
    settings = settle(FitSettings, given, overrides)
    if settings.states is None:
        click.echo("trying one order after another, which takes minutes; --states N names one", err=True)
    found = identify(records, settings)
    document = {
        **describe(found),
        "held_out_nrmse": _validate(found, validate, settings.periods),
        "records": records,
    }
    if model_file is not None:
        write_model(model_file, found.fit.model)
    show(as_json, document, *_tables(document))


def _validate(found: Identified, files: tuple[str, ...], periods: int | None) -> dict[str, float] | None:
    """Error of the simulated outputs on held-out records; None without any."""
    from middeck.cli.blame import reading
    from middeck.cli.fitting import load_periods
    from middeck.identification.simulation import nrmse

    if not files:
        return None
    held_out = load_periods(files, periods)
    with reading(*files):
        error = nrmse(found.fit.model, held_out)
    return {p.name: float(e) for p, e in zip(found.fit.model.outputs, error, strict=True)}


def describe(found: Identified) -> dict[str, Any]:
    """The JSON document."""
    from middeck.identification.measurement_model import damping_ratio, natural_hz

    fit, model, lines = found.fit, found.fit.model, found.measured.frequency_hz
    names = [p.name for p in model.outputs]
    return {
        "schema": "middeck.identify/1",
        "inputs": model.inputs,
        "outputs": model.outputs,
        "states": model.states,
        "order_reason": fit.order_reason,
        "sample_hz": found.sample_hz,
        "sampled": model.sample_hz is not None,
        "band_hz": [lines[0], lines[-1]],
        "lines": len(lines),
        "frequency_hz": natural_hz(model),
        "frequency_std_hz": fit.uncertainty.natural_hz,
        "damping": damping_ratio(model),
        "damping_std": fit.uncertainty.damping,
        "pole": model.poles,
        "delay_s": dict(zip(names, model.delay_s, strict=True)),
        "delay_std_s": dict(zip(names, fit.uncertainty.delay_s, strict=True)),
        "error": dict(zip(names, fit.error, strict=True)),
        "cost": fit.cost,
        "warnings": found.warnings,
    }


def _tables(document: dict[str, Any]) -> list[str | Table]:
    keys = ("frequency_hz", "frequency_std_hz", "damping", "damping_std")
    poles = [
        [f"{f:.5f}", f"{df:.1e}", f"{z:.5f}", f"{dz:.1e}"]
        for f, df, z, dz in zip(*(document[k] for k in keys), strict=True)
    ]
    held_out = document["held_out_nrmse"] or {}
    outputs = [
        [
            port.name,
            f"{document['delay_s'][port.name] * 1e3:.4f}",
            f"{document['error'][port.name]:.2%}",
            f"{held_out[port.name]:.2%}" if held_out else "",
        ]
        for port in document["outputs"]
    ]
    kind = "sampled" if document["sampled"] else "continuous"
    low, high = document["band_hz"]
    return [
        f"{document['states']} states, {kind}, fitted to {document['lines']} lines in {low:g}-{high:g} Hz",
        f"order: {document['order_reason']}",
        Table("poles", ["Hz", "+-", "damping", "+-"], poles),
        Table("outputs", ["output", "delay ms", "error of fit", "held-out NRMSE"], outputs),
    ]
