"""Constraints of a deck as links of an article: RBE3, RBE2 and RBAR of some components, the selected MPC."""

from collections import Counter
from collections.abc import Container, Iterable, Iterator
from typing import Any

import numpy as np

from middeck.files.nastran.constraints.rigid_links import ALL, expand, partial_links
from middeck.files.nastran.constraints.rigid_relations import relation, rigid_elements
from middeck.files.nastran.deck.coordinates import GridPlaces, along_and_about
from middeck.files.nastran.deck.deck import Deck
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.toml.faults import DocumentFault
from middeck.values import record

# Directions of an equation's terms, shifts and turns in W.
WAYS = ("x", "y", "z", "rx", "ry", "rz")
# The component of a scalar point, which has one motion.
ONLY = "0"
# Direction cosine that is zero to rounding.
SQUARE = 1e-14


@record(kw_only=True)
class Constraint:
    """One constraint: the kind of its table in an article, that table, and what depends by which field.

    ``moves`` are the components of grids that it joins, and `ONLY` of scalar points. It means nothing
    where nothing else knows of all that one of ``defines`` names.
    """

    kind: str
    table: dict[str, Any]
    entry: Entry
    key: str
    moves: tuple[tuple[int, str], ...]
    dependent: tuple[tuple[int, str], ...]
    defines: tuple[tuple[tuple[int, str], ...], ...]

    @property
    def grids(self) -> tuple[int, ...]:
        """The grids that it joins."""
        return tuple(dict.fromkeys(grid for grid, some in self.moves if some != ONLY))

    @property
    def points(self) -> tuple[int, ...]:
        """The scalar points that it joins."""
        return tuple(dict.fromkeys(point for point, some in self.moves if some == ONLY))


def read_constraints(
    deck: Deck, places: GridPlaces, points: Container[int], still: Container[int], faults: list[DocumentFault]
) -> list[Constraint]:
    """All constraints, with or without an effect; appends to ``faults`` what is wrong.

    The ground holds the scalar ``points`` that are ``still``: they have no part in an equation.
    """
    found = [
        *_averages(deck, places, faults),
        *_links(deck, places, faults),
        *_rigid(deck, places, faults),
        *_equations(deck, places, points, still, faults),
    ]
    absent = [(c, g) for c in found for g in c.grids if g not in places.grids]
    faults += [c.entry.fault(f"there is no grid {grid}", c.key) for c, grid in absent]
    return found


def that_matter(constraints: list[Constraint], used: Container[int]) -> list[Constraint]:
    """Constraints that do more than say how a grid moves on which nothing stands.

    Two that share a motion of such a grid join what else they name.
    """
    while True:
        known = Counter(move for c in constraints for move in {(g, k) for g, some in c.moves for k in some})
        alone = {move for move, count in known.items() if count == 1 and move[0] not in used}
        kept = [c for c in constraints if not any(alone.issuperset(some) for some in c.defines)]
        if len(kept) == len(constraints):
            return kept
        constraints = kept


def joined_components(constraints: list[Constraint]) -> dict[int, str]:
    """The components, in its own axes, that constraints join of each grid."""
    found: dict[int, set[str]] = {}
    for grid, components in (move for c in constraints for move in c.moves):
        found.setdefault(grid, set()).update(components)
    return {grid: "".join(sorted(components)) for grid, components in found.items()}


def check_dependent(
    constraints: list[Constraint], carriers: dict[int, int], held: dict[int, str], faults: list[DocumentFault]
) -> None:
    """Append to ``faults`` components that are dependent twice, or dependent and held."""
    first: dict[tuple[int, str], Constraint] = {}
    for c in constraints:
        for grid, component in c.dependent:
            only = component == ONLY
            what = f"scalar point {grid}" if only else f"component {component} of grid {grid}"
            other = first.setdefault((grid, component), c)
            if grid in carriers:
                faults.append(c.entry.fault(f"{what} depends on grid {carriers[grid]} already", c.key))
            elif other is not c:
                _, file, line = other.entry.card.line()
                at = f"{other.entry.label} at {file}:{line}"
                faults.append(c.entry.fault(f"{what} is dependent twice; first by {at}", c.key))
            elif component in held.get(grid, ""):
                faults.append(c.entry.fault(f"{what} is dependent and held by the ground", c.key))
            else:
                continue
            break


