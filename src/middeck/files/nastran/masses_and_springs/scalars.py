"""Scalar points of a deck, and its springs and masses that join them: each becomes a turn of a node.

A scalar point has one motion, without place or direction, no weight, and no part in motions as one body. A
node that turns about x alone is all of that; a mass is an inertia then, and a stiffness one per radian, for a
motion of one metre is one radian. An element with a grid's component has a node of its own, whose turn an
equation ties to what the element sees: the component, or for a mass the difference of its ends.
"""

from collections.abc import Container, Mapping
from typing import Any, NamedTuple

import numpy as np

from middeck.files.nastran.constraints.rigid_links import expand
from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.deck.deck import Deck
from middeck.files.nastran.deck.entries import CardError, Entries, Entry, add_fault
from middeck.files.toml.faults import DocumentFault
from middeck.values import record

SPRINGS = ("CELAS1", "CELAS2", "CELAS3", "CELAS4")
MASSES = ("CMASS1", "CMASS2", "CMASS3", "CMASS4")
# Elements that join scalar points alone: they give no components.
POINTS_ONLY = frozenset(("CELAS3", "CELAS4", "CMASS3", "CMASS4"))
WAY = "rx"
TURN = 3  # its place among the six of a bushing

# A scalar point and 0, or a grid and its component.
End = tuple[int, int]


class Element(NamedTuple):
    """A spring or a mass that names scalar points; ``ends`` are those that the ground does not hold."""

    entry: Entry
    ends: tuple[End, ...]
    value: float

    @property
    def is_mass(self) -> bool:
        """Whether it is a mass, not a spring."""
        return self.entry.name in MASSES

    @property
    def name(self) -> str:
        """Name of the bushing or equation that the element becomes."""
        return f"{'mass' if self.is_mass else 'spring'}{self.entry.id}"

    @property
    def node(self) -> str:
        """Name of the element's own node."""
        return f"{self.name}_node"

    @property
    def grids(self) -> tuple[End, ...]:
        """Its ends that are components of grids."""
        return tuple(end for end in self.ends if end[1])

    @property
    def points(self) -> tuple[int, ...]:
        """Its ends that are scalar points."""
        return tuple(point for point, component in self.ends if not component)

    @property
    def has_node(self) -> bool:
        """Whether the element needs a node: an end is at a grid, or it is a mass between two ends."""
        return bool(self.grids) or (self.is_mass and len(self.ends) == 2)


def ends_of(entry: Entry) -> list[End]:
    """Points and components of an element, those to the ground left out.

    Raises `ValueError` for one that joins nothing or a motion to itself, or names a component of no point.
    """
    single = entry.name in POINTS_ONLY
    given = [(entry[f"g{i}"], 0 if single else entry[f"c{i}"]) for i in "12"]
    lost = next((component for point, component in given if not point and component), 0)
    if lost:
        raise ValueError(f"component {lost} of no point")
    ends = [end for end in given if end[0]]
    if not ends:
        raise ValueError("it joins no point")
    if any(point < 0 for point, _ in ends) or any(component not in range(7) for _, component in ends):
        raise ValueError("a point is a positive number, its component 1 to 6, or 0 for a scalar point")
    if len(ends) == 2 and ends[0] == ends[1]:
        raise ValueError("it joins a motion to itself")
    return ends


def scalar_points(entries: Entries, places: GridPlaces, faults: list[DocumentFault]) -> dict[int, Entry]:
    """The scalar points by number: those of SPOINT, and those that are ends of scalar elements.

    An end is one if it has no component and no GRID its number (MSC Nastran, Quick Reference Guide, SPOINT).
    """
    found: dict[int, Entry] = {}
    for entry in entries.of("SPOINT"):
        for point in expand(entry, [text for text in entry["ids"] if text], "ids", faults):
            if point in places.grids:
                faults.append(entry.fault(f"there is a grid {point} too", "ids"))
            else:
                found[point] = entry
    for entry in entries.of(*SPRINGS, *MASSES):
        for i in "12":
            point = entry[f"g{i}"]
            if point > 0 and point not in places.grids and (entry.name in POINTS_ONLY or not entry[f"c{i}"]):
                found.setdefault(point, entry)
    return found


def names_scalar(entry: Entry, points: Container[int]) -> bool:
    """Whether an end of this element is a scalar point; otherwise both are at grids."""
    return entry.name in POINTS_ONLY or any(entry[f"g{i}"] in points for i in "12")


def held_points(deck: Deck, points: Container[int], faults: list[DocumentFault]) -> set[int]:
    """The scalar points that the selected SPC and SPC1 hold; appends to ``faults`` components of such."""
    held: set[int] = set()
    for entry in deck.selected("SPC"):
        if entry.name == "SPC1":
            named = expand(entry, [text for text in entry["grids"] if text], "grids", [])
            terms = [("grids", point, entry["c"]) for point in named]
        else:
            terms = [(f"g{i}", entry[f"g{i}"], entry[f"c{i}"]) for i in "12"]
        for key, point, components in terms:
            if point in points and components:
                faults.append(entry.fault(f"scalar point {point} has no components", key, "0 or a blank"))
            elif point in points:
                held.add(point)
    return held


