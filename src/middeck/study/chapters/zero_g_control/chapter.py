"""Figure 7: controllers designed on the 0-g model, impinged on the 0-g and the 1-g model."""

from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.zero_g_control import computation, numbers_and_claims, text
from middeck.study.chapters.zero_g_control.figure_7 import figure_7a, figure_7b
from middeck.study.shared import compare_environments

TITLE_A = "Figure 7a: performance against authority"
TITLE_B = "Figure 7b: the flexible modes alone"

ZERO_G_CONTROL = Chapter(
    name="figure 7",
    topic="controllers designed in 0-g",
    tables=("control",),
    share=0.08,
    stream=2,
    needs=(compare_environments,),
    compute=computation.compute,
    entries=(
        ChapterEntry(
            key="figure_7",
            numbers=numbers_and_claims.figure_7,
            claims_at="figure-7a",
            warnings_at="figure-7b",
        ),
    ),
    drawings=(
        ChapterDrawing(key="figure-7a", title=TITLE_A, draw=figure_7a, sentence=text.figure_7a),
        ChapterDrawing(
            key="figure-7b",
            title=TITLE_B,
            draw=figure_7b,
            sentence=text.figure_7b,
            tables=text.authority_tables,
        ),
    ),
    result=text.result,
)
