"""Cards with their fields as numbers: every complaint names file, line, card and field."""

import contextlib
import dataclasses
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import repeat, zip_longest
from typing import Any, NamedTuple

from middeck.files.nastran.deck.cards import Card
from middeck.files.nastran.deck.deck_lines import fault_on
from middeck.files.nastran.deck.known_cards import (
    CONTINUA,
    IDLE,
    NOT_YET,
    PARSED,
    PLACED,
    PLACES,
    PLACING,
    REDUCE,
    REQUIRED,
    Format,
)
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.toml.faults import DocumentFault, nearest, raise_faults

ALL = "123456"
# Names of which two may stand on one card.
DOUBLE = frozenset(("PELAS", "CORD1R", "CORD1C", "CORD1S"))
LARGEST = 10**15  # no integer of Nastran is
SAMPLE = 64  # texts of a column that say whether most of them repeat
EXPONENT = re.compile(r"(?<=[0-9.])[+-]")  # one without its letter
SHOWN = 20  # faults in one report
UNNUMBERED = ("GRDSET", "BAROR", "BEAMOR")  # what holds of all grids or bars stands once
# Names that share one space of numbers. Programs accept masses with the number of another element.
SPACES = {
    "GRID": "grid",
    **dict.fromkeys(("CBAR", "CBEAM", "CROD", "CTUBE", "CONROD"), "element"),
    **dict.fromkeys(("CELAS1", "CELAS2", "CELAS3", "CELAS4"), "element"),
    **dict.fromkeys(("CBUSH", "RBE1", "RBE2", "RBE3", "RBAR"), "element"),
    **dict.fromkeys(("CONM1", "CONM2", "CMASS1", "CMASS2", "CMASS3", "CMASS4"), "mass element"),
    **dict.fromkeys(("PBAR", "PBARL", "PBEAM", "PBEAML", "PROD", "PTUBE", "PELAS", "PBUSH"), "property"),
    **{f"CORD{i}{kind}": "coordinate system" for i in "12" for kind in "RCS"},
    **{
        name: name
        for name in [
            "MAT1",
            "PMASS",
            "PARAM",
            *UNNUMBERED,
            "EIGRL",
            "EIGR",
            "SUPORT1",
            "LOAD",
            "SPCADD",
            "MPCADD",
        ]
    },
}
WANTED = {
    "n": "must be an integer > 0",
    "i": "must be an integer",
    "r": "must be a real number, with a decimal point",
    "g": "must be a grid or a real number, with a decimal point",
    "c": "must be components out of 123456",
    "d": "must be components out of 123456",
    "t": "must be a name",
    "a": "must not be blank",
    "-": "must be blank",
}


class Entry(NamedTuple):
    """A card with the values of its fields in their order; a blank field without a default is None."""

    name: str
    values: tuple[Any, ...]
    card: Card

    def __getitem__(self, key: Any) -> Any:
        """The value of the field that is named ``key``."""
        return self.values[PLACES[self.name][key]]

    @property
    def id(self) -> Any:
        """The number or name in its first field."""
        return self.values[0]

    @property
    def label(self) -> str:
        """The card and its number."""
        return self.name if self.name in UNNUMBERED else f"{self.name} {self.id}"

    def fault(self, message: str, key: str = "", hint: str = "") -> DocumentFault:
        """A complaint about the field ``key`` or about the whole card."""
        if not key:
            return fault_on(self.card.line(), self.label, message, hint=hint)
        return self.fault_at(PLACES[self.name][key], message, hint)

    def fault_at(self, place: int, message: str, hint: str = "") -> DocumentFault:
        """A complaint about the field at ``place``; the first after the name is 0."""
        layout, fields = PARSED[self.name], self.card.fields
        field = layout.fields[place] if place < len(layout.fields) else layout.rest
        named = f" ({field.name.upper()})" if field and field.name else ""
        key = f"{' '.join([self.name, *filter(None, fields[:1])])} field {_number(place)}{named}"
        value = fields[place] if place < len(fields) else ""
        hint = hint or (SHIFTED if " " in value else "")
        return fault_on(self.card.line(place), key, message, value, hint)


class CardError(ValueError):
    """A complaint with its field and card, which may be another than the one being converted."""

    def __init__(self, fault: DocumentFault) -> None:
        super().__init__(fault.message)
        self.fault = fault


def add_fault(faults: list[DocumentFault], error: ValueError, entry: Entry, key: str = "") -> None:
    """Append the complaint of ``error`` once, about field ``key`` of ``entry`` unless it names another."""
    fault = error.fault if isinstance(error, CardError) else entry.fault(f"{error}", key)
    if fault not in faults:
        faults.append(fault)


class Entries(NamedTuple):
    """A deck's bulk data: entries by card, and the number of cards of each other name."""

    by_name: dict[str, list[Entry]]
    idle: Counter[str]

    def of(self, *names: str) -> list[Entry]:
        """All entries of these names."""
        return [entry for name in names for entry in self.by_name.get(name, ())]

    def numbered(self, *names: str) -> dict[Any, Entry]:
        """The entries of these names by number."""
        return {entry.id: entry for entry in self.of(*names)}


