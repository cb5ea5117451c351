"""Cards with their fields as numbers: every complaint names file, line, card and field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from middeck.files.faults import Fault, nearest, raise_faults
from middeck.files.nastran.cards import Card
from middeck.files.nastran.formats import (
    CONTINUA,
    IDLE,
    NOT_YET,
    PARSED,
    REDUCE,
    REQUIRED,
    Format,
)
from middeck.files.nastran.numbers import integer, real

SHOWN = 20  # faults in one report
# Names that share one space of numbers.
SPACES = {
    "GRID": "grid",
    **dict.fromkeys(("CBAR", "CBEAM", "CROD", "CONROD", "CONM1", "CONM2", "CELAS1", "CELAS2"), "element"),
    **dict.fromkeys(("CBUSH", "RBE2", "RBE3", "RBAR"), "element"),
    **dict.fromkeys(("PBAR", "PBARL", "PBEAM", "PBEAML", "PROD", "PELAS", "PBUSH"), "property"),
    **{f"CORD{i}{kind}": "coordinate system" for i in "12" for kind in "RCS"},
    **{name: name for name in ("MAT1", "PARAM", "GRDSET", "BAROR", "BEAMOR", "EIGRL", "EIGR", "SUPORT1")},
}
WANTED = {
    "n": "an integer > 0",
    "i": "an integer",
    "r": "a real number, with a decimal point",
    "g": "a grid or a real number, with a decimal point",
    "c": "components out of 123456",
    "t": "a name",
    "-": "blank",
}


class Entry(NamedTuple):
    """A card with its fields by name; a blank field without a default is None."""

    name: str
    values: dict[str, Any]
    card: Card

    def __getitem__(self, key: Any) -> Any:
        """The value of the field ``key``."""
        return self.values[key]

    @property
    def id(self) -> Any:
        """What it goes by: its first field."""
        return next(iter(self.values.values()), None)

    @property
    def label(self) -> str:
        """The card and its number."""
        return f"{self.name} {self.id}"

    def fault(self, message: str, key: str = "", hint: str = "") -> Fault:
        """A complaint about the field ``key`` or about the whole card."""
        place, field = 0, ""
        if key:
            names = [f.name for f in PARSED[self.name].fields]
            place = names.index(key) if key in names else len(names)
            field = f" field {_number(place)} ({key.upper()})"
        line = self.card.line(place)
        value = self.card.fields[place] if key and place < len(self.card.fields) else ""
        return Fault(
            file=line.file,
            line=line.number,
            key=f"{self.label}{field}",
            message=message,
            value=value,
            hint=hint,
        )


class Entries(NamedTuple):
    """What was read of a deck's bulk data: by card, and how many cards of each other name there are."""

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
    faults: list[Fault] = []
    by_name: dict[str, list[Entry]] = {}
    seen: dict[tuple[str, Any], Entry] = {}
    idle: Counter[str] = Counter()
    refused: dict[str, list[Card]] = {}
    reals: dict[str, float] = {}
    for card in cards:
        layout = PARSED.get(card.name)
        if layout is None:
            if card.name in IDLE:
                idle[card.name] += 1
            else:
                refused.setdefault(card.name, []).append(card)
            continue
        for part in _halves(card):
            entry = _read(part, layout, reals, faults)
            space = SPACES.get(card.name)
            if space is not None:
                other = seen.setdefault((space, entry.id), entry)
                if other is not entry:
                    faults += _twice(entry, other, space)
                    continue
            by_name.setdefault(card.name, []).append(entry)
    faults += [_refusal(name, found) for name, found in refused.items()]
    raise_some(faults)
    return Entries(by_name, idle)


def raise_some(faults: Sequence[Fault]) -> None:
    """Raise `ConfigError` with the first faults, in the order of the deck; nothing if there are none."""
    if len(faults) > SHOWN:
        more = f"and {len(faults) - SHOWN} more like these"
        faults = [
            *faults[:SHOWN],
            Fault(file=faults[SHOWN].file, line=faults[SHOWN].line, key="", message=more),
        ]
    raise_faults(faults)