def _directions(places: GridPlaces, grid: int, components: str) -> dict[str, Any]:
    axes = places.displacement_axes(grid) if grid in places.grids else np.eye(3)
    return along_and_about(components, axes)


def _averages(deck: Deck, places: GridPlaces, faults: list[DocumentFault]) -> Iterator[Constraint]:
    for entry in deck.entries.of("RBE3"):
        at, components, shares = entry["refgrid"], entry["refc"], list[dict[str, Any]]()
        groups = _weights(entry, faults)
        for weight, moves, grids in groups:
            shares += [{"frame": f"g{g}", "weight": weight, **_directions(places, g, moves)} for g in grids]
        grids = (at, *(g for _, _, found in groups for g in found))
        if at in grids[1:]:
            faults.append(entry.fault(f"grid {at} follows itself", "rest"))
        if len(set(Counter(grids[1:]).values())) > 1 and any(set(m) & set("456") for _, m, _ in groups):
            faults.append(entry.fault("grids that are not named equally often, while turns count", "rest"))
        table = {"name": f"rbe3_{entry.id}", "frame": f"g{at}", **_directions(places, at, components)}
        table["follows"] = shares
        joins = ((at, components), *((g, moves) for _, moves, found in groups for g in found))
        depends = tuple((at, c) for c in components)
        yield Constraint(
            kind="interpolation",
            table=table,
            entry=entry,
            key="refgrid",
            moves=joins,
            dependent=depends,
            defines=(depends,),
        )


def _weights(entry: Entry, faults: list[DocumentFault]) -> list[tuple[float, str, list[int]]]:
    """Weight, components and grids of each group; how dependent ones are chosen (UM) changes nothing."""
    texts = [text for text in entry["rest"] if text is not None]
    for mark in ("UM", "ALPHA"):
        if mark in texts:
            texts = texts[: texts.index(mark)]
    starts = [i for i, text in enumerate(texts) if integer(text) is None and real(text) is not None]
    if not starts or starts[0] != 0:
        faults.append(entry.fault("the first weight is missing", "rest"))
        return []
    found: list[tuple[float, str, list[int]]] = []
    for start, end in zip(starts, [*starts[1:], len(texts)], strict=True):
        weight, moves = real(texts[start]), texts[start + 1] if start + 1 < end else ""
        if weight is None or not weight > 0.0 or not moves or set(moves) - set(ALL) or end < start + 3:
            faults.append(entry.fault("a group is a weight > 0, components and grids", "rest"))
            return []
        found.append((weight, moves, expand(entry, texts[start + 2 : end], "rest", faults)))
    return found


def _links(deck: Deck, places: GridPlaces, faults: list[DocumentFault]) -> Iterator[Constraint]:
    for entry, key, carrier, grid, components in partial_links(deck.entries, faults):
        if carrier == grid:
            faults.append(entry.fault(f"grid {grid} follows itself", key))
        table = {"name": f"{entry.name.lower()}_{entry.id}_g{grid}", "from": f"g{carrier}", "to": f"g{grid}"}
        table |= _directions(places, grid, components)
        depends = tuple((grid, c) for c in components)
        joins = ((carrier, _carrying(places, carrier, grid, components)), (grid, components))
        yield Constraint(
            kind="link", table=table, entry=entry, key=key, moves=joins, dependent=depends, defines=(depends,)
        )


def _carrying(places: GridPlaces, carrier: int, grid: int, components: str) -> str:
    """Components of the carrier that move ``components`` of ``grid``: turns move shifts only at an offset."""
    known = carrier in places.grids and grid in places.grids
    turns = not set(components).isdisjoint("456")
    apart = known and bool(np.any(places.grids[grid] != places.grids[carrier]))
    shifts = not set(components).isdisjoint("123")
    return ("123" if shifts else "") + ("456" if turns or (shifts and apart) else "")


def _equations(
    deck: Deck, places: GridPlaces, points: Container[int], still: Container[int], faults: list[DocumentFault]
) -> Iterator[Constraint]:
    count: dict[int, int] = {}
    for entry in deck.selected("MPC"):
        number = count[entry.id] = count.get(entry.id, 0) + 1
        terms = [term for term in _terms(entry, points, faults) if term[0] not in still]
        if terms:
            joins = tuple((grid, component) for grid, component, _ in terms)
            each = tuple((move,) for move in joins)
            table = {"name": f"mpc{entry.id}_{number}", "term": term_rows(places, terms)}
            yield Constraint(
                kind="equation",
                table=table,
                entry=entry,
                key="terms",
                moves=joins,
                dependent=joins[:1],
                defines=each,
            )