def read_entries(cards: Iterable[Card]) -> Entries:
    """Number the fields of ``cards``; equal duplicates count once.

    Raises `ConfigError` with everything wrong: fields, unknown cards, elements that are not read, and numbers
    given twice with unequal content.
    """
    groups: dict[str, list[Card]] = {}
    for card in cards:
        groups.setdefault(card.name, []).append(card)
    faults: list[DocumentFault] = []
    by_name: dict[str, list[Entry]] = {}
    seen: dict[str, dict[Any, Entry]] = {}
    idle: Counter[str] = Counter()
    for name, found in groups.items():
        layout = PARSED.get(name)
        if layout is not None:
            found = [part for card in found for part in _halves(card)] if name in DOUBLE else found
            read = _read(name, found, layout, faults)
            by_name[name] = read
            if name in SPACES:
                space = SPACES[name]
                blank = BASIC_GRID if name == "GRID" and "GRDSET" not in groups else ()
                by_name[name] = _distinct(read, space, seen.setdefault(space, {}), faults, blank)
        elif name in IDLE:
            idle[name] = len(found)
        else:
            faults.append(_refusal(name, found))
    if groups and not by_name and not idle and all(_is_foreign(fault) for fault in faults):
        faults = [
            dataclasses.replace(faults[0], key="", message="no card of a Nastran deck in it", hint=CARDS)
        ]
    raise_some(faults)
    return Entries(by_name, idle)


def _is_foreign(fault: DocumentFault) -> bool:
    """Whether the refused text is no card at all, not even one with fields separated by spaces."""
    return fault.hint in (COLUMNS, CARDS) and fault.key.partition(" ")[0] not in PARSED


def _distinct(
    entries: list[Entry],
    space: str,
    seen: dict[Any, Entry],
    faults: list[DocumentFault],
    blank: Sequence[Any] = (),
) -> list[Entry]:
    """The ``entries`` without equal duplicates; unequal ones are faults. ``blank``: of blank fields."""
    own = {entry.values[0]: entry for entry in entries}
    if len(own) == len(entries) and own.keys().isdisjoint(seen):
        seen |= own
        return entries
    kept: list[Entry] = []
    for entry in entries:
        other = seen.setdefault(entry.id, entry)
        # A number that cannot be read is a fault already; defaults have none.
        if other is entry or (entry.id is None and space not in UNNUMBERED):
            kept.append(entry)
        else:
            faults += _twice(entry, other, space, blank)
    return kept


def raise_some(faults: Sequence[DocumentFault]) -> None:
    """Raise `ConfigError` with the first faults, in the order of the deck; nothing if there are none."""
    if len(faults) > SHOWN:
        more = f"and {len(faults) - SHOWN} more like these"
        faults = [
            *faults[:SHOWN],
            DocumentFault(file=faults[SHOWN].file, line=faults[SHOWN].line, key="", message=more),
        ]
    raise_faults(faults)


def _read(name: str, cards: list[Card], layout: Format, faults: list[DocumentFault]) -> list[Entry]:
    """The cards of one name, field by field over all of them: a text that many have is looked at once."""
    count, rest = len(layout.fields), layout.rest
    rows = [card.fields for card in cards]
    alike = len(set(map(len, rows))) == 1 and len(rows[0]) <= count
    columns = list(
        zip(*rows, strict=True) if alike else zip_longest(*(f[:count] for f in rows), fillvalue="")
    )
    columns += [("",) * len(cards)] * (count - len(columns))
    wrong: list[tuple[int, int, str]] = []
    read: list[list[Any]] = []
    for place, (field, texts) in enumerate(zip(layout.fields, columns, strict=True)):
        blank = None if field.default is REQUIRED else field.default
        repeated = len(set(texts[:SAMPLE])) < SAMPLE // 4 < len(texts)  # read once each then
        if not repeated and not (field.default is REQUIRED and "" in texts):
            numbers = _plain(texts, field.kind, blank)
            if numbers is not None:
                read.append(numbers)
                continue
        distinct = set(texts)
        values = {text: _value(text, field.kind) for text in distinct - {""}}
        bad = {text for text, value in values.items() if value is None and field.kind != "*"}
        values[""] = blank
        if bad or (field.default is REQUIRED and "" in distinct):
            missing = f"missing; {WANTED[field.kind]}"
            wrong += [(i, place, WANTED[field.kind]) for i, text in enumerate(texts) if text in bad]
            if field.default is REQUIRED:
                wrong += [(i, place, missing) for i, text in enumerate(texts) if not text]
        read.append(list(map(values.__getitem__, texts)))
    if rest is not None:
        read.append([[_value(t, rest.kind) if t else None for t in card.fields[count:]] for card in cards])
    longer = max(map(len, rows), default=0) > count
    for i, fields in enumerate(rows) if longer else ():
        if len(fields) > count:
            more = fields[count:]
            found = [None] * len(more) if rest is None else read[-1][i]
            what = WANTED["-" if rest is None else rest.kind]
            wrong += [(i, count + k, what) for k, text in enumerate(more) if text and found[k] is None]
    # Each an `Entry`, without the call of a function of Python's for each.
    whole = zip(repeat(name), zip(*read, strict=True), cards, strict=False)
    entries = list(map(tuple.__new__, repeat(Entry), whole))
    faults += [entries[i].fault_at(place, what) for i, place, what in sorted(wrong)]
    return entries