def _read(card: Card, layout: Format, reals: dict[str, float], faults: list[Fault]) -> Entry:
    values: dict[str, Any] = {}
    entry = Entry(card.name, values, card)
    fields, given = card.fields, len(card.fields)
    wrong: list[tuple[int, str, str]] = []
    for place, (name, kind, default) in enumerate(layout.fields):
        text = fields[place] if place < given else ""
        if text:
            value = reals.get(text) if kind == "r" else None
            if value is None:
                value = _value(text, kind, reals)
                if value is None and kind != "*":
                    wrong.append((place, name, f"must be {WANTED[kind]}"))
        else:
            value = default
            if default is REQUIRED:
                value = None
                wrong.append((place, name, f"missing: {WANTED[kind]}"))
        if name:
            values[name] = value
    count = len(layout.fields)
    if layout.rest is not None:
        rest = [(_value(t, layout.rest.kind, reals) if t else None) for t in fields[count:]]
        values[layout.rest.name] = rest
        wrong += [
            (count + i, layout.rest.name, f"must be {WANTED[layout.rest.kind]}")
            for i, value in enumerate(rest)
            if value is None and fields[count + i]
        ]
    else:
        wrong += [(i, "", "must be blank") for i in range(count, given) if fields[i]]
    for place, name, message in wrong:
        line = card.line(place)
        named = f" ({name.upper()})" if name else ""
        faults.append(
            Fault(
                file=line.file,
                line=line.number,
                key=f"{card.name} {fields[0] if fields else ''} field {_number(place)}{named}",
                message=message,
                value=fields[place] if place < given else "",
            )
        )
    return entry


def _number(place: int) -> int:
    """The number of a field on its card as manuals count: 1 is the name, 10 and its like are marks."""
    return place + 2 + 2 * (place // 8)


def _value(text: str, kind: str, reals: dict[str, float]) -> Any:
    """The value of a field that is not blank; None if it is not of its kind."""
    match kind:
        case "n" | "i":
            value = integer(text)
            return None if value is None or (kind == "n" and value <= 0) else value
        case "r":
            value = real(text)
            if value is not None:
                reals[text] = value
            return value
        case "g":
            value = integer(text)
            return real(text) if value is None else value
        case "c":
            digits = "".join(sorted(set(text) - {"0"}))
            return digits if not set(text) - set("0123456") and len(set(text)) == len(text) else None
        case "t":
            return text if text[0].isalpha() else None
        case "a":
            return text
        case _:
            return None


def _halves(card: Card) -> list[Card]:
    """Two coordinate systems, or two springs, may stand on one card."""
    width = {"CORD1": 4, "PELAS": 4}.get(card.name[:5])
    if width is None or not any(card.fields[width:]):
        return [card]
    return [Card(card.name, part, card.lines) for part in (card.fields[:width], card.fields[width:])]


def _twice(entry: Entry, other: Entry, space: str) -> list[Fault]:
    if entry.name == other.name and entry.values == other.values:
        return []
    line = other.card.line()
    return [
        entry.fault(
            f"a second {space} {entry.id} with other content; the first is {other.label} "
            f"at {line.file}:{line.number}",
            hint="leave one of them out",
        )
    ]


def _refusal(name: str, found: list[Card]) -> Fault:
    line = found[0].line()
    count = f"{len(found)} of them" if len(found) > 1 else "one of them"
    if name in CONTINUA:
        message, hint = f"shells and solids are not read ({count})", REDUCE
    elif name in NOT_YET:
        message, hint = f"not converted yet, and without it the modes would be others ({count})", ""
    else:
        message, hint = (
            f"no card of this name ({count})",
            nearest(name, [*PARSED, *IDLE]) if name.isalnum() else "columns of eight, or commas",
        )
    return Fault(file=line.file, line=line.number, key=name, message=message, hint=hint)
