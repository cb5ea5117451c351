"""Figures 10, 11 and 12: three paths fitted together, and loops closed on two of them."""

from functools import partial

from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.two_sensor_control import computation, numbers_and_claims, text
from middeck.study.chapters.two_sensor_control.figures_10_to_12 import figure_10, figure_11, figure_12
from middeck.study.shared import rig_article

TITLE_11 = "Figure 11: payload controlled by feedback of encoder and bus"
TITLE_12A = "Figure 12a: payload under both penalties"
TITLE_12B = "Figure 12b: bus under both penalties"

TWO_SENSOR_CONTROL = Chapter(
    name="figures 10 to 12",
    topic="two sensors",
    tables=("sito",),
    share=0.46,
    stream=4,
    needs=(rig_article,),
    compute=computation.compute,
    entries=(
        ChapterEntry(key="figure_10a", numbers=numbers_and_claims.figure_10a),
        ChapterEntry(key="figure_10b", numbers=numbers_and_claims.figure_10b),
        ChapterEntry(key="figure_11", numbers=numbers_and_claims.figure_11),
        ChapterEntry(
            key="figure_12",
            numbers=numbers_and_claims.figure_12,
            claims_at="figure-12a",
            warnings_at="figure-12b",
        ),
    ),
    drawings=(
        ChapterDrawing(
            key="figure-10a",
            title=partial(text.title_10, entry="figure_10a"),
            draw=partial(figure_10, output=1),
            sentence=partial(text.figure_10, entry="figure_10a"),
            tables=text.encoder_tables,
        ),
        ChapterDrawing(
            key="figure-10b",
            title=partial(text.title_10, entry="figure_10b"),
            draw=partial(figure_10, output=2),
            sentence=partial(text.figure_10, entry="figure_10b"),
            tables=text.bus_tables,
        ),
        ChapterDrawing(
            key="figure-11", title=TITLE_11, draw=figure_11, sentence=text.figure_11, tables=text.reach_tables
        ),
        ChapterDrawing(
            key="figure-12a", title=TITLE_12A, draw=partial(figure_12, output=0), sentence=text.figure_12a
        ),
        ChapterDrawing(
            key="figure-12b",
            title=TITLE_12B,
            draw=partial(figure_12, output=2),
            sentence=text.figure_12b,
            tables=text.both_tables,
        ),
    ),
    result=text.result,
    shortfalls=text.shortfalls,
)
