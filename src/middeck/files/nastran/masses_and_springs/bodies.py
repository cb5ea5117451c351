"""Concentrated masses of a deck as rigid bodies on grids, in units of the deck and basic axes."""

from collections.abc import Container, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from middeck.files.nastran.deck.coordinates import BASIC, GridPlaces
from middeck.files.nastran.deck.entries import Entries, Entry
from middeck.files.nastran.deck.nastran_numbers import integer, real
from middeck.files.nastran.masses_and_springs.scalars import ends_of, names_scalar
from middeck.files.toml.faults import DocumentFault

# Relative error of entries of a mass matrix that must vanish or agree: fields have eight columns.
ROUNDING = 1e-5


class Mass(NamedTuple):
    """A rigid body: the grid that it is on, its mass, its centre and its inertia about that."""

    grid: int
    mass: float
    centre: np.ndarray
    inertia: np.ndarray


def read_masses(entries: Entries, places: GridPlaces, faults: list[DocumentFault]) -> list[Mass]:
    """All CONM1 and CONM2; appends to ``faults`` what is wrong or no rigid body.

    A CONM2 of negative mass takes a body away from the others of its grid, which must leave one.
    """
    found: list[Mass] = []
    taken: dict[int, Entry] = {}
    for entry in entries.of("CONM2", "CONM1"):
        if entry["g"] not in places.grids:
            faults.append(entry.fault(f"there is no grid {entry['g']}", "g"))
        elif entry["cid"] not in places.systems and not (entry["cid"] == -1 and entry.name == "CONM2"):
            faults.append(entry.fault(f"there is no coordinate system {entry['cid']}", "cid"))
        else:
            try:
                found.append((_conm2 if entry.name == "CONM2" else _conm1)(entry, places))
            except ValueError as error:  # its sign is that of what is taken away: the inertia has another
                faults.append(entry.fault(str(error), "i11" if entry.name == "CONM2" else "m11"))
                continue
            if found[-1].mass < 0.0:
                taken[found[-1].grid] = entry
    for grid, entry in taken.items():
        left = _together(grid, [mass for mass in found if mass.grid == grid])
        try:
            _check(left.mass, left.inertia)
        except ValueError as error:
            faults.append(entry.fault(f"it leaves too little of the masses of grid {grid}: {error}", "m"))
    return found


def read_scalar_masses(
    entries: Entries,
    places: GridPlaces,
    scalars: Container[int],
    held: Mapping[int, str],
    riders: Container[int],
    properties: Mapping[int, float],
    faults: list[DocumentFault],
) -> list[Mass]:
    """All CMASS1 and CMASS2, together on each grid; what the ground holds has any mass.

    Those of scalar points (``scalars``) are passed over, see `read_elements`. ``properties`` are
    those of PMASS.
    Appends to ``faults`` what is no rigid body: a mass between two grids, or one that is not the same in all
    directions that are free. ``riders`` move with other grids, in all directions.
    """
    found: dict[int, tuple[Entry, np.ndarray]] = {}
    for entry in entries.of("CMASS1", "CMASS2"):
        if names_scalar(entry, scalars):
            continue
        try:
            ends = ends_of(entry)
        except ValueError as error:
            faults.append(entry.fault(str(error), "g1"))
            continue
        pid = entry.id if entry.name == "CMASS1" and entry["pid"] is None else entry.values[1]
        mass = entry["m"] if entry.name == "CMASS2" else properties.get(pid)
        if mass is None:
            faults.append(entry.fault(f"there is no PMASS {pid}", "pid"))
        elif len(ends) != 1:
            faults.append(entry.fault("a mass between two grids is not converted", "g1"))
        elif not ends[0][1]:
            what = f"grid {ends[0][0]} has components, 1 to 6: which? only scalar points have none"
            faults.append(entry.fault(what, "c1"))
        elif ends[0][0] not in places.grids:
            faults.append(entry.fault(f"there is no grid {ends[0][0]}", "g1"))
        elif mass < 0.0:
            faults.append(
                entry.fault("a negative mass is not converted", "m" if entry.name == "CMASS2" else "pid")
            )
        else:
            grid, component = ends[0]
            found.setdefault(grid, (entry, np.zeros(6)))[1][component - 1] += mass
    masses: list[Mass] = []
    for grid, (entry, values) in found.items():
        fixed = "" if grid in riders else held.get(grid, "")
        free = np.array([digit not in fixed for digit in "123456"])
        shifts = values[:3][free[:3]]
        mass = float(shifts.max(initial=0.0))
        if np.any(shifts < (1.0 - ROUNDING) * mass):
            what = f"the masses of grid {grid} differ by direction, {values[:3].tolist()}: no body has them"
            faults.append(entry.fault(what, hint="a CONM2, or hold the directions that have none"))
            continue
        R = places.displacement_axes(grid)
        inertia = _turned(np.diag(values[3:] * free[3:]), R)
        masses.append(Mass(grid, mass, places.grids[grid], inertia))
    return masses


