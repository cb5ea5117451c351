"""The Pazy wing without skin: sag under tip masses and modes in its own weight, from its equivalent beam."""

from __future__ import annotations

import dataclasses
import os
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg as sla

import middeck as md
from measured.rows import counted_factorisations, row
from middeck.structure.model.article import AddedMass, Body, Damping, Member, Node, Structure
from middeck.structure.model.section import coupled_section

CASE, GRAVITY, ELEMENTS, RUNS = "Pazy wing", 9.807, 2, 41
NAMES = ("OOP1", "OOP2", "T1", "OOP3", "IP1")
TORSION, IN_PLANE = 2, 4
# The folder's README. Converged: an independent geometrically exact program with the lumps at the keypoints.
CONVERGED_0G = (4.2190, 28.227, 41.465, 81.38, 108.569)
CONVERGED_1G = (4.2222, 28.222, 41.204, 81.35, 102.338)
CONVERGED_SHIFT = (0.076, -0.018, -0.630, -0.033, -5.739)
UMNAST_0G = (4.2222, 28.389, 41.466, 82.522, 108.651)
PRINTED = 2.4e-5  # one unit of the last digit of 41.466
UMNAST_1G = (4.2224, 28.381, 41.199, 82.492, 102.431)
SOL103_0G = (4.2189, 28.281, 41.551, 81.888, 107.737)
SOL400_1G = (4.2225, 28.276, 41.316, 81.856, 102.408)
MEASURED_1G = (4.2, 29.2, 40.0, 80.6, None)
MID_CHORD = np.array([0.0059, 0.0, 0.0])
COUPLINGS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def rows(data: Path) -> list[dict[str, Any]]:
    """Frequencies, their shift by the weight, sag under tip masses, and what a load step costs."""
    folder = data / "pazy_skin_off"
    wing, still, hangs = structure(folder), world(0.0), world(GRAVITY)
    clear = frequencies(wing, still)
    own = frequencies(wing, hangs)
    told = [
        *_frequency_rows("at 0 g", clear, CONVERGED_0G, {"UM/NAST": UMNAST_0G, "SOL 103": SOL103_0G}),
        *_frequency_rows(
            "in its own weight",
            own,
            CONVERGED_1G,
            {"UM/NAST": UMNAST_1G, "SOL 400": SOL400_1G, "measured": MEASURED_1G},
        ),
    ]
    shift = 100.0 * (own / clear - 1.0)
    told += [
        row(CASE, f"shift of {NAMES[i]} by its weight, off the converged", "points",
            abs(shift[i] - CONVERGED_SHIFT[i]), 0.05, note=f"shift {shift[i]:+.3f} %")
        for i in (TORSION, IN_PLANE)
    ]  # fmt: skip
    told += [
        row(CASE, f"{NAMES[i]} in its own weight, over the measured", "%",
            100.0 * (own[i] / hz - 1.0), note=f"measured {hz:g} Hz, accuracy not given")
        for i, hz in enumerate(MEASURED_1G) if hz is not None
    ]  # fmt: skip
    coarse = constant_curvature(wing)
    above = ", ".join(f"{100.0 * (hz / c - 1.0):+.2f}" for hz, c in zip(coarse, CONVERGED_0G, strict=True))
    told.append(
        row(CASE, "one curvature per element, largest of five frequencies at 0 g, off UM/NAST's", "",
            float(np.abs(coarse / UMNAST_0G - 1.0).max()), PRINTED,
            note=f"{', '.join(f'{hz:.4f}' for hz in coarse)} Hz; off the converged by {above} %"),
    )  # fmt: skip
    return [*told, *_sag(folder, wing, hangs), *_cost(wing, hangs)]


def constant_curvature(wing: Structure) -> np.ndarray:
    """The lowest five frequencies [Hz] at 0 g of elements that each have one strain and one curvature.

    Strains are the unknowns: a section turns by the curvatures before it, and moves by the strains and turns
    before it, exactly so within each element. Lumps ride on the keypoints.
    """
    x = np.array([node.position for node in wing.nodes])
    axes = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).T  # columns e1, e2, e3
    size = 4 * len(wing.members)
    shift, turn = np.zeros((3, size)), np.zeros((3, size))
    M, K = np.zeros((size, size)), np.zeros((size, size))
    across = np.cross(np.eye(3), axes[:, 0]).T  # columns: unit turns times e1
    for e, member in enumerate(wing.members):
        length, own = float(np.linalg.norm(x[e + 1] - x[e])), slice(4 * e, 4 * e + 4)
        shift, before = shift + length * across @ turn, turn.copy()
        shift[:, 4 * e] += length * axes[:, 0]
        bend = np.zeros((3, size))
        bend[:, 4 * e + 1 : 4 * e + 4] = length * axes
        shift, turn = shift + 0.5 * length * across @ bend, before + bend
        lump = wing.nodes[e + 1].body
        arm = shift + np.cross(turn.T, lump.cg).T
        M += lump.mass * arm.T @ arm + turn.T @ lump.inertia @ turn
        K[own, own] = length * member.section.stiffness[np.ix_((0, 3, 4, 5), (0, 3, 4, 5))]
    return np.sqrt(sla.eigh(K, M, eigvals_only=True)[:5]) / (2.0 * np.pi)


def _frequency_rows(
    state: str, found: np.ndarray, converged: tuple[float, ...], others: dict[str, tuple[float | None, ...]]
) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = []
    for i, name in enumerate(NAMES):
        beside = ", ".join(f"{who} {hz[i]:g}" for who, hz in others.items() if hz[i] is not None)
        off = abs(found[i] / converged[i] - 1.0)
        note = f"{found[i]:.4f} Hz, converged {converged[i]:g}; {beside}"
        out.append(row(CASE, f"{name} {state}, off the converged", "", off, 1e-3, note=note))
    return out


