"""``middeck study``: every stage of a study, its figures and its report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.screen import ScreenTable, show

if TYPE_CHECKING:
    from middeck.files.studies.documents import Study

EXAMPLES = """\
  middeck study studies/mace-1993.toml -o out/mace-1993
  middeck study mace-1993 -o out/soft --set suspension.bounce_hz=0.2
"""


@click.command("study", cls=options.Verb, examples=EXAMPLES)
@click.argument("study_file", metavar="STUDY")
@click.option(
    "-o",
    "--output",
    "out",
    metavar="PATH",
    required=True,
    callback=options.require_folder,
    help="Folder of the results.",
)
@options.common
def verb(study_file: str, out: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Run STUDY: write report.html, numbers.json and figures/*.svg.

    Files are written whole as soon as their stage is done; an interrupted run leaves whole files only.
    """
    from middeck.files.setups import find_document

    path = find_document(study_file, "study")
    times = _run(md.load_study(path, overrides), out)
    files = sorted(p for p in out.rglob("*") if p.is_file())
    document = {"schema": "middeck.study/1", "study": path, "out": out, "time_s": times, "files": files}
    rows = [[name, f"{seconds:.1f}"] for name, seconds in (*times.items(), ("all", sum(times.values())))]
    show(as_json, document, f"report  {out / 'report.html'}", ScreenTable("times", ["stage", "s"], rows))


def _run(study: Study, out: Path) -> dict[str, float]:
    """Seconds that each stage and its figures took."""
    from middeck.cli.shown.progress import follow
    from middeck.report.results_folder import StudyWriter
    from middeck.study.mission import chapters_in, run_chapters

    writer, times, chapters = StudyWriter(out, study), {}, chapters_in(study)
    called = {c.name: c.name if study.account else c.topic for c in chapters}
    with follow({called[c.name]: c.share for c in chapters}) as (begin, end):
        for name, compute in run_chapters(study):
            start, title = time.monotonic(), called[name]
            begin(title)
            writer.add(name, compute())
            times[title] = time.monotonic() - start
            end(title, times[title])
    writer.finish()
    return times
