"""``middeck drift``: which modes have moved between two records."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, show
from middeck.errors import ConfigError
from middeck.study.words import fields

if TYPE_CHECKING:
    from middeck.cli.given.checked_options import FitSettings
    from middeck.identification.uncertainty.fit_drift import FitChanges
    from middeck.identification.uncertainty.response_drift import ResponseDrift

EXAMPLES = """\
  middeck drift data/cubespec-fsm/mirror-300mV-train.npz \\
    data/cubespec-fsm/mirror-300mV-test.npz \\
    --states 6 --band 300,1000 --continuous
  middeck drift data/cubespec-fsm/mirror-300mV-train.npz \\
    data/cubespec-fsm/mirror-300mV-test.npz \\
    --states 6 --band 300,1000 --continuous --require --json
"""

EXACT = (
    "the model has no covariance and is taken as exact: its own errors count as drift; "
    "write it again with identify -o, or give its record"
)


@click.command("drift", cls=options.Verb, examples=EXAMPLES)
@click.argument("before", metavar="BEFORE")
@click.argument("after", metavar="AFTER")
@options.periods
@options.states
@options.band
@click.option(
    "--sampled/--continuous",
    default=None,
    help="Kind of models.  [default: sampled if the band extends above 1/8 of the sampling rate]",
)
@options.defaulted(
    "--level",
    default=0.05,
    type=options.Real(0.0, 1.0, min_open=True, max_open=True),
    help="Probability that the fits, or the responses, raise any false alarm.",
)
@click.option("--require", is_flag=True, help="End with exit code 1 if anything has drifted.")
@options.common
def verb(
    before: str,
    after: str,
    periods: int | None,
    states: int | None,
    band_hz: tuple[float, float] | None,
    sampled: bool | None,
    level: float,
    require: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Test whether an article has changed between two records.

    BEFORE and AFTER are records as identify takes them. Both are fitted with one order, and the change of
    every mode is compared with the standard deviations of both fits. If both have two periods or more, their
    responses are also compared line by line. BEFORE may be a MODEL.json of identify; AFTER is then fitted
    with the model's options. A model without a covariance counts as exact. --set takes the keys of identify.
    """
    from middeck.cli.given.checked_options import FitSettings, settle

    given = {"states": states, "band_hz": band_hz, "sampled": sampled, "periods": periods}
    document = compare(before, after, settle(FitSettings, given, overrides), level)
    show(as_json, document, *_tables(document))
    if require and document["drifted"]:
        click.get_current_context().exit(1)


def compare(before: str, after: str, settings: FitSettings, level: float) -> dict[str, Any]:
    """The JSON document of a comparison."""
    from middeck.cli.work.fit_records import alike, identify
    from middeck.files.disk.kind_of_content import SCHEMAS, looks_like
    from middeck.files.measured.models import load_fitted
    from middeck.files.records import require_record
    from middeck.identification.uncertainty.covariance import as_exact

    if looks_like(after) == SCHEMAS["model"]:
        raise ConfigError(
            "looks like a fitted model, not a record", where=after, hint="the model before the record"
        )
    require_record(after)
    if before.lower().endswith(".json"):
        model, covariance = load_fitted(before)
        second = identify([after], alike(settings, model, covariance))
        with reading(before, after):
            found = md.compare_fits(covariance or as_exact(model), second.fit.covariance, level=level)
        warnings = [*second.warnings, *_unlike_holds(model, second.fit.model)]
        warnings += [] if covariance is not None else [f"{before}: {EXACT}"]
        return describe(before, after, found, None, warnings)
    require_record(before)
    if os.path.realpath(before) == os.path.realpath(after):
        what = "the same record twice, in which nothing can have changed"
        raise ConfigError(what, where=after, hint="two records, of before and after")
    first = identify([before], settings)
    same = {"sampled": first.fit.model.sample_hz is not None, "states": first.fit.model.states}
    second = identify([after], settings.model_copy(update=same))
    with reading(before, after):
        found = md.compare_fits(first.fit.covariance, second.fit.covariance, level=level)
        lines = _compare_lines(first.measured, second.measured, level)
    warnings = [f"{file}: {w}" for file, of in ((before, first), (after, second)) for w in of.warnings]
    warnings += _unlike_holds(first.fit.model, second.fit.model)
    return describe(before, after, found, lines, warnings)


def _unlike_holds(before: md.MeasurementModel, after: md.MeasurementModel) -> list[str]:
    """A hold taken out of one model may be in the delays of another."""
    known = {before.hold_s, after.hold_s} - {None}
    if None not in (before.hold_s, after.hold_s) or not any(known):
        return []
    return [
        "one model's delays are without the hold of its inputs, the other does not state it: delays may "
        "differ by half a period; give both middeck identify --held or --not-held"
    ]


def _compare_lines(
    before: md.FrequencyResponse | None, after: md.FrequencyResponse | None, level: float
) -> ResponseDrift | None:
    """Comparison by lines; None where a record itself was fitted, or an uncertainty is unknown."""
    from middeck.identification.uncertainty.response_drift import compare_responses

    if before is None or after is None or before.variance is None or after.variance is None:
        return None
    return compare_responses(before, after, level=level)


def describe(
    before: str, after: str, found: FitChanges, lines: ResponseDrift | None, warnings: Any
) -> dict[str, Any]:
    """The JSON document; ``lines`` is None where the uncertainty of the responses is unknown."""
    return {
        "schema": "middeck.drift/1",
        "before": before,
        "after": after,
        "level": found.level,
        "drifted": found.drifted or (lines is not None and lines.drifted and lines.trusted),
        "sentence": found.sentence,
        "response_sentence": None if lines is None else lines.sentence,
        "response_inflation": None if lines is None else lines.inflation,
        **fields(found, "p_overall", "modes", "delays"),
        "only_before_hz": found.only_before,
        "only_after_hz": found.only_after,
        "bands": None if lines is None else lines.bands,
        "warnings": tuple(warnings),
    }


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    modes = [
        [
            *(f"{f:.5f}" for f in m.frequency_hz),
            *_change(m.frequency_hz, m.frequency_std_hz),
            *(f"{z:.5f}" for z in m.damping),
            *_change(m.damping, m.damping_std),
            _probability(m.p_pole),
            _probability(m.p_constants),
            "moved" if m.moved else "reshaped" if m.reshaped else "",
        ]
        for m in document["modes"]
    ]
    headers = ["Hz before", "after", "change", "+-", "damping", "after", "change", "+-"]
    return [*_verdict(document), ScreenTable("modes", [*headers, "p pole", "p constants", ""], modes)]


def _verdict(document: dict[str, Any]) -> list[str]:
    """Verdict above the table; in one line where only the responses show a change."""
    of_fits, of_lines = document["sentence"], document["response_sentence"]
    by_fits = any(m.moved or m.reshaped for m in document["modes"]) or any(
        d.changed for d in document["delays"]
    )
    if document["drifted"] and not by_fits:
        return [f"drifted: {of_lines}, although {of_fits}"]
    lines = [of_fits] if of_lines is None else [of_fits, of_lines]
    return ["drifted" if document["drifted"] else "no drift", *lines]


def _change(pair: tuple[float, float], deviation: float) -> tuple[str, str]:
    """A difference and its deviation; one that is larger than what has changed says nothing of it."""
    known = deviation <= max(abs(value) for value in pair)
    return f"{pair[1] - pair[0]:+.2g}", f"{deviation:.1e}" if known else "not determined"


def _probability(p: float) -> str:
    """Below double precision a tail says no more than that."""
    return "< 1e-16" if p < 1e-16 else f"{p:.2g}"
