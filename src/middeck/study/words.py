"""How numbers are written in the report, and what a table and a line of it are."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

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
    """A standard deviation in ``unit`` behind its ``sign``, or that there is none.

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
    """With its sign.

    >>> signed(2.0)
    '+2'
    """
    return f"{value:+g}".replace("-", "\N{MINUS SIGN}")