def term_rows(places: GridPlaces, terms: Iterable[tuple[int, str, float]]) -> list[dict[str, Any]]:
    """Grids, components in their axes and factors as terms of an equation in W."""
    total: dict[tuple[int, str], float] = {}
    for grid, component, factor in terms:
        if component == ONLY:
            total[grid, ONLY] = total.get((grid, ONLY), 0.0) + factor
            continue
        axes = places.displacement_axes(grid) if grid in places.grids else np.eye(3)
        way = int(component) - 1
        for k, cosine in enumerate(axes[:, way % 3].tolist()):
            if abs(cosine) > SQUARE:
                direction = grid, WAYS[k + 3 * (way // 3)]
                total[direction] = total.get(direction, 0.0) + factor * cosine
    return [
        {"frame": f"s{g}", "direction": WAYS[3], "coefficient": a}
        if w == ONLY
        else {"frame": f"g{g}", "direction": w, "coefficient": a}
        for (g, w), a in total.items()
    ]


def _rigid(deck: Deck, places: GridPlaces, faults: list[DocumentFault]) -> Iterator[Constraint]:
    """A rigid body as rigid links from its first grid; else each dependent component as an equation."""
    for rigid in rigid_elements(deck.entries, faults):
        entry, key, name = rigid.entry, rigid.key, f"{rigid.entry.name.lower()}_{rigid.entry.id}"
        known = all(grid in places.grids for grid in rigid.grids)
        factors = relation(rigid, places, faults) if known else None
        if factors is None:
            joins = (*rigid.independent, *rigid.dependent)
            yield Constraint(
                kind="equation", table={}, entry=entry, key=key, moves=joins, dependent=(), defines=(joins,)
            )
        elif rigid.whole:
            first, *others = rigid.grids
            for grid in others:
                table = {"name": f"{name}_g{grid}", "from": f"g{first}", "to": f"g{grid}"}
                mine = {grid, *({first} if grid == others[0] else ())}
                depends = tuple(m for m in rigid.dependent if m[0] in mine)
                own = tuple((grid, c) for c in ALL)
                joins = ((first, ALL), (grid, ALL))
                yield Constraint(
                    kind="link",
                    table=table,
                    entry=entry,
                    key=key,
                    moves=joins,
                    dependent=depends,
                    defines=(own,),
                )
        else:
            for (grid, component), row in zip(rigid.dependent, factors.tolist(), strict=True):
                follows = [(g, c, -f) for (g, c), f in zip(rigid.independent, row, strict=True) if f != 0.0]
                table: dict[str, Any] = {"name": f"{name}_g{grid}_{component}"}
                table |= {"term": term_rows(places, [(grid, component, 1.0), *follows])}
                joins = ((grid, component), *((g, c) for g, c, _ in follows))
                yield Constraint(
                    kind="equation",
                    table=table,
                    entry=entry,
                    key=key,
                    moves=joins,
                    dependent=joins[:1],
                    defines=(joins[:1],),
                )


def _terms(entry: Entry, points: Container[int], faults: list[DocumentFault]) -> list[tuple[int, str, float]]:
    """Point, component and factor of each term: two in a line, its first and last fields blank."""
    texts = [entry.id, *entry["terms"]]
    found: list[tuple[int, str, float]] = []
    for start in range(0, len(texts), 8):
        line = [*texts[start : start + 8], *([None] * 7)]
        for three in (line[1:4], line[4:7]):
            if three == [None] * 3:
                continue
            grid, component, factor = integer(three[0] or ""), three[1] or "", real(three[2] or "")
            if grid is not None and grid in points and component in ("", ONLY) and factor is not None:
                found.append((grid, ONLY, factor))
                continue
            if grid is None or component not in tuple(ALL) or factor is None:
                faults.append(entry.fault(f"{three} is no grid, component 1 to 6 and factor", "terms"))
                return []
            found.append((grid, component, factor))
        if (start and line[0] is not None) or line[7] is not None:
            faults.append(entry.fault("the first and last fields of a line are blank", "terms"))
            return []
    if not found or found[0][2] == 0.0:
        faults.append(entry.fault("its first factor is zero or missing", "terms"))
        return []
    return found
