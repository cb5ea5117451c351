"""One row of the claims: what is claimed, whether it holds here, and the number that says so.

The paper prints 36 dB in 0-g (40 dB was its target), over an order of magnitude in rms, and orderings; where
a word such as "much higher" needs a number to be judged by, the number stands in the claim. Every row is
always there: where a loop is unstable or nothing was found there is no number, and what would need it does
not hold.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypedDict


class Claim(TypedDict):
    """One row: ``number`` and ``asked`` are in one ``unit`` and have one sign.

    A number of decibels is a change: negative is less.
    """

    claim: str
    holds: bool
    number: float | str | None
    asked: str
    unit: str


def row(claim: str, holds: bool, number: float | str | None, asked: str, unit: str = "") -> Claim:
    """A claim with its verdict, its number and what that is asked to be."""
    return {"claim": claim, "holds": bool(holds), "number": number, "asked": asked, "unit": unit}


def at_most(claim: str, number: float | None, most: float, unit: str = "dB") -> Claim:
    """It holds where there is a number that is no larger than ``most``."""
    return row(claim, number is not None and number <= most, number, f"\u2264 {most:g}", unit)


def below(claim: str, number: float | None, limit: float, unit: str = "dB") -> Claim:
    """It holds where there is a number that is smaller than ``limit``."""
    return row(claim, number is not None and number < limit, number, f"< {limit:g}", unit)


def above(claim: str, number: float | None, limit: float, unit: str = "dB") -> Claim:
    """It holds where there is a number that is larger than ``limit``."""
    return row(claim, number is not None and number > limit, number, f"> {limit:g}", unit)


def largest(values: Iterable[float | None]) -> float | None:
    """The largest of some numbers; None where one is missing or there are none."""
    given = list(values)
    known = [value for value in given if value is not None]
    return max(known) if known and len(known) == len(given) else None
