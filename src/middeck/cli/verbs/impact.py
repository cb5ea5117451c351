"""``middeck impact``: a hammer test, its blows judged, its response and its modes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, cells, delay_cells, mode_rows, show

if TYPE_CHECKING:
    from middeck.identification.impact.averaged_blows import ImpactTest

EXAMPLES = """\
  middeck impact blows.csv
  middeck impact blows.csv --of response --window 0.4 \\
    --response frf.uff -o model.json
"""


@click.command("impact", cls=options.Verb, examples=EXAMPLES)
@click.argument("records", nargs=-1, required=True, metavar="RECORD...")
@options.columns
@options.states
@options.band
@click.option(
    "--ratio", type=click.Choice(["h1", "h2"]), default="h1", help="Estimator of the average.  [default: h1]"
)
@click.option(
    "--window",
    "window_s",
    type=options.POSITIVE,
    metavar="SECONDS",
    help="Time constant of the exponential window; inf for none.  [default: a thousandth is left at the end]",
)
@click.option(
    "--apart",
    "blow_s",
    type=options.POSITIVE,
    metavar="SECONDS",
    help="Least time between two blows; what follows sooner is a double hit.  [default: a quarter of the "
    "longest]",
)
@click.option(
    "--of",
    "fitted",
    type=click.Choice(["samples", "response"]),
    default="samples",
    help="What is fitted: the blows, or their average, corrected for the window's damping.  "
    "[default: samples]",
)
@options.written(
    "--response", "response_file", endings=options.RESPONSES, metavar="FILE.uff", help="Write the average."
)
@options.model_file
@options.common
def verb(
    records: tuple[str, ...],
    columns: options.ColumnsTyped,
    states: int | None,
    band_hz: tuple[float, float] | None,
    ratio: Any,
    window_s: float | None,
    blow_s: float | None,
    fitted: Any,
    response_file: str | None,
    model_file: str | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the blows of a hammer test, average and fit them.

    Each RECORD holds one force and the responses to it, with one or several blows. Double hits, overloads,
    weak blows, blows cut short, and blows struck while the article still rings are listed with the reason and
    left out. --set takes states and band_hz.
    """
    from middeck.cli.given.checked_options import ImpactSettings, settle
    from middeck.files.records import load_records, write_response

    chosen = settle(ImpactSettings, {"states": states, "band_hz": band_hz}, overrides)
    taken = load_records(records, columns.named())
    with reading(*records):
        test = md.identification.average_blows(
            taken, ratio=ratio, window_s=window_s, band_hz=chosen.band_hz, blow_s=blow_s
        )
        fit = md.fit_impact(test, of=fitted, states=chosen.states)
    if response_file is not None:
        write_response(response_file, test.response)
    if model_file is not None:
        md.write(model_file, fit)
    document = describe(test, fit) | {"records": records, "fitted": fitted}
    show(as_json, document, *_blocks(document))


def describe(test: ImpactTest, fit: md.identification.FitResult) -> dict[str, Any]:
    """The JSON document."""
    import numpy as np

    from middeck.identification.model.measurement_model import damping_ratio, natural_hz
    from middeck.identification.uncertainty.parameter_deviations import stated

    rate = test.blocks.sample_hz
    names = [p.name for p in fit.model.outputs]
    return {
        "schema": "middeck.impact/1",
        "blows": [
            {
                "experiment": b.experiment,
                "struck_s": b.struck / rate,
                "block_s": (b.last - b.first) / rate,
                "peak": b.peak,
                "rejected": b.rejected,
            }
            for b in test.blows
        ],
        "window_s": test.window_s if np.isfinite(test.window_s) else None,
        "band_hz": (test.response.frequency_hz[0], test.response.frequency_hz[-1]),
        "coherence": dict(zip(names, np.mean(test.coherence, axis=0), strict=True)),
        "states": fit.model.states,
        "order_reason": fit.order_reason,
        "frequency_hz": natural_hz(fit.model),
        "frequency_std_hz": stated(fit.uncertainty.natural_hz),
        "damping": damping_ratio(fit.model),
        "damping_std": stated(fit.uncertainty.damping),
        "standing": fit.standing,
        "delay_s": dict(zip(names, fit.model.delay_s, strict=True)),
        "delay_std_s": dict(zip(names, stated(fit.uncertainty.delay_s), strict=True)),
        "delay_standing": dict(zip(names, fit.delay_standing, strict=True)),
        "error": dict(zip(names, fit.error, strict=True)),
        "warnings": (*test.warnings, *fit.warnings),
    }


def _blocks(document: dict[str, Any]) -> list[str | ScreenTable]:
    keys = ("experiment", "struck_s:.4g", "block_s:.3g", "peak:.4g", "rejected")
    blows = [cells(blow, *keys) for blow in document["blows"]]
    outputs = [
        [name, f"{coherence:.4f}", *delay_cells(document, name), f"{document['error'][name]:.2%}"]
        for name, coherence in document["coherence"].items()
    ]
    low, high = document["band_hz"]
    window = document["window_s"]
    return [
        ScreenTable("blows", ["experiment", "s", "block s", "peak", "rejected"], blows),
        f"band {low:.4g}-{high:.4g} Hz; exponential window of the average: "
        + ("none" if window is None else f"time constant {window:.4g} s"),
        f"order: {document['order_reason']}",
        ScreenTable("modes", ["Hz", "+-", "damping", "+-", ""], mode_rows(document)),
        ScreenTable("outputs", ["output", "coherence", "delay ms", "+-", "", "error of fit"], outputs),
    ]
