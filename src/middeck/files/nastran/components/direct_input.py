"""Matrices by direct input: what case control adds by K2GG and M2GG, both as a component of the article."""

import dataclasses

import numpy as np

from middeck.errors import ConfigError
from middeck.files.nastran.components.external import GEOMETRY, basic_matrix, component_of, read_dmig
from middeck.files.nastran.deck.cards import Card
from middeck.files.nastran.deck.deck import FACTORS, INPUT_FACTORS, Deck, given
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.deck.nastran_numbers import real
from middeck.files.nastran.deck.units import Units
from middeck.files.toml.faults import DocumentFault
from middeck.structure.model.component import UNEQUAL, Component
from middeck.values import record

READ = {"K2GG": "stiffness", "M2GG": "mass"}
DAMPING = frozenset(("B2GG", "B2PP", "K42GG"))
GYROSCOPIC = "[[wheel]] for momentum; leave it out if the frequencies without it are meant"
NAME = "direct"


@record(kw_only=True)
class Lone:
    """A matrix that stands alone: what it is, its first card, its grids, six rows of each in basic axes.

    ``digits`` are the most that one of its numbers has: by half of the last each may be wrong.
    """

    what: str
    entry: Entry
    grids: tuple[int, ...]
    matrix: np.ndarray
    digits: int

    def block(self, row: int, column: int) -> np.ndarray:
        """Coupling of the coordinates of one grid with those of another, by their places in the list."""
        return self.matrix[6 * row : 6 * row + 6, 6 * column : 6 * column + 6]

    def size(self, row: int) -> np.ndarray:
        """Square roots of the diagonal for one grid."""
        return np.sqrt(np.abs(np.diagonal(self.block(row, row))))


def lone_matrix(deck: Deck, faults: list[DocumentFault]) -> Lone | None:
    """The stiffness or the mass that case control selects alone, in units of the deck; None for both or none.

    Appends to ``faults`` scalar points in it.
    """
    chosen = deck.selection.matrices
    alone = [command for command in READ if command in chosen]
    if faults or len(alone) != 1:
        return None
    entry, *columns = (e for e in deck.entries.of("DMIG") if e["name"] == chosen[alone[0]])
    if not columns:
        faults.append(entry.fault("has no entries"))
        return None
    grids, scalars, matrix, digits = basic_matrix(_cards(deck), chosen[alone[0]], READ[alone[0]], deck.path)
    if scalars:
        what = f"scalar point {scalars[0]} in a matrix that stands alone: not converted yet"
        faults.append(entry.fault(what, hint="K2GG and M2GG"))
        return None
    return Lone(what=READ[alone[0]], entry=entry, grids=grids, matrix=matrix, digits=digits)


def _cards(deck: Deck) -> list[Card]:
    """Cards of the grids, and of the matrices that are selected."""
    chosen = deck.selection.matrices.values()
    cards = [entry.card for entry in deck.entries.of(*GEOMETRY)]
    return cards + [entry.card for entry in deck.entries.of("DMIG") if entry["name"] in chosen]


def direct_component(deck: Deck, units: Units, faults: list[DocumentFault]) -> Component | None:
    """The component of the DMIG that case control selects, in SI units; None where it selects none.

    Scalar points are its modal coordinates. A matrix that stands alone is a `Lone` one. Appends to ``faults``
    other matrices (A2GG, K2PP ...), sums of matrices, gyroscopic terms, and factors on matrices or loads,
    also on those of the whole deck. Raises `ConfigError` or `DataError` for matrices that are no component's.
    """
    chosen = deck.selection.matrices
    known = {entry["name"] for entry in deck.entries.of("DMIG")}
    for command, matrix in chosen.items():
        if command in DAMPING:  # listed as left out
            faults += [
                _fault(deck, command, f"DMIG {name} is not symmetric: it is more than damping", GYROSCOPIC)
                for name in damping_names(deck)[command]
                if _is_skew(deck, name)
            ]
        elif command not in READ:
            hint = "K2GG and M2GG are converted"
            faults.append(_fault(deck, command, "matrices of this kind are not converted yet", hint))
        elif matrix not in known:
            hint = "one name; a sum or a factor goes into the matrix itself"
            faults.append(_fault(deck, command, f"no DMIG {matrix}", hint))
    faults += [
        dataclasses.replace(fault, message="scales matrices or loads: not converted yet")
        for name in (*FACTORS, *(INPUT_FACTORS if set(READ) & set(chosen) else ()))
        for text, fault in given(deck, name)
        if real(text) != 1.0
    ]
    if faults or not set(READ) <= set(chosen):
        return None
    cards = _cards(deck)
    names = {what: (chosen[command],) for command, what in READ.items()}
    try:
        return component_of(cards, None, units, NAME, deck.path, names)
    except ConfigError as error:
        if error.where.rpartition(":")[2].isdigit():  # a line of the deck
            raise
        raise ConfigError(error.what, where=f"{deck.path}, {', '.join(chosen)}", hint=error.hint) from None


def damping_names(deck: Deck) -> dict[str, list[str]]:
    """Names of the damping matrices that each command of case control selects, also in sums."""
    return {
        command: [part.rpartition("*")[2].strip() for part in text.split(",")]
        for command, text in deck.selection.matrices.items()
        if command in DAMPING
    }


def _is_skew(deck: Deck, name: str) -> bool:
    """Whether a damping matrix is not symmetric: a gyroscopic part dissipates nothing."""
    cards = [entry.card for entry in deck.entries.of("DMIG") if entry["name"] == name]
    if not cards or cards[0].fields[2:3] == ["6"]:  # one triangle stands for both
        return False
    entries = read_dmig(cards).columns[name]
    most = max(map(abs, entries.values()), default=0.0)
    return any(abs(value - entries.get((b, a), 0.0)) > UNEQUAL * most for (a, b), value in entries.items())


def _fault(deck: Deck, command: str, message: str, hint: str) -> DocumentFault:
    return deck.selection.fault(command, deck.selection.matrices[command], message, hint)