def read_elements(
    entries: Entries,
    points: Container[int],
    places: GridPlaces,
    values: Mapping[str, Mapping[int, float]],
    held: tuple[Mapping[int, str], Container[int]],
    faults: list[DocumentFault],
) -> list[Element]:
    """All springs and masses with scalar points that do anything; appends to ``faults`` what is wrong.

    Args:
        entries: Entries of the deck.
        points: Its scalar points.
        places: Its grids.
        values: Values of the properties by number: ``PELAS`` stiffness, ``PMASS`` mass.
        held: Components of grids, and scalar points, that the ground holds.
        faults: Faults of the deck so far.
    """
    found: list[Element] = []
    for entry in entries.of(*SPRINGS, *MASSES):
        if not names_scalar(entry, points):
            continue
        try:
            ends = ends_of(entry)
            _check_ends(entry, ends, points, places)
            value = _value(entry, values)
        except ValueError as error:
            add_fault(faults, error, entry)
            continue
        free = [
            (point, component)
            for point, component in ends
            if (f"{component}" not in held[0].get(point, "") if component else point not in held[1])
        ]
        if free and value:
            found.append(Element(entry, tuple(free), value))
    return found


def _check_ends(entry: Entry, ends: list[End], points: Container[int], places: GridPlaces) -> None:
    keys = [f"g{i}" for i in "12" if entry[f"g{i}"]]
    for key, (point, component) in zip(keys, ends, strict=True):
        if point in points and component:
            what = f"scalar point {point} has no component {component}: 0 or a blank"
        elif point in places.grids and not component:
            what = f"grid {point} has components, 1 to 6: which? only scalar points have none"
        elif point not in points and point not in places.grids:
            what = f"there is no grid {point}; a scalar point has no component"
        else:
            continue
        raise CardError(entry.fault(what, key))


def _value(entry: Entry, values: Mapping[str, Mapping[int, float]]) -> float:
    kind, key = ("PMASS", "m") if entry.name in MASSES else ("PELAS", "k")
    if entry.name[-1] in "24":
        value = entry[key]
    else:
        pid = entry.id if entry["pid"] is None else entry["pid"]
        if pid not in values[kind]:
            raise CardError(entry.fault(f"there is no {kind} {pid}", "pid"))
        value = values[kind][pid]
    if value < 0.0:
        raise ValueError(f"a negative {'mass' if kind == 'PMASS' else 'stiffness'} is not converted")
    return value


@record(kw_only=True)
class ScalarNodes:
    """Tables of an article and of an environment, in SI units, for the scalar elements of a deck."""

    nodes: list[dict[str, Any]]
    attach: list[dict[str, Any]]
    bushings: list[dict[str, Any]]
    grounds: list[dict[str, Any]]
    clamps: list[dict[str, Any]]


def scalar_nodes(
    elements: list[Element], places: GridPlaces, length: float, mass: float, stiffness: float
) -> ScalarNodes:
    """Tables for ``elements``, without the equations of `tie_terms`; the units are those of the deck."""
    where = _whereabouts(elements, places)
    inertia = {f"s{point}": 0.0 for point in where}
    made = ScalarNodes(nodes=[], attach=[], bushings=[], grounds=[], clamps=[])
    site = {f"s{point}": place for point, place in where.items()}
    for element in elements:
        name, own = element.name, element.node
        if element.has_node:
            inertia[own] = 0.0
            site[own] = places.grids[element.grids[0][0]] if element.grids else where[element.points[0]]
        if element.is_mass:
            inertia[own if element.has_node else f"s{element.points[0]}"] += mass * element.value
            continue
        law = {"stiffness": np.eye(6)[TURN] * (stiffness * element.value)}
        ends = [f"s{point}" for point in element.points] + ([own] if element.has_node else [])
        for k, end in enumerate(ends):
            made.attach.append({"name": f"{name}{'ab'[k]}", "frame": end, "offset_m": np.zeros(3)})
        if len(ends) == 2:
            made.bushings.append({"name": name, "from": f"{name}a", "to": f"{name}b", **law})
        else:
            made.grounds.append({"name": name, "attach": f"{name}a", **law})
    for name, about_x in inertia.items():
        x, y, z = site[name] * length
        node: dict[str, Any] = {"name": name, "x_m": x, "y_m": y, "z_m": z}
        if about_x:
            node |= {"inertia_kg_m2": np.diag([about_x, 0.0, 0.0]), "rotors_excluded": True}
        made.nodes.append(node)
        made.clamps.append({"node": name, "along": "xyz", "about": "yz"})
    return made


def tie_terms(element: Element) -> list[tuple[str, End | None, float]]:
    """The equation of an element's own node: names of nodes (or a grid's component) and factors.

    A spring's node moves as its grid's component does, or as the difference of two such; a mass's as the
    difference of its ends.
    """
    seen = element.ends if element.is_mass else element.grids
    signs = (1.0, -1.0)
    terms: list[tuple[str, End | None, float]] = [(element.node, None, 1.0)]
    for (point, component), sign in zip(seen, signs, strict=False):
        terms.append((f"s{point}", None, -sign) if not component else ("", (point, component), -sign))
    return terms


def _whereabouts(elements: list[Element], places: GridPlaces) -> dict[int, np.ndarray]:
    """Position at which each scalar point is drawn: a grid's that it is joined to, or another point's."""
    found: dict[int, np.ndarray] = {}
    for element in elements:
        for point in element.points:
            if element.grids:
                found.setdefault(point, places.grids[element.grids[0][0]])
    first = next(iter(found.values()), next(iter(places.grids.values()), np.zeros(3)))
    for element in elements:
        for point in element.points:
            found.setdefault(point, first)
    return found
