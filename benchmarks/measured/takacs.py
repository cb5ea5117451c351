"""A clamped beam with piezo wafers: five releases, and the beam built from its data sheet."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured.rows import row
from middeck.structure.model.article import Body, Damping, Member, Node, Section, Structure

CASE, RATE_HZ, NOISE_MM = "Takacs beam", 100.0, 0.06
# The folder's README: aluminium beam, PZT wafers bonded to it, distances from the clamp.
LENGTH, WIDTH, HEIGHT = 0.550, 0.040, 0.003
WAFER_LENGTH, WAFER_WIDTH, WAFER_HEIGHT = 0.044, 0.020, 0.00025
ALUMINIUM, PZT = (68.0e9, 2691.7), (1.0 / 16.4e-12, 7700.0)  # Young's modulus [Pa], density [kg/m3]
POISSON = 0.33
ABOVE, BELOW = (0.014, 0.090, 0.322), (0.014,)
NOTHING, UP = Body(0.0, np.zeros(3), np.zeros((3, 3))), np.array([0.0, 1.0, 0.0])
SHEET_HZ = {"bare": 8.05, "with wafers": 8.34}


def rows(data: Path) -> list[dict[str, Any]]:
    """Curves of the releases, and the first frequency of the beam; ``data`` is the folder of data sets."""
    tip = np.loadtxt(data / "takacs_beam" / "off.csv", delimiter=",", skiprows=1)[:, 1]
    found = md.fit_free_decay(tip, RATE_HZ)
    residual = float(np.sqrt(np.mean(found.residual_rms**2)))
    told = [
        row(CASE, "residual of one exponential over the noise", "", found.one_exponential_rms / NOISE_MM),
        row(
            CASE,
            "residual of curves over the noise",
            "",
            residual / NOISE_MM,
            note=f"{len(found.decays)} releases",
        ),
    ]
    for amplitude in (0.5, 2.0, 8.0):
        curves = (
            found.frequency_hz,
            found.frequency_std_hz,
            100.0 * found.damping,
            100.0 * found.damping_std,
        )
        at = [float(np.interp(amplitude, found.amplitude, curve)) for curve in curves]
        told += [
            row(CASE, f"first frequency at {amplitude:g} mm", "Hz", at[0], note=f"+- {at[1]:.1e} (1 sigma)"),
            row(CASE, f"damping at {amplitude:g} mm", "%", at[2], note=f"+- {at[3]:.1e} (1 sigma)"),
        ]
    small = float(found.frequency_hz[0])
    for name, sheet in SHEET_HZ.items():
        hz = first_frequency(name != "bare")
        told += [
            row(CASE, f"first frequency {name}, off the sheet's", "Hz", abs(hz - sheet), 0.006),
            row(
                CASE,
                f"first frequency {name}, over the measured at small amplitude",
                "%",
                100.0 * (hz / small - 1.0),
            ),
        ]
    return told


def first_frequency(wafers: bool) -> float:
    """Of the beam clamped at its root, which bends in the plane x-y."""
    cuts = np.unique([0.0, LENGTH, *(s + d for s in (*ABOVE, *BELOW) for d in (0.0, WAFER_LENGTH))])
    nodes = tuple(Node(f"n{i}", np.array([x, 0.0, 0.0]), 0.0, NOTHING) for i, x in enumerate(cuts))
    members = tuple(
        Member(
            name=f"m{i}", start=f"n{i}", end=f"n{i + 1}", section=section_at(a, b, wafers), elements=4, up=UP
        )
        for i, (a, b) in enumerate(pairwise(cuts))
    )
    beam = Structure(title="beam", nodes=nodes, members=members, joints=(), springs=(), attach_points=(),
                        actuators=(), sensors=(), damping=Damping())  # fmt: skip
    rest = md.solve_equilibrium(beam, md.Environment.clamped("n0", gravity=0.0))
    return float(md.solve_modes(rest, 4).frequency_hz[0])


def section_at(first: float, last: float, wafers: bool) -> Section:
    """Layers bonded without slip; y is across the thickness, from the beam's middle."""
    middle = 0.5 * (first + last)
    layers = [(*ALUMINIUM, WIDTH, HEIGHT, 0.0)]
    if wafers:
        off = 0.5 * (HEIGHT + WAFER_HEIGHT)
        layers += [
            (*PZT, WAFER_WIDTH, WAFER_HEIGHT, side * off)
            for side, starts in ((1.0, ABOVE), (-1.0, BELOW))
            for start in starts
            if start < middle < start + WAFER_LENGTH
        ]
    E, rho, b, h, y = np.array(layers).T
    EA = float(E @ (b * h))
    neutral = float(E @ (b * h * y)) / EA
    EI_z = float(E @ (b * h * ((y - neutral) ** 2 + h**2 / 12.0)))
    EI_y = float(E @ (h * b**3 / 12.0))
    shear = ALUMINIUM[0] / (2.0 * (1.0 + POISSON))
    GJ = shear * WIDTH * HEIGHT**3 / 3.0 * (1.0 - 0.63 * HEIGHT / WIDTH)
    polar = [float(rho @ (h * b**3 / 12.0)), float(rho @ (b * h**3 / 12.0))]
    return Section(
        EA=EA, GJ=GJ, EI_y=EI_y, EI_z=EI_z, rho_A=float(rho @ (b * h)), rho_I_y=polar[0], rho_I_z=polar[1]
    )
