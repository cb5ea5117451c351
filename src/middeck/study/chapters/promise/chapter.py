"""From ground test to orbit: the promise, and its outcome."""

from middeck.study.chapter import Chapter, ChapterDrawing, ChapterEntry
from middeck.study.chapters.promise import computation, drawing, numbers_and_claims, text

TITLE_A = "Promise and outcome in orbit"
TITLE_B = "Three ways to a compensator for orbit"

PROMISE = Chapter(
    name="promise",
    topic="a promise for orbit",
    tables=("promise",),
    share=0.6,
    stream=6,
    compute=computation.compute,
    entries=(
        ChapterEntry(
            key="promise", numbers=numbers_and_claims.promise, claims=numbers_and_claims.promise_claims
        ),
    ),
    drawings=(
        ChapterDrawing(
            key="promise",
            title=TITLE_A,
            draw=drawing.promised_and_came,
            sentence=text.promise,
            tables=text.promise_tables,
        ),
        ChapterDrawing(
            key="promise-routes",
            title=TITLE_B,
            draw=drawing.routes,
            sentence=text.routes,
            tables=text.route_tables,
        ),
    ),
    result=text.result,
    shortfalls=text.shortfalls,
)
