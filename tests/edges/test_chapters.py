"""Chapters of the study: known to the list of chapters, the first picture and one verb alone."""

import re
from pathlib import Path

import numpy as np
import pytest

import middeck
from middeck.report import page
from middeck.study import mission
from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.mission import CHAPTERS, run_chapters, study_numbers
from middeck.study.words import Line

SOURCE = Path(middeck.__file__).parent
ROOMS = [*(SOURCE / "report").glob("*.*"), *(SOURCE / "plot").glob("*.py")]


def test_no_two_chapters_share_a_name_a_stream_an_entry_or_a_drawing():
    for values in (
        [c.name for c in CHAPTERS],
        [c.stream for c in CHAPTERS],
        [e.key for c in CHAPTERS for e in c.entries],
        [d.key for c in CHAPTERS for d in c.drawings],
    ):
        assert len(set(values)) == len(values)


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda c: c.name)
def test_claims_and_warnings_stand_under_drawings_of_the_chapter(chapter):
    places = {place for e in chapter.entries for place in (e.claims_at, e.warnings_at)}
    assert places <= {d.key for d in chapter.drawings}


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda c: c.name)
def test_streams_are_those_that_the_seed_spawns(chapter):
    spawned = np.random.SeedSequence(7).spawn(len(CHAPTERS))[CHAPTERS.index(chapter)]
    assert chapter.rng(7).integers(2**63) == np.random.default_rng(spawned).integers(2**63)


@pytest.mark.parametrize("path", ROOMS, ids=lambda p: p.name)
def test_report_and_plot_know_no_figure_of_the_paper(path):
    found = re.findall(r"figure[-_ ]\d+[ab]?|mirror", path.read_text(encoding="utf-8"), re.IGNORECASE)
    assert found == []


def toy(name: str, stream: int, needs=()) -> Chapter:
    """A chapter whose outcome is what it was given and what it drew."""
    return Chapter(
        name=name,
        topic=name,
        share=0.5,
        stream=stream,
        needs=needs,
        compute=lambda study, rng, *values: (*values, float(rng.random())),
        entries=(
            ChapterEntry(
                key=name,
                numbers=lambda outcome: {"warnings": [f"{name} warns"]},
                claims_at=name,
                warnings_at=name,
            ),
        ),
        drawings=(
            ChapterDrawing(
                key=name, title=name, draw=lambda outcome: None, sentence=lambda figures: f"It is {name}."
            ),
        ),
        result=lambda figures: Line(f"{name} came out.", name),
        shortfalls=lambda figures: [Line(f"{name} falls short.", name)],
    )


@pytest.fixture
def toys(monkeypatch):
    """Two chapters in the place of the paper's, and how often the value they need is computed."""
    asked = []

    def shared(study):
        asked.append(study)
        return "shared"

    chapters = (toy("one", 3, (shared,)), toy("two", 0, (shared,)))
    # Both are imported above: one imported later would take these for the paper's, and keep them.
    for module in (mission, page):
        monkeypatch.setattr(module, "CHAPTERS", chapters)
    return chapters, asked


def test_chapters_run_in_any_order_on_values_computed_once(toys, paper_study):
    chapters, asked = toys
    runs = dict(run_chapters(paper_study))
    backward = {name: runs[name]() for name in ("two", "one")}
    assert asked == [paper_study]
    assert backward == {c.name: ("shared", float(c.rng(paper_study.seed).random())) for c in chapters}
    assert list(study_numbers(paper_study, backward)["figures"]) == ["one", "two"]


def test_a_new_chapter_is_reported_with_no_other_change(toys):
    from middeck.report.page import came_out, does_not_hold

    chapters, _ = toys
    figures = {key: table for c in chapters for key, table in c.tabulate(None).items()}
    assert [line.text for line in came_out(figures, [])] == ["one came out.", "two came out."]
    lines = [line.text for line in does_not_hold(figures, [])]
    assert lines[:2] == ["one falls short.", "two falls short."]
    assert lines[2].startswith("2 warnings")
    assert [line.text for line in came_out({"two": {}}, [])] == ["two came out."]
