"""Figures 10, 11 and 12: three paths fitted together, and loops closed on two of them."""

from functools import partial

from middeck.study.chapter import Chapter, Drawing, Entry
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
        Entry("figure_10a", numbers_and_claims.figure_10a),
        Entry("figure_10b", numbers_and_claims.figure_10b),
        Entry("figure_11", numbers_and_claims.figure_11),
        Entry("figure_12", numbers_and_claims.figure_12, claims_at="figure-12a", warnings_at="figure-12b"),
    ),
    drawings=(
        Drawing(
            "figure-10a",
            partial(text.title_10, entry="figure_10a"),
            partial(figure_10, output=1),
            sentence=partial(text.figure_10, entry="figure_10a"),
            tables=text.encoder_tables,
        ),
        Drawing(
            "figure-10b",
            partial(text.title_10, entry="figure_10b"),
            partial(figure_10, output=2),
            sentence=partial(text.figure_10, entry="figure_10b"),
            tables=text.bus_tables,
        ),
        Drawing("figure-11", TITLE_11, figure_11, sentence=text.figure_11, tables=text.reach_tables),
        Drawing("figure-12a", TITLE_12A, partial(figure_12, output=0), sentence=text.figure_12a),
        Drawing(
            "figure-12b",
            TITLE_12B,
            partial(figure_12, output=2),
            sentence=text.figure_12b,
            tables=text.both_tables,
        ),
    ),
    result=text.result,
    shortfalls=text.shortfalls,
)
