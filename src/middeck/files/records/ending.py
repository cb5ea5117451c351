"""Detects a text of numbers that was truncated.

A file cut after a whole line cannot be recognised. A last line that lacks values is refused when it is read;
one whose last number lost digits would be read with a wrong value (1.5e-0 of 1.5e-03). It is recognised by
the missing end of line and by fewer digits than other lines have.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from middeck.files.records.raw import ChannelHeader, channel_fault
from middeck.signals.fault import RecordFault

# Bytes at the end of a file that are looked at.
TAIL = 1 << 18
# Fewest lines from which the last one, if it has its end, counts as cut: of fewer it may be the shortest by
# chance. A logger or an editor may have ended it.
FEWEST_ENDED = 200
# Share of the numbers that may have as few digits as the last one, where each is printed with its own.
RARE = 0.01
NUMBER = re.compile(r"[+-]?\d*\.?(\d*)(?:[eEdD][+-]?(\d+))?")


def cut_short(file: Path, heads: Sequence[ChannelHeader], separator: str) -> tuple[RecordFault, ...]:
    """A fault where the last number is short of digits, and a note where the last line has no end."""
    with open(file, "rb") as content:
        size = content.seek(0, os.SEEK_END)
        content.seek(max(0, size - TAIL))
        tail = content.read()
    ended = tail.endswith((b"\n", b"\r"))
    lines = [line for line in tail.decode("utf-8", "replace").splitlines() if line.strip()][1:]
    cells = [line.split(separator)[-1].strip() for line in lines if not line.startswith("#")]
    if len(cells) < (FEWEST_ENDED if ended else 2):
        return ()
    # What is not a number was not cut, and a signal may end in a zero, which is printed short.
    whole = NUMBER.fullmatch(cells[-1]) is None or (ended and not cells[-1].strip("+-0."))
    short = not whole and is_short(cells[-1], cells[:-1])
    if ended and not short:
        return ()
    rare = not whole and not ended and not short and is_rarely_short(cells[-1], cells[:-1])
    what = f"the last line {'' if ended else 'has no end; it '}ends in the value {cells[-1]}"
    fewer = "all before it" if short else "99 % of those before it"
    what += f", with fewer digits than {fewer}: the file was cut there" if short or rare else ""
    hint = "copy or record it again; a file that is whole ends its last line"
    return (channel_fault("truncated", "serious" if short or rare else "note", heads[-1], what, hint),)


def is_short(cell: str, others: Sequence[str]) -> bool:
    """Whether a number has fewer decimals, or digits in its exponent, than all others of its column.

    >>> is_short("0.12", ["0.125", "-3.500"]), is_short("1.5e-0", ["2.5e-03"]), is_short("0.1", ["0.25", "2"])
    (True, True, False)
    """
    mine, *each = (_digits(text) for text in (cell, *others))
    exponents = [e for _, e in each]
    lost = mine[1] < min(exponents) or 0 < mine[1] < min((e for e in exponents if e), default=2)
    return lost or mine[0] < min(d for d, _ in each)


def is_rarely_short(cell: str, others: Sequence[str]) -> bool:
    """Whether nearly all of many numbers with decimals have more significant digits than ``cell``.

    >>> is_rarely_short("0.1", ["0.125", "1.25"] * 100), is_rarely_short("12", ["125", "13"] * 100)
    (True, False)
    >>> is_rarely_short("0.00", ["0.00125", "1.25"] * 100), is_rarely_short("0", ["0.00125", "1.25"] * 100)
    (True, False)
    """
    mine, decimal = _significant(cell), np.mean(["." in text for text in others])
    share = np.mean(np.array([_significant(text) for text in others]) <= mine)
    # No printer of as many digits as a number needs writes a zero so; as 0 or 0.0 a signal may end.
    can_end = mine == 0 and cell.strip("+-") in ("0", "0.0")
    return bool(not can_end and len(others) >= FEWEST_ENDED - 1 and decimal > 1.0 - RARE and share < RARE)


def _significant(text: str) -> int:
    """Digits of a number, those of its exponent and zeros before it apart."""
    return len(re.split("[eEdD]", text)[0].replace(".", "").lstrip("+-0"))


def _digits(text: str) -> tuple[int, int]:
    found = NUMBER.fullmatch(text)
    return (0, 0) if found is None else (len(found.group(1)), len(found.group(2) or ""))
