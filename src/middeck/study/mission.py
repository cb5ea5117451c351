"""The study of the 1993 paper: the one list of its chapters, how they are run, and all their numbers."""

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

from middeck.files.promises.promise_documents import versions
from middeck.files.studies.documents import Study
from middeck.study.chapter import Chapter
from middeck.study.chapters.gravity_modes.chapter import GRAVITY_MODES
from middeck.study.chapters.gravity_responses.chapter import GRAVITY_RESPONSES
from middeck.study.chapters.measured_control.chapter import MEASURED_CONTROL
from middeck.study.chapters.mirror.chapter import MIRROR
from middeck.study.chapters.promise.chapter import PROMISE
from middeck.study.chapters.two_sensor_control.chapter import TWO_SENSOR_CONTROL
from middeck.study.chapters.zero_g_control.chapter import ZERO_G_CONTROL
from middeck.study.words import Numbers

CHAPTERS: tuple[Chapter[Any], ...] = (
    GRAVITY_MODES,
    GRAVITY_RESPONSES,
    ZERO_G_CONTROL,
    MEASURED_CONTROL,
    TWO_SENSOR_CONTROL,
    MIRROR,
    PROMISE,
)


def chapters_in(study: Study) -> tuple[Chapter[Any], ...]:
    """The chapters whose settings the study file has."""
    return tuple(chapter for chapter in CHAPTERS if study.has(*chapter.tables))


def run_chapters(study: Study) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Name and computation of each chapter; a chapter is computed when called, in any order."""

    @cache
    def value(need: Callable[[Study], Any]) -> Any:
        return need(study)

    def compute(chapter: Chapter[Any]) -> Any:
        return chapter.compute(study, chapter.rng(study.seed), *map(value, chapter.needs))

    for chapter in chapters_in(study):
        yield chapter.name, lambda chapter=chapter: compute(chapter)


def study_numbers(study: Study, outcomes: Mapping[str, Any]) -> Numbers:
    """The document ``numbers.json`` (by ``numbers.schema.json``) of ``outcomes`` by chapter; no clock."""
    figures: Numbers = {}
    for chapter in CHAPTERS:
        if chapter.name in outcomes:
            figures |= chapter.tabulate(outcomes[chapter.name])
    return {
        "schema": "1",
        "versions": versions(),
        "inputs": {**dict(study.inputs), "overrides": list(study.overrides), "seed": study.seed},
        "figures": figures,
    }
