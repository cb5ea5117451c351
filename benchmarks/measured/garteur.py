"""GARTEUR SM-AG19: a laboratory aeroplane from its published geometry, beside a measurement; nothing updated.

Balmes and Wright (DETC'97), Gravelle (GARTEUR TP-115, 1999). Geometry, sections and connectors are those of
garteur_geometry_tut.jl of FinEtoolsFlexStructures.jl (P. Krysl, MIT licence), lengths here in metres: x
forward, y to the left wing tip, z up. Parts "wing to plate" and "drum" are massless there and here.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured.rows import row
from middeck.structure.model.article import (
    AttachPoint,
    Body,
    Damping,
    Member,
    Node,
    Section,
    Structure,
)
from middeck.structure.model.environment import Environment, GroundBushing

CASE, PUBLISHED_KG = "GARTEUR", 43.0
E, POISSON, RHO = 70.0e9, 0.31, 2700.0
MEASURED_HZ = {
    "two-node bending": 6.37,
    "fuselage rotation": 16.10,
    "antisymmetric wing torsion": 33.13,
    "symmetric wing torsion": 33.53,
    "three-node bending": 35.65,
}
MODES = 24
BUNGEE = 4000.0
HUNG = ((0.0, 0.0, 0.0805, 2), (-0.2, 0.0, 0.0, 1))  # place [m] and number of bungees
ADDED = {(0.18, 0.92, 0.096): 0.2, (0.18, -0.92, 0.096): 0.2, (-0.8, 0.0, 0.38): 0.432}
UP, AHEAD = (0.0, 0.0, 1.0), (1.0, 0.0, 1.0)
# Part: depth along the own y axis, along the own z axis [m], a vector that fixes the own y axis.
PARTS = {
    "fuselage": (0.150, 0.050, AHEAD),
    "wing": (0.010, 0.100, UP),
    "wing drum": (0.010, 0.100, UP),
    "fin": (0.100, 0.010, AHEAD),
    "tail plane": (0.010, 0.100, UP),
    "plate": (0.0011, 0.0762, UP),
    "wing to plate": (0.005, 0.005, AHEAD),
    "wing under drum": (0.010, 0.100, UP),
    "drum": (0.050, 0.050, AHEAD),
    "fuselage to wing": (0.020, 0.100, (0.0, 1.0, 0.0)),
    "fuselage to fin": (0.100, 0.100 / 3.0, AHEAD),
    "sensor": (0.020, 0.020, AHEAD),
}
MASSLESS = ("wing to plate", "drum")
WING_Z, DRUM_Z, PLATE_X, PLATE_Z = 0.0805, 0.091, -0.0119, 0.08665
STATIONS = (0.0, *(0.025 + i * 0.825 / 8 for i in range(9)))  # of the plate along a wing
UNDER_DRUM = (0.90, 0.95, 1.0)  # stations of the wing where a drum lies on it
VARIANTS: dict[str, dict[str, Any]] = {
    "as published": {},
    "plate not bonded": {"loose": ("plate",)},
    "no tape and no plate": {"left_out": ("plate", "wing to plate")},
    "sensors' connectors massless": {"massless": (*MASSLESS, "sensor")},
    "fuselage's connectors rigid": {"stiff": ("fuselage to wing", "fuselage to fin")},
    "drums' connectors rigid": {"stiff": ("drum",)},
    "wing rigid under the drums": {"stiff": ("wing under drum", "drum")},
    "sensors' massless and wing rigid": {
        "massless": (*MASSLESS, "sensor"),
        "stiff": ("wing under drum", "drum"),
    },
}
Parts = tuple[str, ...]
Lines = Iterator[tuple[str, int, list[tuple[float, float, float]]]]


def rows(_: Path) -> list[dict[str, Any]]:
    """Every mode beside the measured one; then what the doubtful parts and the bungees matter."""
    article, names = aeroplane(), list(MEASURED_HZ)
    hz, measured = frequencies(article), np.array(list(MEASURED_HZ.values()))
    afloat = frequencies(article, Environment.orbit())
    mass = 100.0 * (article.mass / PUBLISHED_KG - 1.0)
    told = [row(CASE, "mass over the published", "%", mass, note=f"{article.mass:.2f} of {PUBLISHED_KG} kg")]
    for name, ours, theirs in zip(names, hz, measured, strict=True):
        off = 100.0 * (ours / theirs - 1.0)
        told.append(row(CASE, f"{name} over the measured", "%", off, note=f"{ours:.2f} of {theirs:.2f} Hz"))
    for name, parts in VARIANTS.items():
        found = frequencies(aeroplane(**parts))
        mean = 100.0 * float(np.mean(np.abs(found / measured - 1.0)))
        note = ", ".join(f"{f:.2f}" for f in found) + " Hz"
        told.append(row(CASE, f"mean error of five modes, {name}", "%", mean, note=note))
    told.append(row(CASE, "wing torsion, raised by warping held at both ends", "%", warping_held()))
    for name, held, free in zip(names, hz, afloat, strict=True):
        told.append(row(CASE, f"{name}, raised by the bungees", "%", 100.0 * (held / free - 1.0)))
    return told


def aeroplane(
    loose: Parts = (), stiff: Parts = (), left_out: Parts = (), massless: Parts = MASSLESS
) -> Structure:
    """The article; ``loose`` parts carry no axial force, ``stiff`` ones are a thousand times as stiff."""
    nodes: dict[tuple[float, float, float], str] = {}
    members = []
    for part, elements, points in lines():
        if part in left_out:
            continue
        names = [nodes.setdefault(_at(p), f"n{len(nodes)}") for p in points]
        section = section_of(part, part in loose, part in stiff, part in massless)
        up = np.array(PARTS[part][2])
        for a, b in pairwise(names):
            name = f"{part} {len(members)}"
            members.append(Member(name=name, start=a, end=b, section=section, elements=elements, up=up))
    bodies = {_at(place): mass for place, mass in ADDED.items()}
    return Structure(
        title=CASE,
        nodes=tuple(
            Node(name, np.array(p), 0.0, Body(bodies.get(p, 0.0), np.zeros(3), np.zeros((3, 3))))
            for p, name in nodes.items()
        ),
        members=tuple(members),
        joints=(),
        springs=(),
        attach_points=tuple(
            AttachPoint(f"bungee {i}", nodes[_at(p)], np.zeros(3)) for i, (*p, _) in enumerate(HUNG)
        ),
        actuators=(),
        sensors=(),
        damping=Damping(),
    )


def _at(place: Any) -> tuple[float, float, float]:
    x, y, z = np.round(np.array(place, dtype=float), 6) + 0.0
    return float(x), float(y), float(z)


def lines() -> Lines:
    """Part, elements of each piece, and points [m] that its pieces join."""
    yield "fuselage", 4, [(x, 0.0, 0.0) for x in (-0.9, -0.85, -0.8, -0.2, 0.0, 0.6)]
    yield "fin", 4, [(-0.8, 0.0, z) for z in (0.075, 0.335, 0.375)]
    yield "fuselage to fin", 1, [(-0.8, 0.0, 0.0), (-0.8, 0.0, 0.075)]
    yield "drum", 1, [(-0.8, 0.0, 0.375), (-0.8, 0.0, 0.38)]
    yield "wing to plate", 1, [(0.0, 0.0, WING_Z), (PLATE_X, 0.0, PLATE_Z)]
    for side in (1.0, -1.0):
        yield from _half(side)


def _half(side: float) -> Lines:
    """What stands on one side of the middle plane."""
    wing = [(0.0, side * y, WING_Z) for y in (*STATIONS, UNDER_DRUM[0])]
    plate = [(PLATE_X, side * y, PLATE_Z) for y in STATIONS]
    tip = side * 0.95
    yield "wing", 2, wing
    yield "wing under drum", 1, [(0.0, side * y, WING_Z) for y in UNDER_DRUM]
    yield "plate", 1, plate
    for pair in zip(wing[1:], plate[1:], strict=False):
        yield "wing to plate", 1, list(pair)
    yield "fuselage to wing", 1, [(0.0, 0.0, 0.0), wing[1]]
    yield "drum", 1, [(0.0, tip, WING_Z), (0.0, tip, DRUM_Z)]
    yield "wing drum", 2, [(x, tip, DRUM_Z) for x in (-0.2, 0.0, 0.2)]
    yield "sensor", 1, [(0.0, tip, DRUM_Z), (0.0, side * 0.98, 0.096)]
    for end in (-1.0, 1.0):
        yield "sensor", 1, [(end * 0.2, tip, DRUM_Z), (end * 0.18, side * 0.98, 0.096)]
    yield "sensor", 1, [(0.2, tip, DRUM_Z), (0.18, side * 0.92, 0.096)]
    yield "tail plane", 4, [(-0.8, 0.0, 0.38), (-0.8, side * 0.2, 0.38)]
    yield "sensor", 1, [(-0.8, side * 0.2, 0.38), (-0.765, side * 0.185, 0.385)]


def section_of(part: str, loose: bool, stiff: bool, massless: bool) -> Section:
    """Of a rectangle, with shear factor 5/6 and the torsion of a flat bar (Roark, table 10.7)."""
    h, b, _ = PARTS[part]
    thin, wide = min(h, b), max(h, b)
    G = E / (2.0 * (1.0 + POISSON))
    J = wide * thin**3 * (1.0 / 3.0 - 0.21 * thin / wide * (1.0 - (thin / wide) ** 4 / 12.0))
    more, rho = 1000.0 if stiff else 1.0, 0.0 if massless else RHO
    area, I_y, I_z = b * h, h * b**3 / 12.0, b * h**3 / 12.0
    shear = 5.0 / 6.0 * more * G * area
    return Section(
        EA=more * E * area * (1e-6 if loose else 1.0),
        GJ=more * G * J,
        EI_y=more * E * I_y,
        EI_z=more * E * I_z,
        rho_A=rho * area,
        rho_I_y=rho * I_y,
        rho_I_z=rho * I_z,
        GA_y=shear,
        GA_z=shear,
    )


def on_bungees() -> Environment:
    """Vertical springs, as the source has them: no length is published, so nothing swings."""
    up = np.zeros((6, 6))
    up[2, 2] = BUNGEE
    held = tuple(
        GroundBushing(name=f"bungee {i}", attach=f"bungee {i}", stiffness=n * up)
        for i, (*_, n) in enumerate(HUNG)
    )
    return Environment(title="bungees", gravity=np.zeros(3), bushings=held)


def frequencies(article: Structure, environment: Environment | None = None) -> np.ndarray:
    """Those [Hz] of the measured modes: the lowest of each shape; on the bungees unless told otherwise."""
    modes = md.solve_modes(md.solve_equilibrium(article, environment or on_bungees()), MODES)
    named = {}
    for k in np.flatnonzero(np.array(modes.kind) == "flexible"):
        shape = modes.shapes[: 6 * len(article.nodes), k].reshape(-1, 6)
        named.setdefault(shape_name(article, shape), modes.frequency_hz[k])
    return np.array([named[name] for name in MEASURED_HZ])


def shape_name(article: Structure, shape: np.ndarray) -> str:
    """By the wing's heave against twist and sway, its symmetry, its nodes, and whether the fin goes along."""
    places = np.array([node.position for node in article.nodes])
    wing = np.flatnonzero((places[:, 0] == 0.0) & (places[:, 2] == WING_Z))
    wing = wing[np.argsort(places[wing, 1])]
    fin = int(np.argmin(np.linalg.norm(places - [-0.8, 0.0, 0.38], axis=1)))
    heave, twist, roll = shape[wing, 2], shape[wing, 4], shape[wing[len(wing) // 2], 3]
    corner = 0.2 * np.abs(twist).max()  # of a drum
    if np.abs(shape[wing, 0]).max() > max(np.abs(heave).max(), corner):
        return "in plane"
    if corner > np.abs(heave).max():
        return "symmetric wing torsion" if twist[0] * twist[-1] > 0.0 else "antisymmetric wing torsion"
    if heave[0] * heave[-1] > 0.0:
        nodes = int(np.sum(heave[:-1] * heave[1:] < 0.0))
        return "two-node bending" if nodes == 2 else "symmetric bending"
    half = heave[len(heave) // 2 + 1 :]
    if np.sum(half[:-1] * half[1:] < 0.0) != 1:
        return "antisymmetric bending"
    return "fuselage rotation" if roll * shape[fin, 1] < 0.0 else "three-node bending"


def warping_held() -> float:
    """Rise [%] of a wing's torsion where no end may warp: Vlasov, Cw = b^3 t^3 / 144 of a flat bar."""
    t, b, _ = PARTS["wing"]
    wing = section_of("wing", loose=False, stiff=False, massless=False)
    kL = np.sqrt(wing.GJ / (E * b**3 * t**3 / 144.0)) * (0.95 - STATIONS[1])
    return 100.0 * float((1.0 - 2.0 / kL * np.tanh(kL / 2.0)) ** -0.5 - 1.0)
