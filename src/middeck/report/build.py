"""Write a study's results as they come: figures at once, numbers and report at the end, whole files only."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from middeck.files.atomic import replacing
from middeck.files.json_output import plain, write_json
from middeck.files.studies import Study
from middeck.plot.picture import picture
from middeck.plot.svg import svg_text
from middeck.report.drawings import DRAWINGS, draw_stage
from middeck.report.page import render_page
from middeck.report.words import Numbers
from middeck.structure.comparison import ModeComparison
from middeck.study.numbers import figure_numbers, study_numbers
from middeck.study.stages import Outcome
from middeck.study.zero_g_control import ZeroGControl

PICTURE = "mace-1993"  # figures/mace-1993.svg: the picture of the front page


class StudyWriter:
    """Results of ``study`` in the folder ``out``: figures/*.svg, numbers.json, report.html.

    It collects what the stages hand over; nothing of it depends on a clock, so that equal results give equal
    bytes. What an earlier run left in ``out`` is removed at the start, so that a run cut short never leaves
    its figures beside another run's numbers; files of other names stay.
    """

    def __init__(self, out: Path, study: Study) -> None:
        self._out = out
        self._study = study
        self._outcomes: dict[str, Outcome] = {}
        self._drawings: dict[str, str] = {}
        _remove_earlier(out)

    def add(self, name: str, outcome: Outcome) -> None:
        """Draw the figures of one stage and write each to ``figures``."""
        self._outcomes[name] = outcome
        drawings = draw_stage(outcome, cast("Numbers", plain(figure_numbers(outcome))))
        self._drawings |= drawings
        for key, svg in drawings.items():
            write_text(self._out / "figures" / f"{key}.svg", svg)

    def finish(self) -> None:
        """Write numbers.json, the page, and the picture where its two stages have run."""
        numbers = cast("Numbers", plain(study_numbers(self._study, self._outcomes)))
        write_json(self._out / "numbers.json", numbers)
        write_text(self._out / "report.html", render_page(self._study.title, numbers, self._drawings))
        self._write_picture()

    def _write_picture(self) -> None:
        found = {type(outcome): outcome for outcome in self._outcomes.values()}
        modes, control = found.get(ModeComparison), found.get(ZeroGControl)
        if isinstance(modes, ModeComparison) and isinstance(control, ZeroGControl):
            words = (
                "Performance of 0-g controllers in 0-g and 1-g, suspension modes, ratios of flexible modes."
            )
            svg = svg_text(picture(modes, control), key=PICTURE, title=self._study.title, description=words)
            write_text(self._out / "figures" / f"{PICTURE}.svg", svg)


def _remove_earlier(out: Path) -> None:
    """First the page and the numbers: they speak for all the rest."""
    keys = [PICTURE, *(d.key for stage in DRAWINGS.values() for d in stage)]
    for name in ("report.html", "numbers.json", *(f"figures/{key}.svg" for key in keys)):
        (out / name).unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """``text`` to ``path``, whole or not at all, with the same bytes on every system."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
