"""Logical cards: fields of free, small and large format, joined over continuations.

A line with a comma is free; one whose first eight columns hold an asterisk is large (fields of 16 columns),
any other small (of 8). A continuation begins with blanks, ``+`` or ``*``; with a mnemonic it belongs to the
line that ends with it, wherever that is, without one to the line before.
"""

from collections.abc import Callable, Iterable
from itertools import pairwise
from operator import itemgetter
from typing import NamedTuple

from middeck.files.nastran.deck.deck_lines import Line, fault_on
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.nastran.deck.replication import Row, replicated
from middeck.files.toml.faults import DocumentFault, raise_faults

ROW = 8  # fields in a row of either format
BLANKS = [""] * ROW


def _columns(width: int, count: int) -> Callable[[str], tuple[str, ...]]:
    """Cuts a line at its columns into ``count`` fields, at least two; a fourth of the time of a loop."""
    return itemgetter(*(slice(8 + width * k, 8 + width * (k + 1)) for k in range(max(2, count))))


# Columns of the fields of a line, by its length, at most 80.
NARROW = [_columns(8, min(ROW, (length - 1) // 8)) for length in range(81)]
WIDE = [_columns(16, count) for count in range(ROW // 2 + 1)]
MARKS = "+*"
BREAK = "break it with a continuation"
SKIPS = "a tab behind a full field, to which the next field is blank"
BLANK = "blanks or commas in place of the tabs of this line"
FIRST = "field 1"
SEQUENCE = "numbers of lines must stand on all without commas, and rise"


class Card(NamedTuple):
    """A card: its name, its fields after the name, and the lines with the number of their first field."""

    name: str
    fields: tuple[str, ...]
    lines: tuple[tuple[int, Line], ...]

    def line(self, field: int = 0) -> Line:
        """The line on which ``field`` (the first after the name is 0) stands or should stand."""
        return next(line for first, line in reversed(self.lines) if first <= field or not first)


# Places in a `Row`, one line cut up: a card's name or a continuation's mark, the fields, the mark at the end,
# whether the fields are large, and the line. A plain tuple, for there are as many as lines.
HEAD, FIELDS, TAIL, LARGE, LINE = 0, 1, 2, 3, 4


def join_cards(lines: Iterable[Line]) -> list[Card]:
    """The cards of bulk data ``lines``; raises `ConfigError` for lines that are no part of any card."""
    faults: list[DocumentFault] = []
    groups: list[list[Row]] = []
    apart: list[list[Row]] = []  # continuations whose parents are elsewhere, each with its followers
    group: list[Row] = []
    lines, strip = list(lines), str.strip
    whole = "\n".join([line[0] for line in lines]).upper()
    texts = whole.split("\n")  # all at once: a fifth of one by one
    tabs, stars, marked = "\t" in whole, "*" in whole, False
    for text, line in zip(texts, lines, strict=False):  # no lines are one text
        if "," in text:
            row = _cut_free(text, line)
            if isinstance(row, DocumentFault):
                faults.append(row)
                continue
        else:
            if tabs and "\t" in text:
                if _skips(text):
                    faults.append(_fault(line, SKIPS, hint=BLANK))
                text = text.expandtabs(8)
            text = text.rstrip()
            if len(text) > 80:
                faults += [_beyond(line, part) for part in text[80:].split() if _is_number(part)]
            head = text[:8].strip()
            if stars and "*" in head:
                row = _cut_large(head, text, line)
            else:  # here, not in a function: three in four lines of a large deck
                end = len(text)
                tail = text[72:80].strip() if end > 72 else ""
                fields = tuple(map(strip, NARROW[end if end < 80 else 80](text)))
                row = (head or "+", fields, tail, False, line)
        head = row[HEAD]
        if row[TAIL]:
            marked = True
        if head[0] not in MARKS:
            group = [row]
            groups.append(group)
            continue
        mark = _mark(head)
        if not group and not mark:
            faults.append(_fault(line, "a continuation of nothing", FIRST, head))
        elif group and (
            not mark or mark in (_mark(group[-1][TAIL]), _mark(group[-1][TAIL][1:]))
        ):  # column 73 is any
            group.append(row)
        else:
            group = [row]
            apart.append(group)
    if apart:
        faults += _adopt(groups, apart)
    if marked:
        counted = _are_counted(groups)
        for group in groups:
            faults += _forgotten(group, counted) if len(group) > 1 or group[0][TAIL] else []
    if "=" in whole:
        groups = replicated(groups, faults)
    raise_faults(faults)
    return _as_cards(groups)


def _as_cards(groups: list[list[Row]]) -> list[Card]:
    new = tuple.__new__  # half of the time of a named tuple's own
    return [
        new(Card, (row[HEAD], row[FIELDS], ((0, row[LINE]),)))
        if len(group) == 1 and (row := group[0])[FIELDS] and row[FIELDS][-1]
        else _joined(group)
        for group in groups
    ]


def _mark(text: str) -> str:
    """The name of a continuation; Nastran's own echo goes on at ``++000001`` where it wrote ``+000001``."""
    return text.lstrip(MARKS).strip()


def _adopt(groups: list[list[Row]], apart: list[list[Row]]) -> list[DocumentFault]:
    """Put continuations that stand elsewhere behind the rows that end with their marks."""
    faults: list[DocumentFault] = []
    waiting: dict[str, list[list[Row]]] = {}
    for group in apart:
        waiting.setdefault(_mark(group[0][HEAD]), []).append(group)
    for mark, found in waiting.items():
        faults += [
            _fault(g[0][LINE], f"a second continuation {mark!r}", FIRST, g[0][HEAD]) for g in found[1:]
        ]
    asked: dict[str, Line] = {}
    for group in groups:
        mark = _mark(group[-1][TAIL])
        while mark in waiting:
            if mark in asked:
                what = f"a second card that goes on at {mark!r}"
                faults.append(_fault(group[-1][LINE], what, _tenth(group), group[-1][TAIL]))
                break
            asked[mark] = group[-1][LINE]
            group += waiting[mark][0]
            mark = _mark(group[-1][TAIL])
    faults += [
        _fault(g[0][LINE], f"a continuation {mark!r} of no card", FIRST, g[0][HEAD])
        for mark, (g, *_) in waiting.items()
        if mark not in asked
    ]
    return faults


def _forgotten(group: list[Row], counted: bool) -> list[DocumentFault]:
    """Marks of continuations that are nowhere: those of a last row that announce one, and lone numbers.

    A number that no continuation names is a field too many, but where the lines of the deck are ``counted``,
    and where it is whole, a continuation without a name follows, and the eighth field is blank: Nastran too
    passes over it. Behind a filled one it may be the next of a list, such as a grid of an RBE3.
    """
    faults: list[DocumentFault] = []
    for row, after in zip(group, [*group[1:], None], strict=True):
        tail, is_free = row[TAIL], "," in row[LINE][0]
        if not tail or (after is not None and _mark(after[HEAD])):
            continue
        if tail[0] in MARKS:
            if after is None:
                hint = "is the deck whole? if the card ends here, clear its tenth field"
                what = f"the continuation {tail!r} is missing"
                faults.append(_fault(row[LINE], what, _tenth(group), tail, hint))
        elif is_free or not (
            counted or (after is not None and not _is_full(row) and integer(tail) is not None)
        ):
            faults += [_no_mark(group, row[LINE], tail)] if _is_number(tail) else []
    return faults


def _skips(text: str) -> bool:
    """Whether a tab follows a field that fills its columns, and thus skips a field."""
    *parts, _ = text.rstrip().split("\t")
    width = 16 if "*" in text[:8] else 8
    column = 0
    for part in parts:
        column += len(part)
        if part.strip() and column >= 8 and (column - 8) % width == 0:
            return True
        column += 8 - column % 8
    return False


def _is_full(row: Row) -> bool:
    """Whether a row's last field, the one before its mark, is filled."""
    room = ROW // 2 if row[LARGE] else ROW
    return len(row[FIELDS]) == room and bool(row[FIELDS][-1])


def _is_number(text: str) -> bool:
    return real(text) is not None or integer(text) is not None


def _no_mark(group: list[Row], line: Line, tail: str) -> DocumentFault:
    what = f"a number, {tail}, where the mark of a continuation stands"
    return _fault(line, what, _tenth(group), tail, f"{BREAK}; {SEQUENCE}")


def _beyond(line: Line, number: str) -> DocumentFault:
    return _fault(line, f"a number, {number}, behind column 80, where no field is", hint=BREAK)


def _are_counted(groups: list[list[Row]]) -> bool:
    """Whether columns 73 to 80 hold ascending integers on all lines without commas: sequence numbers."""
    tails = [row[TAIL] for group in groups for row in group if "," not in row[LINE][0]]
    numbers = [integer(tail) for tail in tails]
    known = [number for number in numbers if number is not None]
    rise = all(a < b for a, b in pairwise(known))
    return 2 <= len(known) == len(tails) and rise


def _tenth(group: list[Row]) -> str:
    """The field of the mark at the end of a card's line."""
    return " ".join([group[0][HEAD], *filter(None, group[0][FIELDS][:1]), "field 10"])


def _fault(
    line: Line, message: str, key: str = "", value: str = "", hint: str = "is the deck whole?"
) -> DocumentFault:
    return fault_on(line, key, message, value if key else line[0].strip()[:40], hint)


def _joined(group: list[Row]) -> Card:
    head, fields, _, _, line = group[0]
    if len(group) == 1:
        return Card(head, _filled(list(fields)), ((0, line),))
    joined: list[str] = []
    lines: list[tuple[int, Line]] = []
    half = False
    for _, row_fields, _, large, line in group:
        if half and not large:
            joined += BLANKS[: ROW // 2]
        half = large and not half
        lines.append((len(joined), line))
        joined += row_fields
        joined += BLANKS[len(row_fields) + ROW // 2 * large :]
    return Card(head, _filled(joined), tuple(lines))


def _filled(fields: list[str]) -> tuple[str, ...]:
    """The fields without the blanks at the end."""
    while fields and not fields[-1]:
        fields.pop()
    return tuple(fields)


def _cut_large(head: str, text: str, line: Line) -> Row:
    fields = WIDE[min(ROW // 2, (len(text) + 7) // 16)](text)
    return _large(head), tuple(map(str.strip, fields)), text[72:80].strip(), True, line


def _large(head: str) -> str:
    """A card's name without its asterisk; a continuation keeps its mark."""
    return head if head[0] in MARKS else head.rstrip("*").rstrip()


def _cut_free(text: str, line: Line) -> Row | DocumentFault:
    head, *fields = map(str.strip, text.split(",")) if " " in text or "\t" in text else text.split(",")
    large = "*" in head
    room = ROW // 2 if large else ROW
    if len(fields) <= room and not large:
        return head or "+", tuple(fields), "", False, line
    if any(fields[room + 1 :]):
        return _fault(
            line, f"more than {room} fields in one line", f"{head} {fields[0]} field {room + 2}", hint=BREAK
        )
    tail = fields[room] if len(fields) > room else ""
    return _large(head) if large else head or "+", tuple(fields[:room]), tail, large, line
