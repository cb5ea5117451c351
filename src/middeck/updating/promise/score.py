"""Outcomes beside promised intervals, and the score of many promises."""

from collections import Counter
from collections.abc import Sequence
from typing import Literal

import numpy as np

from middeck.errors import DataError
from middeck.values import record

Kind = Literal["mode", "compensator", "reading"]


@record(kw_only=True)
class Statement:
    """A statement about one quantity before it was known.

    Attributes:
        kind, name: The quantity, by both together: a compensator may have the name of a mode.
        low, high: Its 95 % interval, in its unit; ``inf`` where it may be lost altogether.
        probability: Probability that a loop is stable; None for other quantities.
        cautious: Decibels that a loop reaches with 99 % probability; None for other quantities.
    """

    kind: Kind
    name: str
    low: float
    high: float
    probability: float | None = None
    cautious: float | None = None


@record(kw_only=True)
class Scored:
    """The outcome of a statement; an unstable loop has no ``value``."""

    kind: Kind
    name: str
    value: float | None
    stable: bool = True


@record(kw_only=True)
class Verdict:
    """One statement beside its outcome.

    Attributes:
        inside: Whether the outcome lay within the interval; an unstable loop where one end was ``inf``.
        brier: (probability - what came)^2; None for other quantities than loops.
        pessimism: What was promised with 99 % less what came [dB], positive where more came than was
            promised; None without decibels.
    """

    kind: Kind
    name: str
    inside: bool
    brier: float | None
    pessimism: float | None


@record(kw_only=True)
class Score:
    """Scores over many verdicts.

    Attributes:
        coverage: Share of outcomes within their 95 % intervals.
        brier: Mean, of loops; 0 is perfect, 0.25 is a coin. None without loops.
        pessimism: Median [dB], of loops. None without decibels.
        lost: Loops that came unstable, or were promised no decibels with 99 %: not in the pessimism.
    """

    count: int
    coverage: float
    brier: float | None
    pessimism: float | None
    lost: int


def judge(statements: Sequence[Statement], outcomes: Sequence[Scored]) -> tuple[Verdict, ...]:
    """Each outcome beside the statement of its kind and name; statements without an outcome are left open.

    Raises `DataError` for an outcome without a statement, or two of one kind and name,
    and for two such statements.
    """
    known = {(s.kind, s.name): s for s in statements}
    _each_once("statements", statements, "promise", "another name for one of them")
    for outcome in outcomes:
        if (outcome.kind, outcome.name) not in known:
            names = ", ".join(name for kind, name in known if kind == outcome.kind)
            raise DataError(
                f"the promise has no {outcome.kind} {outcome.name!r}",
                where="outcome",
                hint=f"one of {names}" if names else f"it has no {outcome.kind}",
            )
    _each_once("outcomes", outcomes, "outcome", "one of each")
    return tuple(_verdict(known[o.kind, o.name], o) for o in outcomes)


def _each_once(what: str, given: Sequence[Statement] | Sequence[Scored], where: str, hint: str) -> None:
    for (kind, name), count in Counter((g.kind, g.name) for g in given).items():
        if count > 1:
            raise DataError(f"two {what} of {kind} {name!r}", where=where, hint=hint)


def score(verdicts: Sequence[Verdict]) -> Score:
    """Coverage, Brier's score and pessimism. Raises `DataError` for no verdict."""
    if not verdicts:
        raise DataError("no outcome to score", where="score", hint="at least one")
    brier = [v.brier for v in verdicts if v.brier is not None]
    pessimism = [v.pessimism for v in verdicts if v.pessimism is not None]
    return Score(
        count=len(verdicts),
        coverage=float(np.mean([v.inside for v in verdicts])),
        brier=float(np.mean(brier)) if brier else None,
        pessimism=float(np.median(pessimism)) if pessimism else None,
        lost=len(brier) - len(pessimism),
    )


def _verdict(statement: Statement, came: Scored) -> Verdict:
    lost = not came.stable or came.value is None
    value = np.inf if lost else float(came.value or 0.0)
    cautious = statement.cautious
    return Verdict(
        kind=statement.kind,
        name=statement.name,
        inside=bool(statement.low <= value <= statement.high),
        brier=None if statement.probability is None else (statement.probability - float(came.stable)) ** 2,
        pessimism=None if cautious is None or lost or not np.isfinite(cautious) else cautious - value,
    )
