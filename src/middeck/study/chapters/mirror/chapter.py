"""A real fine steering mirror through the same data arm."""

from __future__ import annotations

from middeck.study.chapter import Chapter, Drawing, Entry
from middeck.study.chapters.mirror import claims, computation, drawing, numbers, sentences, tables

TITLE = "A real steering mirror, measured and fitted"
SOURCE = "study/chapters/mirror/source.html"

MIRROR = Chapter(
    name="mirror",
    share=0.04,
    stream=5,
    compute=computation.compute,
    entries=(
        Entry(
            key="mirror",
            numbers=numbers.mirror,
            claims_at="mirror",
            warnings_at="mirror",
            claims=claims.mirror_claims,
        ),
    ),
    drawings=(
        Drawing(
            key="mirror",
            title=TITLE,
            draw=drawing.mirror,
            sentence=sentences.mirror,
            tables=tables.mirror_tables,
            note=SOURCE,
        ),
    ),
    result=sentences.result,
)