def scalar_masses(entries: Entries, faults: list[DocumentFault]) -> dict[int, float]:
    """Masses of PMASS, of which up to four stand on a card."""
    found: dict[int, float] = {}
    for entry in entries.of("PMASS"):
        found[entry.id] = entry["m"]
        texts = [text or "" for text in entry["rest"]]
        for pair in zip(texts[::2], [*texts[1::2], ""], strict=False):
            number, mass = integer(pair[0]), real(pair[1])
            if number and mass is not None:
                found[number] = mass
            elif any(pair):
                faults.append(entry.fault(f"no number and mass: {list(pair)}", "rest"))
    return found


def merged(masses: Iterable[Mass]) -> dict[int, Mass]:
    """One body for each grid."""
    groups: dict[int, list[Mass]] = {}
    for mass in masses:
        groups.setdefault(mass.grid, []).append(mass)
    return {grid: _together(grid, group) for grid, group in groups.items()}


def _together(grid: int, group: list[Mass]) -> Mass:
    if len(group) == 1:
        return group[0]
    total = sum(part.mass for part in group)
    moment = sum((part.mass * part.centre for part in group), np.zeros(3))
    centre = moment / total if total else group[0].centre
    inertia = sum(
        (part.inertia + _moved(part.mass, part.centre - centre) for part in group), np.zeros((3, 3))
    )
    return Mass(grid, total, centre, inertia)


def _moved(mass: float, arm: np.ndarray) -> np.ndarray:
    return mass * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))


def _conm2(entry: Entry, places: GridPlaces) -> Mass:
    grid, place = entry["g"], places.grids[entry["g"]]
    given = np.array([entry["x1"], entry["x2"], entry["x3"]])
    apart = entry["cid"] == -1  # then the centre is in basic coordinates, no offset
    R = (BASIC if apart else places.systems[entry["cid"]]).axes_at(place)
    own = np.array(
        [
            [entry["i11"], -entry["i21"], -entry["i31"]],
            [-entry["i21"], entry["i22"], -entry["i32"]],
            [-entry["i31"], -entry["i32"], entry["i33"]],
        ]
    )
    sign = -1.0 if entry["m"] < 0.0 else 1.0
    _check(sign * entry["m"], sign * own)
    return Mass(grid, entry["m"], given if apart else place + R @ given, _turned(own, R))


def _turned(inertia: np.ndarray, R: np.ndarray) -> np.ndarray:
    turned = R @ inertia @ R.T
    return 0.5 * (turned + turned.T)


def _check(mass: float, inertia: np.ndarray) -> None:
    least = float(np.linalg.eigvalsh(inertia)[0])
    if mass < 0.0 or least < -ROUNDING * float(np.abs(inertia).max()):
        raise ValueError(f"no body has mass {mass:g} and a least principal inertia of {least:g}")


def _conm1(entry: Entry, places: GridPlaces) -> Mass:
    M = np.zeros((6, 6))
    for i in range(6):
        for j in range(i + 1):
            M[i, j] = M[j, i] = entry[f"m{i + 1}{j + 1}"]
    place = places.grids[entry["g"]]
    return mass_of_matrix(M, entry["g"], place, places.systems[entry["cid"]].axes_at(place))


def mass_of_matrix(M: np.ndarray, grid: int, place: np.ndarray, R: np.ndarray) -> Mass:
    """The body with the mass matrix ``M`` (6, 6) about a grid at ``place``, in axes ``R`` (columns).

    Raises `ValueError` where no body has it.
    """
    mass, arm = M[0, 0], np.zeros(3)
    if mass > 0.0:
        arm = np.array([M[2, 4], -M[2, 3], M[1, 3]]) / -mass
    x, y, z = arm
    cross = mass * np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    rigid = np.block([[mass * np.eye(3), cross], [cross.T, M[3:, 3:]]])
    scale = np.sqrt(np.abs(np.diag(M)))
    if np.any(np.abs(M - rigid) > ROUNDING * np.maximum(np.outer(scale, scale), 1e-300)):
        raise ValueError("a mass matrix of no rigid body is not converted yet")
    own = M[3:, 3:] - _moved(mass, arm)
    _check(mass, own)
    return Mass(grid, mass, place + R @ arm, _turned(own, R))
