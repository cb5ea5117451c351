"""A real fine steering mirror through the same data arm."""

from middeck.study.chapter import Chapter, Drawing, Entry
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
    entries=(Entry("mirror", numbers_and_claims.mirror, claims=numbers_and_claims.mirror_claims),),
    drawings=(
        Drawing(
            "mirror", TITLE, drawing.mirror, sentence=text.mirror, tables=text.mirror_tables, note=SOURCE
        ),
    ),
    result=text.result,
)
