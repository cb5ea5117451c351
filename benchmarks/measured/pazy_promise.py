"""The Pazy wing refined on its sag to 1 kg and three own-weight frequencies; what lies beyond is predicted.

Measured sag from 1.2 to 2 kg takes no part in the refinement; it is compared with here. Masses behind the
trailing edge, with their twist, are predicted for a table that is not at hand.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured import pazy
from measured.rows import row
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.structure.model.article import AddedMass, Body, Structure
from middeck.updating.orbit.deflections import Deflection
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import Refined

CASE, SERIES = "Sag of the Pazy wing", "mid chord"
TO_KG = 1.0
# Printed to 0.1 Hz and, the torsion, to 1 Hz: evenly spread within a digit.
FITTED_HZ = {"OOP1": (4.2, 0.1), "OOP2": (29.2, 0.1), "T1": (40.0, 1.0)}
EVEN = 12.0**-0.5
HEIGHT_M, TWIST_DEG = 5e-4, 0.1  # how well heights are read; and angles, from two of them
TRAILING = np.array([0.0553, 0.0, 0.0])
TRAILING_KG = 3e-3  # before anything is seen, give or take a factor of e
# Behind the trailing edge, and the masses there.
BEHIND_M, BEHIND_KG = 0.03, (1.0, 2.0, 3.0)
# Of such an equivalent beam: 1 % of a frequency, 2 % of a sag, before anything is seen.
MODEL_ERROR, STATIC_ERROR = 0.01, 0.02
UP = np.array([0.0, 0.0, 1.0])
HEIGHT = md.updating.Gauge(name="height", at="k16", direction=UP, point=pazy.MID_CHORD, std=HEIGHT_M)
TWIST = md.updating.Gauge(
    name="twist",
    at="k16",
    kind=md.updating.GaugeKind.TILT,
    direction=UP,
    line=-TRAILING,
    std=np.radians(TWIST_DEG),
)


def rows(data: Path) -> list[dict[str, Any]]:
    """Errors of what was kept out, coverage, and what is said of other loads."""
    folder = data / "pazy_skin_off"
    kg, sag = measured(folder)
    found = refined(folder)
    span = float(found.structure.nodes[-1].position[1])
    kept = kg > TO_KG + 1e-9
    cases = [pazy.tip_mass(m) for m in kg[kept].tolist()]
    told = md.updating.predict_deflections(found, pazy.world(pazy.GRAVITY), cases, [HEIGHT], series=SERIES)
    percent = np.array([100.0 * t.value[0] / span for t in told])
    half = np.array([100.0 * 1.959964 * t.std[0] / span for t in told])
    off = np.abs(percent - sag[kept])
    article = np.array([100.0 * t.of_the_article[0] / span for t in told])
    note = "; ".join(
        f"{m:g} kg {p:.2f} +- {h:.2f} % of span" for m, p, h in zip(kg[kept], percent, half, strict=True)
    )
    return [
        row(CASE, "kept out, 1.2 to 2 kg, largest error", "points of span", off.max(), 1.0, note=note),
        row(CASE, "the same of the refined article without its static error", "points of span",
            np.abs(article - sag[kept]).max()),
        row(CASE, "kept out, 95 % intervals that miss", "of 5", float(np.sum(off > half)), 0.0),
        row(CASE, "kept out, half-width at 2 kg", "points of span", half[-1]),
        *_numbers(found),
        *_behind(found, span),
    ]  # fmt: skip


def refined(folder: Path) -> Refined:
    """On the sag to 1 kg and the three frequencies."""
    wing, hangs = structure(folder), pazy.world(pazy.GRAVITY)
    kg, sag = measured(folder)
    span = float(wing.nodes[-1].position[1])
    statics = [
        md.updating.StaticTest(
            name=f"{m:g} kg",
            environment=hangs,
            gauges=(HEIGHT,),
            value=np.array([0.01 * s * span]),
            load_case=pazy.tip_mass(m),
            series=SERIES,
        )
        for m, s in zip(kg.tolist(), sag.tolist(), strict=True)
        if m <= TO_KG + 1e-9
    ]
    return md.refine(wing, [tapped(hangs)], unknowns(), MODEL_ERROR, statics, STATIC_ERROR)


def structure(folder: Path) -> Structure:
    """The equivalent beam with some mass at its tip's trailing edge, of 10 g that may have been on."""
    trailing = AddedMass("trailing", "k16", Body(TRAILING_KG, TRAILING, np.zeros((3, 3))))
    return dataclasses.replace(pazy.structure(folder), masses=(trailing,))


