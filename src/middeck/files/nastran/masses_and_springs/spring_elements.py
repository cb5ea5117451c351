"""Springs and bushings of a deck: stiffness between two points in one place, or a point and the ground.

A CBUSH acts at its elastic point, which its grids carry rigidly. A scalar spring (CELAS) between grids that
are apart would resist rigid motion unless it acts along the line between them or on rotations; others are
refused.
"""

from collections.abc import Container, Mapping

import numpy as np

from middeck.files.nastran.deck.coordinates import GridPlaces
from middeck.files.nastran.deck.entries import CardError, Entries, Entry, add_fault
from middeck.files.nastran.deck.nastran_numbers import real
from middeck.files.nastran.masses_and_springs.scalars import ends_of, names_scalar
from middeck.files.nastran.members.members import own_axes
from middeck.files.toml.faults import DocumentFault
from middeck.values import record

ROW = 8
APART = 1e-9  # relative length, and sine between directions, that are zero
BASIC_AXES = "0 for the basic axes"
ALONG = 1e-6  # the sine between a bushing's line and its orientation vector


@record(kw_only=True)
class Tie:
    """The grids (one: to the ground), the points joined, axes and the stiffness (6, 6) in them."""

    entry: Entry
    grids: tuple[int, ...]
    points: tuple[np.ndarray, ...]
    axes: np.ndarray
    stiffness: np.ndarray

    @property
    def name(self) -> str:
        """Name of the bushing that it becomes."""
        return f"{'bush' if self.entry.name == 'CBUSH' else 'spring'}{self.entry.id}"


