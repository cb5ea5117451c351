"""A real fine steering mirror through the same data arm."""

from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.mirror import computation, drawing, numbers_and_claims, text

TITLE = "A real steering mirror, measured and fitted"
SOURCE = "study/chapters/mirror/source.html"

MIRROR = Chapter(
    name="mirror",
    topic="mirror",
    tables=("mirror",),
    share=0.04,
    stream=5,
    compute=computation.compute,
    entries=(
        ChapterEntry(
            key="mirror", numbers=numbers_and_claims.mirror, claims=numbers_and_claims.mirror_claims
        ),
    ),
    drawings=(
        ChapterDrawing(
            key="mirror",
            title=TITLE,
            draw=drawing.mirror,
            sentence=text.mirror,
            tables=text.mirror_tables,
            note=SOURCE,
        ),
    ),
    result=text.result,
)
