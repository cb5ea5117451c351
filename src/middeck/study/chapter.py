"""A chapter of the study: one question, from its computation to its place on the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from middeck.files.studies import Study
from middeck.study.claim import Claim
from middeck.study.words import Line, Numbers, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")


def nothing(figures: Numbers) -> list[Any]:
    """No tables, no claims, no lines."""
    return []


@dataclass(frozen=True, kw_only=True, eq=False)
class Section(Generic[T]):
    """One drawing and what stands around it on the page; ``figures`` are those of numbers.json.

    Parameters
    ----------
    key:
        In names of files and in links.
    title:
        A text, or a function of ``figures`` where it names what was measured.
    draw, sentence:
        The drawing of an outcome, and the one sentence that it is there to show.
    tables, claims:
        What is listed under it, and the claims that it shows, from ``figures``.
    warnings_of:
        The entry of ``figures`` whose warnings are shown here.
    note:
        Path in the package of HTML for the end.
    """

    key: str
    title: str | Callable[[Numbers], str]
    draw: Callable[[T], Figure]
    sentence: Callable[[Numbers], str]
    tables: Callable[[Numbers], list[Table]] = nothing
    claims: Callable[[Numbers], list[Claim]] = nothing
    warnings_of: str = ""
    note: str = ""

    def heading(self, figures: Numbers) -> str:
        """The title in words."""
        return self.title if isinstance(self.title, str) else self.title(figures)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chapter(Generic[T]):
    """One stage of the study, and all that is told of its outcome.

    Parameters
    ----------
    name, share:
        As progress is told, and the part of the whole time, measured, for the estimate of what remains.
    stream:
        Which stream of the study's seed it draws from; its own, so that it depends on no other chapter.
    needs, compute:
        ``compute(study, rng, *values)`` with a value of the study from each of ``needs``; values that
        several chapters need are computed once.
    numbers:
        The entries of numbers.json, each with its function of the outcome. One has a list ``claims`` where
        it judges some.
    sections:
        The drawings, in the order of the page.
    result, shortfalls:
        Of the summary: the line of what came out, and those of what does not hold beside claims and warnings.
    """

    name: str
    share: float
    stream: int
    needs: tuple[Callable[[Study], Any], ...] = ()
    compute: Callable[..., T]
    numbers: Mapping[str, Callable[[T], Numbers]]
    sections: tuple[Section[T], ...]
    result: Callable[[Numbers], Line] | None = None
    shortfalls: Callable[[Numbers], list[Line]] = nothing

    def rng(self, seed: int) -> np.random.Generator:
        """The chapter's own stream of ``seed``."""
        return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(self.stream,)))

    def tabulate(self, outcome: T) -> Numbers:
        """The entries of numbers.json for an outcome."""
        return {entry: of(outcome) for entry, of in self.numbers.items()}