def unknowns() -> list[md.Unknown]:
    """Bending by thirds of the span, torsion, all mass, and the mass at the trailing edge."""
    thirds = (range(1, 6), range(6, 11), range(11, 16))
    bending = [
        md.Unknown(
            name=f"bending, {name} third", parameters=tuple(f"member.m{i}.EI_y" for i in third), spread=0.1
        )
        for name, third in zip(("inner", "middle", "outer"), thirds, strict=True)
    ]
    return [
        *bending,
        md.Unknown(name="torsion", parameters=("member.*.GJ",), spread=0.1),
        md.Unknown(name="mass", parameters=("node.*.mass",), spread=0.02),
        md.Unknown(name="mass at the trailing edge", parameters=("mass.trailing.mass",), spread=1.0),
    ]


def behind(kg: float) -> md.LoadCase:
    """A mass behind the trailing edge of the tip."""
    place = TRAILING + np.array([BEHIND_M, 0.0, 0.0])
    return md.LoadCase(
        name=f"{kg:g} kg behind", masses=(AddedMass("behind", "k16", Body(kg, place, np.zeros((3, 3)))),)
    )


def tapped(hangs: md.Environment) -> md.Survey:
    hz, digit = np.array(list(FITTED_HZ.values())).T
    measured = MeasuredModes(
        frequency_hz=hz, damping=np.full(len(hz), np.nan), node=(), direction=(),
        shape=np.zeros((0, len(hz))), frequency_std_hz=EVEN * digit,
    )  # fmt: skip
    return md.Survey(name="own weight", measured=measured, environment=hangs)


def measured(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Masses [kg] that were hung, and heights since there were none [% of span]."""
    kg, sag = np.loadtxt(folder / "bending_measured.csv", delimiter=",", skiprows=1)[1:].T
    return kg, sag


def _numbers(found: Refined) -> list[dict[str, Any]]:
    """What was found, the model's own errors among it."""
    told = [
        row(
            CASE,
            f"{u.name}, change",
            "%",
            100.0 * x,
            note=f"+- {100.0 * std:.1f}, before +- {100.0 * u.spread:.0f}",
        )
        for u, x, std in zip(found.unknowns, found.x, found.estimate.x_std, strict=True)
    ]
    tau = dict(zip(found.sorts, found.estimate.tau, strict=True))
    said = " | ".join(findings(found))
    return [
        *told,
        row(CASE, "error of the model, of frequencies", "%", 100.0 * tau["flexible"]),
        row(
            CASE,
            "error of the model, of what members yield under load",
            "%",
            100.0 * tau["static"],
            note=said,
        ),
        row(CASE, "error of each reading, of full scale", "%", 100.0 * tau["reading"]),
    ]


def _behind(found: Refined, span: float) -> list[dict[str, Any]]:
    cases = [behind(kg) for kg in BEHIND_KG]
    told = md.updating.predict_deflections(found, pazy.world(pazy.GRAVITY), cases, [HEIGHT, TWIST])
    return [r for t in told for r in _of_case(t, span)]


def _of_case(told: Deflection, span: float) -> list[dict[str, Any]]:
    (low, high), (flat, steep) = 100.0 * told.interval[0] / span, np.degrees(told.interval[1])
    where = f"{1e3 * BEHIND_M:.0f} mm behind the trailing edge"
    return [
        row(CASE, f"{told.name} ({where}), deflection", "% of span", 100.0 * told.value[0] / span,
            note=f"95 %: {low:.2f} to {high:.2f}; not compared"),
        row(CASE, f"{told.name} ({where}), twist", "deg", np.degrees(told.value[1]),
            note=f"95 %: {flat:.2f} to {steep:.2f}; not compared"),
    ]  # fmt: skip
