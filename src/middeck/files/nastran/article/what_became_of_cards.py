"""The report on the cards: which were converted, which left out and why, and which are doubtful."""

from collections import Counter
from collections.abc import Iterator
from itertools import chain

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, DeckParts, LeftOut
from middeck.files.nastran.components.direct_input import damping_names
from middeck.files.nastran.deck.deck import Deck, asked_formulation, given, unread_params
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.deck.known_cards import DIVIDING
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.nastran.deck.units import warnings_on_modulus
from middeck.files.nastran.masses_and_springs.scalars import MASSES, SPRINGS
from middeck.files.nastran.masses_and_springs.spring_elements import ROW

REDUCTION = ("ASET", "ASET1", "BSET", "BSET1", "QSET", "QSET1", "CSET", "CSET1")
# Cards that an article has no place for, and what that means for its modes: nothing.
NO_PART = {
    "sets of a reduction: the article is not reduced": REDUCTION,
    "free or held, an article needs no reference supports": ("SUPORT", "SUPORT1"),
    "eigenvalue method: middeck has its own": ("EIGR", "EIGRL"),
}
DAMPS = "damping: give it in the article's [damping]"
NOT_SELECTED = "not selected by case control"
# What an article has in place of cards that are passed over, by the beginning of their names.
ELSEWHERE = {
    ("ROTOR", "RSPIN", "RGYRO"): "rotors do not spin: give a [[wheel]] and its speed in the environment",
    ("PBUSHT", "PELAST"): "stiffness by frequency or load: the article has that of PBUSH, PELAS",
    ("CDAMP", "PDAMP", "CVISC", "PVISC"): DAMPS,
    ("NSM", "BGSET", "BCTABLE", "BCONP"): NOT_SELECTED,
}
# Commands whose sets an article has no part for: a missing set is reported.
HINTS = {**dict.fromkeys(("METHOD", "METH"), ("EIGR", "EIGRL")), "SUPORT1": ("SUPORT1",)}
DIVIDES = "which superelement something is in: the article is not divided"


def count_converted(basis: Basis, parts: DeckParts, standing: Standing) -> dict[str, int]:
    """Cards by name that the article has, and its grids by what became of them."""
    converted = Counter(bar.entry.name for bar in parts.bars)
    converted.update(entry.name for entry in basis.entries.of("CONM1", "CONM2", *MASSES))
    converted.update(element.entry.name for element in parts.scalars if not element.is_mass)
    converted.update(tie.entry.name for tie in parts.ties)
    converted["components"] = len(standing.joined)
    alone = {id(element.entry) for element in parts.scalars}
    converted.update(c.entry.name for c in standing.tied if id(c.entry) not in alone)
    converted["grids that are nodes"] = len(standing.kept)
    converted["grids rigid with another"] = sum(
        standing.carrier(g) in standing.kept for g in standing.carriers
    )
    return dict(converted)


def account_left_out(basis: Basis, parts: DeckParts, standing: Standing) -> list[LeftOut]:
    """Cards that changed nothing, with the reason: rows (card, how many, why)."""
    entries, deck = basis.entries, basis.deck
    rows = [(name, len(entries.of(name)), why) for why, names in NO_PART.items() for name in names]
    if not parts.scalars and not standing.joined:  # else modal coordinates of components
        rows.append(("SPOINT", len(entries.of("SPOINT")), "no element or mass is at these scalar points"))
    rows += [(name, count, _why_idle(name)) for name, count in sorted(entries.idle.items())]
    elsewhere = any(e["seid"] for e in entries.of("GRDSET"))
    inside = [e for e in entries.of("GRID") if e["seid"] or (elsewhere and e["seid"] is None)]
    rows.append(("GRID SEID", len(inside), "which superelement they are in: the article is not divided"))
    moved = {id(part.entry) for part in (*parts.ties, *parts.scalars)}
    still = Counter(e.name for e in entries.of("CBUSH", *SPRINGS) if id(e) not in moved)
    rows += [
        (name, count, "no stiffness, or the ground holds all of its ends") for name, count in still.items()
    ]
    cards = Counter(e["name"] for e in entries.of("DMIG"))
    damping = damping_names(deck)
    selected = {*deck.selection.matrices.values(), *chain.from_iterable(damping.values())}
    rows.append(("DMIG", sum(cards[name] for name in cards.keys() - selected), NOT_SELECTED))
    rows += [(f"DMIG of {c}", sum(cards[n] for n in names), DAMPS) for c, names in sorted(damping.items())]
    bare = {*basis.places.grids} - standing.account - {*standing.carriers, *standing.carriers.values()}
    rows.append(("GRID", len(bare), "no element or mass is at them: points of orientation, for instance"))
    damped = [e for e in entries.of("MAT1", "PELAS", "CELAS2") if e["ge"]]
    rows.append(("MAT1, PELAS GE", len(damped), "damping of materials: give it in the article's [damping]"))
    bushings = [e for e in entries.of("PBUSH") if _damps(e)]
    rows.append(("PBUSH B, GE", len(bushings), "damping of bushings: give it in the article's [damping]"))
    whole = [value for value, _ in given(deck, "G") if value and real(value)]
    rows.append(("PARAM G", len(whole), "damping of the whole: give it in the article's [damping]"))
    unread = unread_params(deck)
    rows.append((f"PARAM {', '.join(unread)}", len(unread), "not read"))
    return [row for row in rows if row[1] > 0]