def _number(place: int) -> int:
    """The number of a field on its card as manuals count: 1 is the name, 10 and its like are marks."""
    return place + 2 + 2 * (place // 8)


def _plain(texts: Sequence[str], kind: str, blank: Any) -> list[Any] | None:
    """The numbers of a column, ``blank`` for those that are not there; None where one is no plain number."""
    whole = ",".join(texts)
    numbers: list[Any] | None = None
    # As many points as texts: one each, for Python takes no number with two; it takes 1_0., INF and NAN.
    points = len(texts) - texts.count("")
    if (
        kind == "r"
        and whole.count(".") == points
        and whole.isascii()
        and "_" not in whole
        and "N" not in whole
    ):
        with contextlib.suppress(ValueError):
            try:
                numbers = [float(text) if text else blank for text in texts]
            except ValueError:
                written = EXPONENT.sub(r"E\g<0>", whole).split(",")
                numbers = [float(text) if text else blank for text in written]
            numbers = None if math.inf in numbers or -math.inf in numbers else numbers
    if kind in "ni" and whole.isascii() and whole.replace(",", "").isdecimal():
        numbers = [int(text) if text else blank for text in texts]
        given = [int(text) for text in texts if text] if "" in texts else numbers
        numbers = None if max(given) >= LARGEST or (kind == "n" and min(given) <= 0) else numbers
    return numbers


def _value(text: str, kind: str) -> Any:
    """The value of a field that is not blank; None if it is not of its kind."""
    if kind == "r":
        return real(text)
    if kind in "ni":
        value = integer(text)
        return None if value is None or (kind == "n" and value <= 0) else value
    match kind:
        case "g":
            value = integer(text)
            return real(text) if value is None else value
        case "c" | "d":
            one_each = len(set(text)) == len(text) and not set(text) - set(ALL)
            none = "" if kind == "c" and text == "0" else None
            return "".join(sorted(text)) if one_each else none
        case "t":
            return text if text[0].isalpha() else None
        case "a":
            return text
        case _:
            return None


def _halves(card: Card) -> list[Card]:
    """Two coordinate systems, or two springs, may stand on one card."""
    if not any(card.fields[4:]):
        return [card]
    return [Card(card.name, part, card.lines) for part in (card.fields[:4], card.fields[4:])]


def _twice(entry: Entry, other: Entry, space: str, blank: Sequence[Any]) -> list[DocumentFault]:
    one, two = (
        [b if value is None else value for value, b in zip_longest(e.values, blank)] for e in (entry, other)
    )
    if entry.name == other.name and one == two:
        return []
    line = other.card.line()
    number = "" if entry.id is None else f" {entry.id}"
    what = f"a second {space}{number} with other content; the first is {other.label} at {line[1]}:{line[2]}"
    return [entry.fault_at(_place_of_difference(entry, other, one, two), what, "leave one of them out")]


def _place_of_difference(entry: Entry, other: Entry, one: list[Any], two: list[Any]) -> int:
    """The first field of ``entry`` that ``other`` has otherwise; that of its number where names differ."""
    if entry.name != other.name:
        return 0
    place = next(i for i, (a, b) in enumerate(zip_longest(one, two)) if a != b)
    layout = PARSED[entry.name]
    if place < len(layout.fields):
        return place
    texts = (e.card.fields[place:] for e in (entry, other))
    return place + next((i for i, (a, b) in enumerate(zip_longest(*texts)) if a != b), 0)


# What blank fields of a GRID mean without GRDSET; its number is not blank.
BASIC_GRID = (None, 0, 0.0, 0.0, 0.0, 0, "", 0)
COLUMNS = "columns of eight, or commas"
SHIFTED = "a blank within a field: fields have eight columns, large ones sixteen; is the line shifted?"
CARDS = "docs/how-to/your-nastran-deck.md lists the cards that are read"


def _refusal(name: str, found: list[Card]) -> DocumentFault:
    count = f"{len(found)} of them" if len(found) > 1 else "one of them"
    if name in CONTINUA:
        message, hint = f"shells and solids are not read ({count})", REDUCE
    elif name in PLACING:
        message, hint = f"{PLACING[name]}, which is not read ({count})", PLACED
    elif name in NOT_YET:
        message, hint = f"not converted yet, and without it the modes would be others ({count})", ""
    else:
        near = nearest(name, sorted((*PARSED, *IDLE)))
        message, hint = f"no card of this name ({count})", near if near.startswith("did") else CARDS
        hint = hint if name.isalnum() else COLUMNS
    return fault_on(found[0].line(), name, message, hint=hint)
