"""A chapter of the study: one question, from its computation to its place on the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from middeck.files.studies.documents import Study
from middeck.study.words import Claim, Line, Numbers, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")


def nothing(figures: Numbers) -> list[Any]:
    """No tables, no lines."""
    return []


@dataclass(frozen=True, kw_only=True, eq=False)
class ChapterEntry(Generic[T]):
    """One entry of ``figures`` in numbers.json, and the drawings where its claims and warnings stand.

    Without ``claims_at`` and ``warnings_at`` that is the drawing of its own name.
    """

    key: str
    numbers: Callable[[T], Numbers]
    claims_at: str = ""
    warnings_at: str = ""
    claims: Callable[[Numbers], list[Claim]] = lambda entry: entry.get("claims", [])

    def __post_init__(self) -> None:
        for place in ("claims_at", "warnings_at"):
            object.__setattr__(self, place, getattr(self, place) or self.key.replace("_", "-"))


@dataclass(frozen=True, kw_only=True, eq=False)
class ChapterDrawing(Generic[T]):
    """One drawing, the one sentence that it is to show, and the text under it on the page.

    ``key`` is its name in files and links. Title, sentence and tables are made of the ``figures`` of
    numbers.json; ``note`` is the path in the package of HTML for the end.
    """

    key: str
    title: str | Callable[[Numbers], str]
    draw: Callable[[T], Figure]
    sentence: Callable[[Numbers], str]
    tables: Callable[[Numbers], list[Table]] = nothing
    note: str = ""

    def heading(self, figures: Numbers, *, numbered: bool = True) -> str:
        """The title, which for some figures names the measured quantity.

        ``numbered`` with the number of the figure in the 1993 paper, which means nothing of another article.
        """
        title = self.title if isinstance(self.title, str) else self.title(figures)
        if numbered or not title.startswith("Figure "):
            return title
        words = title.partition(": ")[2]
        return words[:1].upper() + words[1:]


@dataclass(frozen=True, kw_only=True, eq=False)
class Chapter(Generic[T]):
    """One stage of the study, and all that the report shows of its outcome.

    Attributes:
        tables: Tables of the study file that the chapter needs; without them it is not run.
        name, topic: Names in progress reports, for a study of the 1993 paper and for any other.
        share: The part of the whole time, measured, for the estimate of what remains.
        stream: Stream of the study's seed from which it draws; its own, so that it depends on no other
            chapter.
        needs, compute: ``compute(study, rng, *values)`` with a value of the study from each of ``needs``;
            values that several chapters need are computed once.
        result, shortfalls: Lines of the summary: the result, and the shortfalls other than claims and
            warnings.
    """

    name: str
    topic: str
    tables: tuple[str, ...] = ()
    share: float
    stream: int
    needs: tuple[Callable[[Study], Any], ...] = ()
    compute: Callable[..., T]
    entries: tuple[ChapterEntry[T], ...]
    drawings: tuple[ChapterDrawing[T], ...]
    result: Callable[[Numbers], Line] | None = None
    shortfalls: Callable[[Numbers], list[Line]] = nothing

    def rng(self, seed: int) -> np.random.Generator:
        """The chapter's own stream of ``seed``."""
        return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(self.stream,)))

    def tabulate(self, outcome: T) -> Numbers:
        """The entries of numbers.json for an outcome."""
        return {entry.key: entry.numbers(outcome) for entry in self.entries}
