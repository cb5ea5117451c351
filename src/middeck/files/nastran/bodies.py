"""Concentrated masses of a deck as rigid bodies on grids, in units of the deck and basic axes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from middeck.files.faults import Fault
from middeck.files.nastran.coordinates import BASIC, Places
from middeck.files.nastran.entries import Entries, Entry

# Of entries of a mass matrix that must vanish or agree, over their size: fields of eight columns.
ROUNDING = 1e-5


class Mass(NamedTuple):
    """A rigid body: the grid that it is on, its mass, its centre and its inertia about that."""

    grid: int
    mass: float
    centre: np.ndarray
    inertia: np.ndarray


def read_masses(entries: Entries, places: Places, faults: list[Fault]) -> list[Mass]:
    """All CONM1 and CONM2; appends to ``faults`` what is wrong or no rigid body."""
    found: list[Mass] = []
    for entry in entries.of("CONM2", "CONM1"):
        if entry["g"] not in places.grids:
            faults.append(entry.fault(f"there is no grid {entry['g']}", "g"))
        elif entry["cid"] not in places.systems and not (entry["cid"] == -1 and entry.name == "CONM2"):
            faults.append(entry.fault(f"there is no coordinate system {entry['cid']}", "cid"))
        else:
            try:
                found.append((_conm2 if entry.name == "CONM2" else _conm1)(entry, places))
            except ValueError as error:
                faults.append(entry.fault(str(error)))
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


def _conm2(entry: Entry, places: Places) -> Mass:
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
    _check(entry["m"], own)
    return Mass(grid, entry["m"], given if apart else place + R @ given, _turned(own, R))


def _turned(inertia: np.ndarray, R: np.ndarray) -> np.ndarray:
    turned = R @ inertia @ R.T
    return 0.5 * (turned + turned.T)


def _check(mass: float, inertia: np.ndarray) -> None:
    least = float(np.linalg.eigvalsh(inertia)[0])
    if mass < 0.0 or least < -ROUNDING * float(np.abs(inertia).max()):
        raise ValueError(f"no body has mass {mass:g} and a least principal inertia of {least:g}")


def _conm1(entry: Entry, places: Places) -> Mass:
    M = np.zeros((6, 6))
    for i in range(6):
        for j in range(i + 1):
            M[i, j] = M[j, i] = entry[f"m{i + 1}{j + 1}"]
    mass, arm = M[0, 0], np.zeros(3)
    if mass > 0.0:
        arm = np.array([M[2, 4], -M[2, 3], M[1, 3]]) / -mass
    x, y, z = arm
    cross = mass * np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    rigid = np.block([[mass * np.eye(3), cross], [cross.T, M[3:, 3:]]])
    scale = np.sqrt(np.abs(np.diag(M)))
    if np.any(np.abs(M - rigid) > ROUNDING * np.maximum(np.outer(scale, scale), 1e-300)):
        raise ValueError("a mass matrix of no rigid body is not converted yet")
    place = places.grids[entry["g"]]
    R = places.systems[entry["cid"]].axes_at(place)
    own = M[3:, 3:] - _moved(mass, arm)
    _check(mass, own)
    return Mass(entry["g"], mass, place + R @ arm, _turned(own, R))
