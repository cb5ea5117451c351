"""Form of numbers in the report, and its tables, lines and claims."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple, TypedDict

Numbers = dict[str, Any]

UNDETERMINED = "not determined by the data"


class Table(NamedTuple):
    """A caption, the column heads, and rows whose first cell names the row."""

    caption: str
    head: tuple[str, ...]
    rows: list[list[str]]


class Line(NamedTuple):
    """One line of the summary and the section that shows it."""

    text: str
    section: str


def fixed(value: float | None, digits: int) -> str:
    """``value`` with so many decimals, a true minus sign, a dash for None.

    >>> fixed(-1.25, 1), fixed(None, 1), fixed(-0.001, 1)
    ('−1.2', '–', '0.0')
    """
    if value is None:
        return "–"
    text = f"{value:.{digits}f}"
    return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", "−")


def significant(value: float | str | None, digits: int = 4) -> str:
    """``value`` to so many digits; texts stay as they are.

    >>> significant(123456.0), significant(4.1047e-6), significant("-2, +2"), significant(35.7)
    ('123500', '4.105e−6', '−2, +2', '35.7')
    """
    if isinstance(value, str):
        return value.replace("-", "−") or "none"
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if 1e-3 <= abs(value) < 1e6:
        decimals = digits - 1 - math.floor(math.log10(abs(value)))
        text = f"{round(value, decimals):.{max(decimals, 0)}f}"
        return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−")


def deviation(value: float | None, unit: float = 1.0, sign: str = "") -> str:
    """A standard deviation in ``unit`` behind its ``sign``, or the statement that there is none.

    >>> deviation(4.2e-6, 1e-3, "± "), deviation(None)
    ('± 0.0042', 'not determined by the data')
    """
    return UNDETERMINED if value is None else sign + significant(value / unit, 2)


def cells(numbers: Numbers, digits: dict[str, int]) -> list[str]:
    """The numbers of these names, each with so many decimals."""
    return [fixed(numbers[name], count) for name, count in digits.items()]


def percent(share: float, digits: int = 2) -> str:
    """A share in percent.

    >>> percent(0.0454)
    '4.54 %'
    """
    return f"{fixed(100.0 * share, digits)} %"


def signed(value: float) -> str:
    """The number with its sign.

    >>> signed(2.0)
    '+2'
    """
    return f"{value:+g}".replace("-", "\N{MINUS SIGN}")


def fields(record: object, *names: str) -> dict[str, Any]:
    """Fields of a record under their own names."""
    return {name: getattr(record, name) for name in names}


class Claim(TypedDict):
    """A claim, whether it holds here, and the number that shows it.

    ``number`` and ``asked`` are in one ``unit`` and have one sign; a number of decibels is a change: negative
    is less. Where a loop is unstable or nothing was found there is no number, and the claim does not hold. A
    word of the paper such as "much higher" is judged by a number that stands in the claim.
    """

    claim: str
    holds: bool
    number: float | str | None
    asked: str
    unit: str


def row(claim: str, holds: bool, number: float | str | None, asked: str, unit: str = "") -> Claim:
    """A claim with its verdict, its number and the requirement on that."""
    return {"claim": claim, "holds": bool(holds), "number": number, "asked": asked, "unit": unit}


def at_most(claim: str, number: float | None, most: float, unit: str = "dB") -> Claim:
    """Requirement: there is a number, and it is no larger than ``most``."""
    return row(claim, number is not None and number <= most, number, f"\u2264 {most:g}", unit)


def below(claim: str, number: float | None, limit: float, unit: str = "dB") -> Claim:
    """Requirement: there is a number, and it is smaller than ``limit``."""
    return row(claim, number is not None and number < limit, number, f"< {limit:g}", unit)


def above(claim: str, number: float | None, limit: float, unit: str = "dB") -> Claim:
    """Requirement: there is a number, and it is larger than ``limit``."""
    return row(claim, number is not None and number > limit, number, f"> {limit:g}", unit)


def largest(values: Iterable[float | None]) -> float | None:
    """The largest of some numbers; None where one is missing or there are none."""
    given = list(values)
    known = [value for value in given if value is not None]
    return max(known) if known and len(known) == len(given) else None