def _damps(bushing: Entry) -> bool:
    """Whether a PBUSH has damping: a nonzero number in a line B or GE."""
    texts = ["", *(text or "" for text in bushing["rest"])]
    lines = (texts[i + 1 : i + ROW] for i in range(0, len(texts), ROW))
    return any(line[:1] in (["B"], ["GE"]) and any(map(real, filter(None, line[1:]))) for line in lines)


def _why_idle(card: str) -> str:
    if card in DIVIDING:
        return DIVIDES
    found = (why for starts, why in ELSEWHERE.items() if card.startswith(starts))
    return next(found, "no effect on stiffness and mass")


def note_warnings(basis: Basis, parts: DeckParts, coordinates: int) -> list[str]:
    """Notes on missing sets of case control, and on differences from the deck's own program.

    ``coordinates`` is how many the article has, the most modes that can be asked of it.
    """
    entries, deck, selection = basis.entries, basis.deck, basis.deck.selection
    notes: list[str] = []
    if deck.unended:
        _, file, line = deck.unended
        notes.append(f"no ENDDATA: {deck.cards} cards to the last line, {file}:{line}; are these all?")
    for command, names in HINTS.items() if not entries.idle["EIGB"] else ():
        absent = selection.sets.get(command, frozenset()) - {e.id for e in entries.of(*names)}
        notes += [f"case control selects {command} {n}, which is not there" for n in sorted(absent)]
    matrices = {e["name"] for e in entries.of("DMIG")}
    for command, names in damping_names(deck).items():
        absent = sorted({*names} - matrices)
        notes += [f"case control selects {command} {n}, which is not there" for n in absent]
    notes += deck.notes
    stiff = {e["type"] for e in entries.of("PBARL", "PBEAML")} - {"ROD", "TUBE", "TUBE2", "BAR"}
    if stiff:
        notes.append(f"no shear flexibility in sections of shape {', '.join(sorted(stiff))}")
    if deck.bulk_only:
        notes.append("bulk data only: no case control, nothing is selected")
    # All of these are of the set to which a deck reduces; names end in 1 in the other form of a card.
    kept = dict.fromkeys(name.removesuffix("1") for name in REDUCTION if entries.of(name))
    if kept or entries.idle["OMIT"] + entries.idle["OMIT1"]:
        by = f"to its {', '.join(kept)}" if kept else "by OMIT"
        notes.append(f"the deck reduces {by}: the article keeps all degrees of freedom")
    for card in entries.of("MAT1"):
        if doubt := warnings_on_modulus(basis.units, card["e"] or 0.0):
            notes.append(f"{card.label} has {doubt}: are the units {basis.units.name}?")
    asked = asked_formulation(deck)
    if asked != basis.formulation and any(bar.section.has_mass for bar in parts.bars):
        by = "by its" if any(given(deck, "COUPMASS")) else "without a"
        notes.append(
            f"{by} PARAM COUPMASS the deck's own program uses {asked} mass, the article has "
            f"{basis.formulation} mass: to compare frequencies, convert with --mass-formulation {asked}"
        )
    return [*notes, *_modes_asked(deck, coordinates)]


def _modes_asked(deck: Deck, every: int) -> Iterator[str]:
    """Request of the selected EIGR or EIGRL (any where none is selected), as options of `modes`.

    There are no more than ``every`` one.
    """
    chosen = {n for command in ("METHOD", "METH") for n in deck.selection.sets.get(command, ())}
    for entry in deck.entries.of("EIGR", "EIGRL"):
        if chosen and entry.id not in chosen:
            continue
        if entry.name == "EIGRL":
            top, count = entry["v2"], entry["nd"]
        else:
            top, count = entry["f2"], integer((entry["rest"][1:2] or [""])[0] or "")
        number = "all " if count and count >= every else f"{count} " if count else ""
        wants = f"{number}modes" + (f" up to {top:g} Hz" if top else "")
        if top or count:
            how = (
                f": middeck modes --count {min(count, every)}"
                if count
                else ", at most: see middeck modes --count"
            )
            yield f"{entry.label} asks for {wants}{how}"
