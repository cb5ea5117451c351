"""Limits of a verdict: ``stable``, or one such as ``gain_db=6``, on every row of a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import click

STABLE = "stable"


class Requirement(NamedTuple):
    """One limit; ``limit`` is None for stability itself."""

    quantity: str
    limit: float | None
    at_most: bool = False

    @property
    def text(self) -> str:
        """The requirement in words."""
        if self.limit is None:
            return STABLE
        return f"{self.quantity} {'<=' if self.at_most else '>='} {self.limit:g}"


def read_requirements(
    texts: Sequence[str], least: Sequence[str], most: Sequence[str]
) -> tuple[Requirement, ...]:
    """``stable`` and ``QUANTITY=LIMIT``; those of ``least`` must reach it, those of ``most`` not exceed it.

    >>> [r.text for r in read_requirements(["stable", "db=-20"], ["gain_db"], ["db"])]
    ['stable', 'db <= -20']
    """
    return tuple(_read(text, least, most) for text in texts)


def _read(text: str, least: Sequence[str], most: Sequence[str]) -> Requirement:
    if text == STABLE:
        return Requirement(STABLE, None)
    name, _, number = text.partition("=")
    try:
        limit = float(number)
    except ValueError:
        limit = math.nan
    if name not in (*least, *most) or not math.isfinite(limit):
        known = ", ".join((*least, *most))
        raise click.UsageError(f"--require {text}: stable, or one of {known} with its limit, as {least[0]}=6")
    return Requirement(name, limit, name in most)


def meets(requirement: Requirement, row: Mapping[str, Any]) -> bool:
    """Whether a row does; one that is not stable meets nothing, and what is not known is not met."""
    if not row[STABLE] or requirement.limit is None:
        return bool(row[STABLE])
    value = row[requirement.quantity]
    if value is None or math.isnan(value):
        return False
    return value <= requirement.limit if requirement.at_most else value >= requirement.limit
