"""What came beside what was promised, and how good many promises were."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.errors import DataError
from middeck.values import record


@record(kw_only=True)
class Statement:
    """What was said of one quantity before it was known.

    Attributes:
        low, high: Its 95 % interval, in its unit; ``inf`` where it may be lost altogether.
        probability: Of a loop, that it is stable; None for other quantities.
        cautious: Of a loop, the decibels that it reaches with 99 %; None for other quantities.
    """

    name: str
    low: float
    high: float
    probability: float | None = None
    cautious: float | None = None


@record(kw_only=True)
class Outcome:
    """What came of it; an unstable loop has no ``value``."""

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

    name: str
    inside: bool
    brier: float | None
    pessimism: float | None


@record(kw_only=True)
class Score:
    """Over many verdicts.

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


def judge(statements: Sequence[Statement], outcomes: Sequence[Outcome]) -> tuple[Verdict, ...]:
    """Each outcome beside the statement of its name; statements without an outcome are left open.

    Raises `DataError` for an outcome of which nothing was said, or two of one name,
    and for two statements of one name.
    """
    known = {s.name: s for s in statements}
    if len(known) < len(statements):
        said = [s.name for s in statements]
        both = next(n for n in said if said.count(n) > 1)
        raise DataError(f"two statements of {both!r}", where="promise", hint="another name for one of them")
    for outcome in outcomes:
        if outcome.name not in known:
            raise DataError(
                f"nothing was promised of {outcome.name!r}",
                where="outcome",
                hint=f"one of {', '.join(known) or 'nothing'}",
            )
    names = [o.name for o in outcomes]
    twice = [n for n in names if names.count(n) > 1]
    if twice:
        raise DataError(f"two outcomes of {twice[0]!r}", where="outcome", hint="one of each")
    return tuple(_verdict(known[o.name], o) for o in outcomes)


def score(verdicts: Sequence[Verdict]) -> Score:
    """Coverage, Brier's score and pessimism. Raises `DataError` for no verdict."""
    if not verdicts:
        raise DataError("no outcome to score", where="score", hint="one at least")
    brier = [v.brier for v in verdicts if v.brier is not None]
    pessimism = [v.pessimism for v in verdicts if v.pessimism is not None]
    return Score(
        count=len(verdicts),
        coverage=float(np.mean([v.inside for v in verdicts])),
        brier=float(np.mean(brier)) if brier else None,
        pessimism=float(np.median(pessimism)) if pessimism else None,
        lost=len(brier) - len(pessimism),
    )


def _verdict(said: Statement, came: Outcome) -> Verdict:
    lost = not came.stable or came.value is None
    value = np.inf if lost else float(came.value or 0.0)
    cautious = said.cautious
    return Verdict(
        name=said.name,
        inside=bool(said.low <= value <= said.high),
        brier=None if said.probability is None else (said.probability - float(came.stable)) ** 2,
        pessimism=None if cautious is None or lost or not np.isfinite(cautious) else cautious - value,
    )
