"""Matrices by direct input: what case control adds by K2GG and M2GG, as a component of the article."""

from __future__ import annotations

from middeck.errors import ConfigError
from middeck.files.nastran.components.external import GEOMETRY, component_of
from middeck.files.nastran.deck.deck import Deck
from middeck.files.nastran.deck.units import Units
from middeck.files.toml.faults import Fault
from middeck.structure.model.component import Component

READ = {"K2GG": "stiffness", "M2GG": "mass"}
NAME = "direct"
# Parameters that scale such matrices; WTMASS does not.
SCALES = ("CK2", "CM2", "CK1", "CM1")


def direct_component(deck: Deck, units: Units, faults: list[Fault]) -> Component | None:
    """The component of the DMIG that case control selects, in SI units; None where it selects none.

    Scalar points are its modal coordinates. Appends to ``faults`` other matrices (B2GG, K2PP ...), sums of
    matrices, and stiffness without mass, which no body has. Raises `ConfigError` or `DataError` for matrices
    that are no component's.
    """
    chosen = deck.selection.matrices
    known = {entry["name"] for entry in deck.entries.of("DMIG")}
    for command, matrix in chosen.items():
        if command not in READ:
            hint = "K2GG and M2GG are converted"
            faults.append(_fault(deck, command, "matrices of this kind are not converted yet", hint))
        elif matrix not in known:
            hint = "one name; a sum or a factor goes into the matrix itself"
            faults.append(_fault(deck, command, f"no DMIG {matrix}", hint))
        elif not set(READ) <= set(chosen):
            missing = next(iter(set(READ) - set(chosen)))
            hint = "a stiffness alone can be CELAS2 or CBUSH, a mass alone CONM1"
            faults.append(_fault(deck, command, f"no {missing} beside it: a component has both", hint))
    faults += [
        entry.fault("scales matrices by direct input: not converted yet", "v1")
        for entry in deck.entries.of("PARAM")
        if chosen and entry.id in SCALES
    ]
    if faults or not chosen:
        return None
    cards = [entry.card for entry in deck.entries.of(*GEOMETRY)]
    cards += [entry.card for entry in deck.entries.of("DMIG") if entry["name"] in chosen.values()]
    names = {what: (chosen[command],) for command, what in READ.items()}
    try:
        return component_of(cards, None, units, NAME, deck.path, names)
    except ConfigError as error:
        raise ConfigError(error.what, where=f"{deck.path}, {', '.join(chosen)}", hint=error.hint) from None


def _fault(deck: Deck, command: str, message: str, hint: str) -> Fault:
    _, file, line = deck.selection.lines[command]
    value = deck.selection.matrices[command]
    return Fault(file=file, line=line, key=command, message=message, value=value, hint=hint)
