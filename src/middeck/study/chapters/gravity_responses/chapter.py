"""Figure 6: one torque to payload and bus rates, as modelled in 0-g and 1-g and as measured on the rig."""

from functools import partial

from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.gravity_responses import computation, numbers_and_claims, text
from middeck.study.chapters.gravity_responses.figure_6 import figure_6

GRAVITY_RESPONSES = Chapter(
    name="figure 6",
    topic="responses in 0-g and 1-g",
    tables=("figure_6", "rig", "siso"),
    share=0.01,
    stream=1,
    compute=computation.compute,
    entries=(
        ChapterEntry(
            key="figure_6",
            numbers=numbers_and_claims.figure_6,
            claims_at="figure-6a",
            warnings_at="figure-6b",
        ),
    ),
    drawings=(
        ChapterDrawing(
            key="figure-6a",
            title=partial(text.title, output=0),
            draw=partial(figure_6, output=0),
            sentence=partial(text.sentence, output=0),
        ),
        ChapterDrawing(
            key="figure-6b",
            title=partial(text.title, output=1),
            draw=partial(figure_6, output=1),
            sentence=partial(text.sentence, output=1),
            tables=text.response_tables,
        ),
    ),
)
