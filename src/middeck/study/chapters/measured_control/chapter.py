"""Figures 9a and 9b: a fit to a measured response, and loops designed on it."""

from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.measured_control import computation, numbers_and_claims, text
from middeck.study.chapters.measured_control.figure_9 import figure_9a, figure_9b
from middeck.study.shared import rig_article

TITLE_A = "Figure 9a: measured response and fit"
TITLE_B = "Figure 9b: open and closed loops"

MEASURED_CONTROL = Chapter(
    name="figure 9",
    topic="a measured loop",
    tables=("siso",),
    share=0.39,
    stream=3,
    needs=(rig_article,),
    compute=computation.compute,
    entries=(
        ChapterEntry(key="figure_9a", numbers=numbers_and_claims.figure_9a),
        ChapterEntry(key="figure_9b", numbers=numbers_and_claims.figure_9b),
    ),
    drawings=(
        ChapterDrawing(
            key="figure-9a", title=TITLE_A, draw=figure_9a, sentence=text.figure_9a, tables=text.fit_tables
        ),
        ChapterDrawing(
            key="figure-9b", title=TITLE_B, draw=figure_9b, sentence=text.figure_9b, tables=text.loop_tables
        ),
    ),
    result=text.result,
    shortfalls=text.shortfalls,
)