def _sag(folder: Path, wing: Structure, hangs: md.Environment) -> list[dict[str, Any]]:
    """Displacement of the tip's middle, less that in its own weight, in % of the span."""
    umnast, sol400, measured = (
        np.loadtxt(folder / f"bending_{name}.csv", delimiter=",", skiprows=1)[:, :2].T
        for name in ("umnast", "sol400", "measured")
    )
    told: list[dict[str, Any]] = []
    begin = tip(wing, hangs, 0.0)
    for kg in (0.5, 1.0, 2.0, 3.0):
        ours = tip(wing, hangs, kg) - begin
        off = ours - float(np.interp(kg, *umnast))
        note = f"{ours:.3f} %, SOL 400 {np.interp(kg, *sol400):.3f} %"
        told.append(
            row(CASE, f"tip under {kg:g} kg, off UM/NAST's", "points of span", abs(off), 0.05, note=note)
        )
    loads = np.linspace(0.0, 3.0, 31)
    apart = [tip(wing, hangs, kg) - begin - float(np.interp(kg, *umnast)) for kg in loads]
    told.append(
        row(CASE, "tip under 31 loads from 0 to 3 kg, largest off UM/NAST's", "points of span",
            float(np.abs(apart).max()), 0.05)
    )  # fmt: skip
    for kg, seen in measured.T[1:].tolist():
        ours = tip(wing, hangs, kg) - begin
        others = {"UM/NAST": umnast, "SOL 400": sol400}
        beside = ", ".join(
            f"{who} {100.0 * (float(np.interp(kg, *curve)) / seen - 1.0):+.1f} %"
            for who, curve in others.items()
        )
        note = f"measured {-seen:.2f} % of span down, heights read to 0.09; {beside}"
        told.append(
            row(CASE, f"tip under {kg:g} kg, over the measured", "%", 100.0 * (ours / seen - 1.0), note=note)
        )
    return told


def _cost(wing: Structure, hangs: md.Environment) -> list[dict[str, Any]]:
    """Of one step to 3 kg and ten modes there, on the mesh of the keypoints."""
    once = dataclasses.replace(wing, members=tuple(dataclasses.replace(m, elements=1) for m in wing.members))
    spent: list[float] = []
    for _ in range(RUNS):
        begin = time.process_time()
        rest = md.solve_equilibrium(once, hangs, tip_mass(3.0))
        md.solve_modes(rest, 10)
        spent.append(time.process_time() - begin)
    with counted_factorisations() as factors:
        md.solve_equilibrium(once, hangs, tip_mass(3.0))
    told = row(CASE, "one step to 3 kg, factorisations of the tangent", "", len(factors), 15,
               note=f"{len(rest.history)} iterations")  # fmt: skip
    busy = f"the fastest of {RUNS} {min(spent):.3f} s; load average of the machine {os.getloadavg()[0]:.1f}"
    return [told, row(CASE, "one step to 3 kg and 10 modes", "s", float(np.median(spent)), 0.15, note=busy)]


def structure(folder: Path) -> Structure:
    """The equivalent beam: fifteen members between keypoints that carry the lumped inertias."""
    points, stiffness, inertia = (
        np.loadtxt(folder / name, delimiter=",", skiprows=1)
        for name in ("keypoints.csv", "stiffness_skin0.csv", "inertia_skin0.csv")
    )
    nodes = tuple(
        Node(f"k{i}", x, 0.0, body(lump[1:]))
        for i, (x, lump) in enumerate(zip(points, inertia, strict=True), 1)
    )
    members = tuple(
        Member(
            name=f"m{i}",
            start=a.name,
            end=b.name,
            section=coupled_section(matrix(line[1:]), rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0),
            elements=ELEMENTS,
            up=np.array([-1.0, 0.0, 0.0]),
        )
        for i, ((a, b), line) in enumerate(zip(pairwise(nodes), stiffness, strict=True), 1)
    )
    return Structure(title="Pazy wing", nodes=nodes, members=members, joints=(), springs=(), attach_points=(),
                     actuators=(), sensors=(), damping=Damping())  # fmt: skip


def matrix(line: np.ndarray) -> np.ndarray:
    K = np.diag(line[:4])
    for value, (i, j) in zip(line[4:], COUPLINGS, strict=True):
        K[i, j] = K[j, i] = value
    return K


def body(lump: np.ndarray) -> Body:
    mass, x, y, z, xx, yy, zz, xy, xz, yz = lump.tolist()
    return Body(mass, np.array([x, y, z]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def world(gravity: float) -> md.Environment:
    """Clamped at the root, with weight along -z."""
    clamped = md.Environment.clamped("k1", gravity=gravity)
    return dataclasses.replace(clamped, gravity=np.array([0.0, 0.0, -gravity]))


def frequencies(wing: Structure, environment: md.Environment) -> np.ndarray:
    """The lowest five [Hz]."""
    return md.solve_modes(md.solve_equilibrium(wing, environment), 5).frequency_hz


def tip_mass(kg: float) -> md.LoadCase:
    """A mass at the tip's middle chord."""
    body = Body(kg, MID_CHORD, np.zeros((3, 3)))
    return md.LoadCase(name="tip mass", masses=(AddedMass("tip", "k16", body),) if kg else ())


def tip(wing: Structure, environment: md.Environment, kg: float) -> float:
    """Height of the tip's middle chord [% of span]."""
    at = md.solve_equilibrium(wing, environment, tip_mass(kg)).config
    last, span = len(wing.nodes) - 1, float(wing.nodes[-1].position[1])
    return 100.0 * float(at.x[last, 2] + at.R[last, 2] @ MID_CHORD) / span
