"""Replication: cards that repeat fields of the card before, with increments.

``=`` repeats a field, ``==`` all that follow, ``*1`` or ``*(1)`` adds to it; ``=`` for the name makes one
card, ``=4`` or ``=(4)`` so many, each from the one before: by its own fields, or by those of the replicating
line before if it stands alone. After NASTRAN User's Manual, section 2.4.1, rules 5 to 9, and MSC Nastran,
Quick Reference Guide, Format of Bulk Data Entries. What these leave open (continuations, large fields) is
refused.
"""

import re
from collections.abc import Sequence
from decimal import Decimal

from middeck.files.nastran.deck.deck_lines import Line, fault_on
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.toml.faults import DocumentFault

# A card's name, its fields, its mark of a continuation, whether its fields are large, and its line.
Row = tuple[str, tuple[str, ...], str, bool, Line]

_COUNT = re.compile(r"=(?:\((\d{1,9})\)|(\d{1,9}))?$", re.ASCII)
_ADD = re.compile(r"\*(?:\(([^()]*)\)|([^()]*))$")
_EXPONENT = re.compile(r"(.*[0-9.])([ED][+-]?|[+-])(\d+)")
COPIES = frozenset(("=", "=="))
EQUATIONS = "DEQATN"  # equals signs are its own
MOST = 100_000  # cards of one line


def replicated(groups: Sequence[list[Row]], faults: list[DocumentFault]) -> list[list[Row]]:
    """The ``groups`` of rows, one a card, with those that replicate written out.

    Appends to ``faults`` what repeats nothing, counts that are none, and forms that are not read.
    """
    out: list[list[Row]] = []
    pattern: tuple[str, ...] | None = None
    spoilt = False  # after a fault, cards that repeat this one report nothing more
    for group in groups:
        head, fields, _, _, line = group[0]
        if head == EQUATIONS or not (head[0] == "=" or any(not COPIES.isdisjoint(row[1]) for row in group)):
            out.append(group)
            pattern, spoilt = None, False
            continue
        if spoilt:
            continue
        try:
            count = _count(head)
            pattern = _pattern(group, fields, pattern)
            before = _before(out, head)
            made: list[list[Row]] = []
            for _ in range(count):
                before = (before[0], _next(before[1], pattern), "", False, line)
                made.append([before])
        except ValueError as error:
            text = line[0].strip()[:40]
            faults.append(fault_on(line, "", str(error), text, "write the card out in full"))
            spoilt = True
            continue
        out += made
    return out


def _count(head: str) -> int:
    """Number of cards of a row."""
    if head[0] != "=":
        return 1
    found = _COUNT.match(head)
    if found is None:
        raise ValueError("replication is = or =n in the first field, the others between commas")
    number = found[1] or found[2]
    count = 1 if number is None else int(number)
    if not 0 < count <= MOST:
        raise ValueError(f"so many replications must be 1 to {MOST}")
    return count


def _pattern(group: list[Row], fields: tuple[str, ...], last: tuple[str, ...] | None) -> tuple[str, ...]:
    """Change of each field by a row: its own, or for a count that stands alone that of the row before."""
    if len(group) > 1 or group[0][2] or group[0][3]:
        raise ValueError("replication with a continuation or large fields is not read")
    if any(fields):
        return fields
    if last is None:
        raise ValueError("no line before says what to add from card to card")
    return last


def _before(out: list[list[Row]], head: str) -> Row:
    if not out:
        raise ValueError("there is no card before to repeat")
    if len(out[-1]) > 1 or out[-1][0][2] or out[-1][0][3]:
        raise ValueError("replication of a card with continuations or large fields is not read")
    before = out[-1][0]
    if head[0] != "=" and head != before[0]:
        raise ValueError(f"it repeats fields of a {before[0]}, the card before")
    return before


def _next(before: tuple[str, ...], pattern: tuple[str, ...]) -> tuple[str, ...]:
    fields: list[str] = []
    for k, text in enumerate(pattern):
        old = before[k] if k < len(before) else ""
        if text == "==":
            if any(pattern[k + 1 :]):
                raise ValueError("== stands for all fields that follow, and there are more")
            return (*fields, *before[k:])
        added = _ADD.match(text)
        if text == "=":
            fields.append(old)
        elif added:
            fields.append(_sum(old, added[1] if added[2] is None else added[2]))
        else:
            fields.append(text)
    return tuple(fields)


def _sum(old: str, more: str) -> str:
    """The number ``old`` and an increment of its kind, exactly."""
    if integer(old) is not None and integer(more) is not None:
        return str(int(old) + int(more))
    if real(old) is None or real(more) is None:
        raise ValueError(
            f"{more!r} cannot be added to {old!r}: two integers, or two reals with a decimal point"
        )
    digits, exponent = f"{_decimal(old) + _decimal(more):E}".split("E")
    return f"{digits}{'' if '.' in digits else '.'}E{exponent}"


def _decimal(text: str) -> Decimal:
    found = _EXPONENT.fullmatch(text)
    return Decimal(text if found is None else f"{found[1]}E{found[2].strip('ED')}{found[3]}")