def arm_from(place: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Vector from a place to a point; zero where it is rounding."""
    arm = point - place
    return arm if np.linalg.norm(arm) > APART * np.linalg.norm(place) else np.zeros(3)


def read_ties(
    entries: Entries,
    places: GridPlaces,
    scalars: Container[int],
    held: Mapping[int, str],
    faults: list[DocumentFault],
) -> list[Tie]:
    """All CBUSH, CELAS1 and CELAS2 of some stiffness; appends to ``faults`` what cannot be represented.

    Springs of scalar points (``scalars``) are passed over: see `read_elements`.

    A scalar spring at a component that the ground holds (``held``, by grid) is one to the ground.
    """
    found: list[Tie] = []
    properties = entries.numbered("PELAS", "PBUSH")
    for entry in entries.of("CBUSH", "CELAS1", "CELAS2"):
        if entry.name != "CBUSH" and names_scalar(entry, scalars):
            continue
        try:
            if entry.name == "CBUSH":
                tie = _bushing(entry, properties, places)
            else:
                tie = _spring(entry, properties, places, held)
        except ValueError as error:
            add_fault(faults, error, entry)
            continue
        if tie is not None and np.any(tie.stiffness):
            found.append(tie)
    return found


def _place(entry: Entry, key: str, places: GridPlaces) -> np.ndarray:
    grid = entry[key]
    if grid not in places.grids:
        raise CardError(entry.fault(f"there is no grid {grid}", key))
    return places.grids[grid]


def _property(entry: Entry, properties: dict[int, Entry], name: str) -> Entry:
    pid = entry.id if entry["pid"] is None else entry["pid"]
    found = properties.get(pid)
    if found is None or found.name != name:
        raise CardError(entry.fault(f"there is no {name} {pid}", "pid"))
    return found


def _spring(
    entry: Entry, properties: dict[int, Entry], places: GridPlaces, held: Mapping[int, str]
) -> Tie | None:
    card = _property(entry, properties, "PELAS") if entry.name == "CELAS1" else entry
    k, ends = card["k"], ends_of(entry)
    keys = [f"{i}" for i in "12" if entry[f"g{i}"]]
    for i, (grid, component) in zip(keys, ends, strict=True):
        if not component:
            what = f"grid {grid} has components, 1 to 6: which? only scalar points have none"
            raise CardError(entry.fault(what, f"c{i}"))
    if k < 0.0:
        raise CardError(card.fault("a negative stiffness is not converted", "k"))
    points = [_place(entry, f"g{i}", places) for i in keys]
    moving = [i for i, (grid, component) in enumerate(ends) if f"{component}" not in held.get(grid, "")]
    if not moving:
        return None
    ends, points = [ends[i] for i in moving], [points[i] for i in moving]
    frames = [places.displacement_axes(grid) for grid, _ in ends]
    stiffness = np.zeros(6)
    stiffness[ends[0][1] - 1] = k
    if len(ends) == 2:
        (one, other), turns = (c - 1 for _, c in ends), [c > 3 for _, c in ends]
        first, second = frames[0][:, one % 3], frames[1][:, other % 3]
        span = points[1] - points[0]
        if turns[0] != turns[1] or np.linalg.norm(first - second) > APART:
            raise ValueError("a spring between components of different directions is not converted")
        if all(set("456") <= set(held.get(grid, "")) for grid, _ in ends):
            points[1] = points[0]  # where nothing turns, a spring acts the same anywhere
        elif (
            not turns[0]
            and np.linalg.norm(np.cross(span, first)) > APART * np.linalg.norm(points, axis=1).max()
        ):
            raise ValueError(
                "a spring across the line between its grids, which resists rigid motion: "
                "put them in one place, or hold their rotations"
            )
    return Tie(
        entry=entry,
        grids=tuple(grid for grid, _ in ends),
        points=tuple(points),
        axes=frames[0],
        stiffness=np.diag(stiffness),
    )


def _bushing(entry: Entry, properties: dict[int, Entry], places: GridPlaces) -> Tie | None:
    stiffness = _stiffness(_property(entry, properties, "PBUSH"))
    a = _place(entry, "ga", places)
    if entry["gb"] is None:
        if entry["cid"] is None:
            what = "a bushing to the ground needs a CID, 0 for the basic system: field 9 is blank"
            raise CardError(entry.fault(what, "cid"))
        point = a if entry["ocid"] == -1 else _offset(entry, a, places)
        return Tie(
            entry=entry,
            grids=(entry["ga"],),
            points=(point,),
            axes=_axes(entry, a, a, stiffness, places),
            stiffness=np.diag(stiffness),
        )
    b = _place(entry, "gb", places)
    grids = (entry["ga"], entry["gb"])
    if grids[0] == grids[1]:
        raise CardError(entry.fault("it joins a grid to itself", "gb"))
    if entry["ocid"] == -1 and not 0.0 <= entry["s"] <= 1.0:
        what = f"S is {entry['s']:g}; must be 0 to 1, a place on the line between its grids"
        raise CardError(entry.fault(what, "s"))
    point = a + entry["s"] * (b - a) if entry["ocid"] == -1 else _offset(entry, a, places)
    return Tie(
        entry=entry,
        grids=grids,
        points=(point, point),
        axes=_axes(entry, a, b, stiffness, places),
        stiffness=np.diag(stiffness),
    )


def _offset(entry: Entry, a: np.ndarray, places: GridPlaces) -> np.ndarray:
    """The elastic point at S1, S2, S3 in the system OCID.

    The Quick Reference Guides draw it from the origin of OCID, other programs (MYSTRAN) count it from GA:
    refused where these are not one.
    """
    system = places.systems.get(entry["ocid"])
    if system is None:
        raise CardError(entry.fault(f"there is no coordinate system {entry['ocid']} (OCID)", "ocid"))
    apart = float(np.linalg.norm(system.origin - a))
    if system.kind != "R" or apart > ALONG * max(np.linalg.norm(a), np.linalg.norm(system.origin)):
        raise ValueError(
            "an elastic point by OCID is measured from its origin by some programs, from GA by others: "
            "give a rectangular system whose origin is at GA, or S, its place along the line"
        )
    return a + system.axes @ np.array([entry[key] or 0.0 for key in ("s1", "s2", "s3")])


def _axes(
    entry: Entry, a: np.ndarray, b: np.ndarray, stiffness: np.ndarray, places: GridPlaces
) -> np.ndarray:
    if entry["cid"] is not None:
        if entry["cid"] not in places.systems:
            raise CardError(entry.fault(f"there is no coordinate system {entry['cid']}", "cid"))
        return places.systems[entry["cid"]].axes_at(a)
    length = float(np.linalg.norm(b - a))
    if length <= APART * max(np.linalg.norm(a), np.linalg.norm(b)):
        raise CardError(entry.fault("a bushing between grids in one place needs a CID", "cid", BASIC_AXES))
    x = (b - a) / length
    given = [entry[key] for key in ("x1", "x2", "x3")]
    if type(given[0]) is int:
        up = _place(entry, "x1", places) - a
    elif any(value is not None for value in given):
        up = places.displacement_axes(entry["ga"]) @ np.array([value or 0.0 for value in given])
    elif np.any(stiffness[[1, 2, 4, 5]]):
        what = "neither a CID nor an orientation: only K1 and K4 could be given then"
        raise CardError(entry.fault(what, "cid", BASIC_AXES))
    else:
        up = np.eye(3)[np.argmin(np.abs(x))]
    if not np.linalg.norm(np.cross(x, up)) > ALONG * np.linalg.norm(up):
        raise CardError(entry.fault("its orientation vector is zero or along it", "x1"))
    return own_axes(x, up)


def _stiffness(entry: Entry) -> np.ndarray:
    """The six of the line K; raises `ValueError` for mass, rigid directions and lines that are not known."""
    texts = ["", *(text or "" for text in entry["rest"])]
    found = np.zeros(6)
    for i in range(0, len(texts), ROW):
        early, kind, values = *[*texts[i : i + 2], ""][:2], texts[i + 2 : i + ROW]
        numbers = [real(text) if text else 0.0 for text in values]
        if early:
            what = f"PBUSH {entry.id} has {early} in field 2 of a continuation: its place is field 3"
            raise CardError(entry.fault_at(i, what))
        if kind in ("B", "GE", "RCV", "T", "A") or not any((kind, *values)):
            continue
        if kind != "K" or None in numbers:
            what = f"PBUSH {entry.id} has {kind or 'a line without a name'} {values}: not converted yet"
            raise CardError(entry.fault_at(i + 1, what))
        found[: len(numbers)] = numbers
        if np.any(found < 0.0):
            place = i + 2 + int(np.argmax(found < 0.0))
            raise CardError(entry.fault_at(place, f"PBUSH {entry.id} has a negative stiffness"))
    return found
