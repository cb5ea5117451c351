"""A deck as values: what case control selects, cards with their fields, and parameters."""

import dataclasses
import gc
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from middeck.errors import ConfigError
from middeck.files.disk.kind_of_content import BINARY, EMPTY, NO_DECK, looks_like
from middeck.files.nastran.deck.cards import join_cards
from middeck.files.nastran.deck.case_control import CaseSelection, read_selection
from middeck.files.nastran.deck.deck_lines import Line, fault_on, read_sections
from middeck.files.nastran.deck.entries import Entries, Entry, raise_some, read_entries
from middeck.files.nastran.deck.nastran_numbers import in_single, integer, real
from middeck.files.toml.faults import DocumentFault
from middeck.values import record

# New objects that are worth to be made old at once.
MANY = 100_000
# PARAM that multiply stiffness, mass and loads of a deck, and its matrices by direct input; WTMASS does not.
FACTORS = ("CK1", "CM1", "CP1")
INPUT_FACTORS = ("CK2", "CM2")
READ = (*FACTORS, *INPUT_FACTORS, "WTMASS", "COUPMASS", "GRDPNT", "G")
CHOSEN = {"SPC": ("SPC", "SPC1"), "MPC": ("MPC",)}


@record(kw_only=True)
class Deck:
    """A deck as read.

    ``bulk_only``: it has neither executive nor case control, so that nothing is selected. ``notes`` are
    those on its includes; ``cards`` is the number of cards, ``unended`` the last line of a deck without
    ENDDATA.
    """

    path: str
    selection: CaseSelection
    entries: Entries
    notes: tuple[str, ...]
    bulk_only: bool
    cards: int
    unended: Line | None

    def selected(self, command: str) -> list[Entry]:
        """The constraints that case control selects by SPC or MPC, unions (SPCADD, MPCADD) resolved.

        A union goes before constraints of its own number, and names no other union.
        """
        unions = self.entries.numbered(f"{command}ADD")
        wanted: set[int] = set()
        for number in self.selection.sets.get(command, ()):
            union = unions.get(number)
            wanted |= {number} if union is None else {n for n in union["sets"] if n}
        return [entry for entry in self.entries.of(*CHOSEN[command]) if entry.id in wanted]

    def lacking(self) -> Iterator[DocumentFault]:
        """A complaint about each set of constraints that is selected, or that a selected union names, and
        that no card has.

        Nastran stops there (user fatal messages 2047, 2053); with superelements, each of which may have the
        set, it warns.
        """
        for command, names in CHOSEN.items():
            single = {entry.id for entry in self.entries.of(*names)}
            unions = self.entries.numbered(f"{command}ADD")
            for number in sorted(self.selection.sets.get(command, ())):
                if number in unions:
                    for i, n in enumerate(unions[number]["sets"], 1):
                        if n and n not in single:
                            other = "; a union names no union" if n in unions else ""
                            yield unions[number].fault_at(i, f"there is no {command} {n}{other}")
                elif number not in single:
                    what = f"there is no {' or '.join(names)} of this number"
                    yield self.selection.fault(command, number, what)


def read_deck(path: str | Path, subcase: int | None = None, *, single: bool = False) -> Deck:
    """Read a Nastran deck with all that it includes, as case control has it in one ``subcase``, or in all.

    ``single`` rounds its reals to single precision, as Nastran's tables of 32-bit words hold them. Raises
    `ConfigError` with what is wrong, by file, line, card and field.
    """
    kind = looks_like(path)
    if kind in (EMPTY, BINARY) or kind in NO_DECK:
        what = "the file is empty" if kind == EMPTY else f"looks like {kind}, not a Nastran deck"
        raise ConfigError(what, where=str(path), hint="a deck in this place")
    with _without_collection():
        sections = read_sections(path)
        cards = join_cards(sections.bulk)
        entries = read_entries(cards)
    entries = _in_single(entries) if single else entries
    return Deck(
        path=str(path),
        selection=read_selection(sections.case, subcase),
        entries=entries,
        notes=sections.notes,
        bulk_only=not sections.case and not sections.executive,
        cards=len(cards),
        unended=sections.unended,
    )


def _in_single(entries: Entries) -> Entries:
    """All entries with their reals in single precision but DMIG, which has a precision of its own."""
    faults: list[DocumentFault] = []

    def rounded(entry: Entry) -> Entry:
        try:
            return entry._replace(values=tuple(map(in_single, entry.values)))
        except OverflowError:
            faults.append(entry.fault("a number that single precision has no place for"))
            return entry

    kept = {
        name: found if name == "DMIG" else [*map(rounded, found)] for name, found in entries.by_name.items()
    }
    raise_some(faults)
    return entries._replace(by_name=kept)


@contextmanager
def _without_collection() -> Generator[None]:
    """Cards are many and hold no cycles: looking for them takes half of the reading.

    They are old when it goes on, or the next look would be at all of them.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        # What others froze stays so; to count that takes longer than a small deck.
        if enabled and gc.get_count()[0] > MANY and not gc.get_freeze_count():
            gc.freeze()
            gc.unfreeze()
        if enabled:
            gc.enable()


def given(deck: Deck, name: str) -> Iterator[tuple[str, DocumentFault]]:
    """Values of PARAM ``name``, in bulk data and then in case control, which takes precedence.

    Each with a complaint about it that has no message yet.
    """
    for entry in deck.entries.of("PARAM"):
        if entry.id == name:
            yield entry["v1"], entry.fault("", "v1")
    for line in deck.selection.params:
        parts = line[0].upper().replace(",", " ").split()
        if parts[1:2] == [name]:
            value = "".join(parts[2:3])
            yield value, fault_on(line, f"PARAM {name}", "", value)


def weight_factor(deck: Deck) -> float:
    """The factor on every mass, PARAM WTMASS."""
    found = 1.0
    for text, fault in given(deck, "WTMASS"):
        found = real(text) or 0.0
        if found <= 0.0:
            raise_some([dataclasses.replace(fault, message="must be a real number > 0")])
    return found


def reference_grid(deck: Deck) -> int | None:
    """The grid about which PARAM GRDPNT asks for the mass, 0 for the origin; None where it does not."""
    found = None
    for text, fault in given(deck, "GRDPNT"):
        found = integer(text)
        if found is None:
            raise_some([dataclasses.replace(fault, message="must be the number of a grid, 0 or -1")])
    return None if found is None or found < 0 else found


def unread_params(deck: Deck) -> list[str]:
    """Names of PARAM in bulk data and case control that are not used, each once."""
    stated = [text.upper().replace(",", " ").split() for text, _, _ in deck.selection.params]
    names = [entry.id for entry in deck.entries.of("PARAM")] + [words[1] for words in stated if words[1:]]
    return [name for name in dict.fromkeys(names) if name not in READ]


def asked_formulation(deck: Deck) -> Literal["coupled", "lumped"]:
    """The mass that the deck's own program would give its bars, by PARAM COUPMASS: coupled or lumped."""
    coupled = False
    for text, fault in given(deck, "COUPMASS"):
        number = integer(text)
        if number is None and text not in ("YES", "ON", "NO", "OFF"):
            raise_some([dataclasses.replace(fault, message="must be a whole number, YES or NO")])
        coupled = text in ("YES", "ON") if number is None else number > 0
    return "coupled" if coupled else "lumped"
