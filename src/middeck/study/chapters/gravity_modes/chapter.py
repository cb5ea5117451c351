"""Figures 3, 4 and 5: effects of gravity and suspension on shape and modes."""

from typing import Any

from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.gravity_modes import numbers, text
from middeck.study.chapters.gravity_modes.figure_3 import figure_3
from middeck.study.chapters.gravity_modes.figures_4_5 import figure_4, figure_5
from middeck.study.shared import compare_environments

TITLE_3 = "Figure 3: the article in 0-g and at rest in 1-g"
TITLE_4 = "Figure 4: eigenfrequencies and eigenratios"
TITLE_5 = "Figure 5: cross-orthogonality of 0-g and 1-g modes"


def compute(study: Any, rng: Any, comparison: ModeComparison) -> ModeComparison:
    """The comparison itself, which Figure 7 needs too."""
    return comparison


GRAVITY_MODES = Chapter(
    name="figures 4 and 5",
    topic="modes in 0-g and 1-g",
    tables=("control",),
    share=0.02,
    stream=0,
    needs=(compare_environments,),
    compute=compute,
    entries=(
        ChapterEntry(key="figure_4", numbers=numbers.figure_4),
        ChapterEntry(key="figure_5", numbers=numbers.figure_5),
    ),
    drawings=(
        ChapterDrawing(
            key="figure-3", title=TITLE_3, draw=figure_3, sentence=text.figure_3, tables=text.rest_tables
        ),
        ChapterDrawing(
            key="figure-4", title=TITLE_4, draw=figure_4, sentence=text.figure_4, tables=text.mode_tables
        ),
        ChapterDrawing(
            key="figure-5",
            title=TITLE_5,
            draw=figure_5,
            sentence=text.figure_5,
            tables=text.orthogonality_tables,
        ),
    ),
    result=text.result,
)
