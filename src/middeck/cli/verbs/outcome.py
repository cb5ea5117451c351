"""``middeck outcome``: a measured outcome beside its promise, and the score of many promises."""

from pathlib import Path
from typing import Any

import click

from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, cells, number, show
from middeck.errors import ConfigError

EXAMPLES = """\
  middeck outcome data/virtual-survey/promise.json \\
    data/virtual-survey/outcome.toml -o comparison.json
  middeck outcome comparison.json
"""


@click.command("outcome", cls=options.Verb, examples=EXAMPLES)
@click.argument("files", nargs=-1, required=True, metavar="PROMISE OUTCOME | COMPARISON...")
@click.option("--date", metavar="YYYY-MM-DD", help="Date of the document.  [default: today]")
@options.written("-o", "--output", "target", endings=(".json",), help="Write the sealed comparison.")
@figures.figure
@options.printing
def verb(
    files: tuple[str, ...], date: str | None, target: str | None, figure_file: str | None, as_json: bool
) -> None:
    """Compare a measured outcome with its promise, or score many.

    OUTCOME holds the measured frequencies, shapes and decibels (docs/reference/files.md). Modes are paired
    with promised ones by shape if OUTCOME names a survey, otherwise by name or number; ambiguous pairs are
    marked. The comparison names the promise by its hash. A changed promise is refused; a changed input file
    of the promise is reported.

    COMPARISONs of many promises, as this verb writes them, are scored together.
    """
    from middeck.files.disk.kind_of_content import COMPARED, looks_like
    from middeck.files.json.output import write_json
    from middeck.files.promises.scores import score_document

    if all(looks_like(file) == COMPARED for file in files):
        if figure_file is not None:
            raise ConfigError(f"--figure {figure_file}", hint="one PROMISE.json and its OUTCOME to draw")
        document = score_document(files, date=options.day(date))
        if target is not None:
            write_json(target, document)
        show(as_json, document, *_scores(document), *([f"wrote {target}"] if target else []))
        return
    if len(files) != 2:
        raise ConfigError(
            f"{len(files)} files where two belong", hint="PROMISE.json OUTCOME, or COMPARISON.json of many"
        )
    _compare(*files, date, target, figure_file, as_json)


def _compare(
    promise: str, outcome: str, date: str | None, target: str | None, figure_file: str | None, as_json: bool
) -> None:
    from middeck.files.json.output import write_json
    from middeck.files.promises.outcomes import comparison_document, load_outcomes
    from middeck.files.promises.promise_file import read_promise

    promised = read_promise(promise)
    came = load_outcomes(outcome)
    with reading(outcome):
        document = comparison_document(promised, came, date=options.day(date), beside=Path(promise).parent)
    if target is not None:
        write_json(target, document)
    if figure_file is not None:
        figures.write_promise(
            promised, {(v["kind"], v["name"]): v for v in document["verdicts"]}, figure_file
        )
    show(as_json, document, *_blocks(document, target))


def _scores(document: dict[str, Any]) -> list[str | ScreenTable]:
    scored = {**document["by_kind"], "all": document["score"]}
    rows = [
        [
            kind,
            str(s["count"]),
            f"{100.0 * s['coverage']:.1f}",
            "{:.1f} to {:.1f}".format(*(100.0 * end for end in s["coverage_interval_95"])),
            *cells(s, "brier:.4f", "pessimism_db:.2f", "lost"),
        ]
        for kind, s in scored.items()
    ]
    headers = ["quantity", "count", "inside [%]", "95 % interval", "Brier score", "pessimism [dB]", "lost"]
    return [ScreenTable(f"score of {len(document['comparisons'])} comparisons", headers, rows)]


def _blocks(document: dict[str, Any], target: str | None) -> list[str | ScreenTable]:
    rows = [
        [
            f"{v['name']}, {v['mode']}" if v["kind"] == "mode" else v["name"],
            _pairing(v),
            " to ".join(number(end, ".5g", "unstable") for end in v["promised"]),
            number(v["value"], ".5g", "unstable"),
            "yes" if v["inside"] else "NO",
            number(v["pessimism_db"], ".2f"),
        ]
        for v in document["verdicts"]
    ]
    s = document["score"]
    summary = [
        f"promised on   {document['promised_on']}, {document['promise'][:12]}...",
        f"inside        {100.0 * s['coverage']:.0f} % of {s['count']}",
        *([] if s["brier"] is None else [f"Brier score   {s['brier']:.4f}"]),
        *([] if s["pessimism"] is None else [f"pessimism     {s['pessimism']:.2f} dB in the median"]),
        *([f"lost          {s['lost']}: came unstable, or no decibels promised"] if s["lost"] else []),
    ]
    headers = ["quantity", "paired by", "promised, 95 % interval", "came", "inside", "pessimism [dB]"]
    remarks = (
        ["", "remarks", *(f"  {remark}" for remark in document["remarks"])] if document["remarks"] else []
    )
    return [
        *summary,
        ScreenTable("outcomes", headers, rows),
        *remarks,
        *(["", f"wrote {target}"] if target else []),
    ]


def _pairing(verdict: dict[str, Any]) -> str:
    if verdict["kind"] != "mode":
        return "name"
    by = verdict["paired_by"] if verdict["mac"] is None else f"shape, MAC {verdict['mac']:.2f}"
    return f"{by}: open" if verdict["open"] else by
