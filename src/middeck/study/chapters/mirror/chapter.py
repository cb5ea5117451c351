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
            "mirror", numbers.mirror, claims_at="mirror", warnings_at="mirror", claims=claims.mirror_claims
        ),
    ),
    drawings=(Drawing("mirror", TITLE, drawing.mirror, sentences.mirror, tables.mirror_tables, SOURCE),),
    result=sentences.result,
)
