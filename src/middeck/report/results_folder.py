"""Write a study's results as they come: figures at once, numbers and report at the end, whole files only."""

from pathlib import Path
from typing import Any, cast

from middeck.files.disk.atomic import write_text
from middeck.files.json.output import plain, write_json
from middeck.files.studies.documents import Study
from middeck.plot.svg import svg_text
from middeck.report.page import render_page
from middeck.study import picture
from middeck.study.chapter import Chapter
from middeck.study.mission import CHAPTERS, study_numbers
from middeck.study.words import Numbers


class StudyWriter:
    """Results of ``study`` in the folder ``out``: figures/*.svg, numbers.json, report.html.

    It collects what the chapters hand over; nothing of it depends on a clock, so that equal results give
    equal bytes. What an earlier run left in ``out`` is removed at the start, so that a run cut short never
    leaves its figures beside another run's numbers; files of other names stay.
    """

    def __init__(self, out: Path, study: Study) -> None:
        self._out = out
        self._study = study
        self._outcomes: dict[str, Any] = {}
        self._drawings: dict[str, str] = {}
        _remove_earlier(out)

    def add(self, name: str, outcome: Any) -> None:
        """Draw the figures of the chapter of this name and write each to ``figures``."""
        self._outcomes[name] = outcome
        (chapter,) = (c for c in CHAPTERS if c.name == name)
        drawings = draw_chapter(chapter, outcome, numbered=self._study.account is not None)
        self._drawings |= drawings
        for key, svg in drawings.items():
            write_text(self._out / "figures" / f"{key}.svg", svg)

    def finish(self) -> None:
        """Write numbers.json, the page, and the picture where its two chapters have run."""
        numbers = cast("Numbers", plain(study_numbers(self._study, self._outcomes)))
        write_json(self._out / "numbers.json", numbers)
        title = self._study.title
        page = render_page(title, numbers, self._drawings, account=self._study.account)
        write_text(self._out / "report.html", page)
        figure = picture.draw_picture(self._outcomes) if self._study.account else None
        if figure is not None:
            svg = svg_text(figure, key=picture.KEY, title=title, description=picture.WORDS)
            write_text(self._out / "figures" / f"{picture.KEY}.svg", svg)


def draw_chapter(chapter: Chapter[Any], outcome: Any, *, numbered: bool = True) -> dict[str, str]:
    """Key to SVG text of every drawing of one chapter; its title is ``numbered`` as in the 1993 paper."""
    figures = cast("Numbers", plain(chapter.tabulate(outcome)))
    titles = {d.key: d.heading(figures, numbered=numbered) for d in chapter.drawings}
    return {
        d.key: svg_text(d.draw(outcome), key=d.key, title=titles[d.key], description=d.sentence(figures))
        for d in chapter.drawings
    }


def _remove_earlier(out: Path) -> None:
    """First the page and the numbers: they speak for all the rest."""
    keys = [picture.KEY, *(drawing.key for chapter in CHAPTERS for drawing in chapter.drawings)]
    for name in ("report.html", "numbers.json", *(f"figures/{key}.svg" for key in keys)):
        (out / name).unlink(missing_ok=True)
