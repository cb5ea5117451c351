"""Loads along members (PLOAD1) as forces and moments at their ends.

They are the negative fixed-end reactions, so that the ends move as under the distributed load. The member's
own bending between fixed ends is left out.
"""

import re
from typing import Any

import numpy as np

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis
from middeck.files.nastran.article.struts import end_frame
from middeck.files.nastran.deck.entries import Entry
from middeck.files.nastran.members.members import RODS, Bar, own_axes
from middeck.structure.elements.beam_inertia import transverse_shapes

KIND = re.compile("([FM])([XYZ])(E?)")
SCALES = {"LE": False, "FR": True}  # whether places are fractions of the length
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)
BEYOND = 1e-6  # rounding of a place at a member's end, over its length


def member_load(
    entry: Entry, bar: Bar, factor: float, basis: Basis, standing: Standing
) -> list[dict[str, Any]]:
    """The loads of an article at both ends of ``bar``; raises `ValueError` for loads not converted."""
    found = KIND.fullmatch(entry["type"])
    if found is None or entry["scale"] not in SCALES:
        raise ValueError(
            f"{entry.label}: {entry['type']} by {entry['scale']} is not converted: FX to MZE by LE or FR are"
        )
    cut = bar.section.first
    if bar.entry.name in RODS or bar.section.tapers or cut.n1 or cut.n2:
        raise ValueError(
            f"{entry.label}: a load along a rod, a taper, or a beam with its centroid off its axis"
        )
    axes = own_axes(bar.ends[1] - bar.ends[0], bar.up)
    along = (bar.element_axes if found[3] else np.eye(3))[:, "XYZ".index(found[2])]
    load = np.zeros(6)
    load[3 * (found[1] == "M") :][:3] = axes.T @ along
    length, force = basis.units.length, factor * basis.units.force
    tables: list[dict[str, Any]] = []
    for k, end in enumerate(_at_ends(bar, load, *_places(entry, bar)).reshape(2, 2, 3)):
        frame, offset = end_frame(basis, bar, k, standing)
        push, moment = (axes @ part for part in end)
        table = {"frame": frame, "force_n": push * force, "moment_nm": moment * force * length}
        tables.append(table | {"offset_m": offset * length})
    return tables


def _places(entry: Entry, bar: Bar) -> tuple[np.ndarray, np.ndarray]:
    """Fractions of the length, and the loads there: points of a quadrature if it is spread."""
    whole = 1.0 if SCALES[entry["scale"]] else bar.length
    first, last = entry["x1"], entry["x1"] if entry["x2"] is None else entry["x2"]
    if not 0.0 <= first <= last <= whole * (1.0 + BEYOND):
        raise ValueError(f"{entry.label}: it acts from {first:g} to {last:g} of {whole:g}")
    if first == last:
        return np.array([first / whole]), np.array([entry["p1"]])
    if entry["p2"] is None:
        raise ValueError(f"{entry.label}: a load from X1 to X2 has a value at both, P1 and P2")
    half = 0.5 * (1.0 + POINTS)
    spread = (1.0 - half) * entry["p1"] + half * entry["p2"]
    length = bar.length * (last - first) / whole
    return (first + half * (last - first)) / whole, 0.5 * WEIGHTS * length * spread


def _at_ends(bar: Bar, load: np.ndarray, at: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Forces and moments, in own axes, at end A and end B of ``size`` times ``load`` at fractions ``at``."""
    L, cut, (E, G, _), k = bar.length, bar.section.first, bar.section.material, bar.section.stations
    out = np.zeros(12)
    for axis in (0, 3):
        out[[axis, axis + 6]] = load[axis] * np.array([size @ (1.0 - at), size @ at])
    for across, about, sign, EI, factor in (
        (1, 5, 1.0, E * cut.i1, k.k1),
        (2, 4, -1.0, E * cut.i2, k.k2),  # w' = -theta_y
    ):
        shear = 12.0 * EI / (factor * G * cut.area * L**2) if factor * G > 0.0 else 0.0
        for x, amount in zip(at, size, strict=True):
            moves, turns = (s[0] for s in transverse_shapes(float(x), np.array([L]), np.array([shear])))
            work = amount * (load[across] * moves + sign * load[about] * turns)
            out[[across, about, across + 6, about + 6]] += work * np.array([1.0, sign, 1.0, sign])
    return out
