"""GARTEUR SM-AG19 refined on its first three flexible modes: the torsion partner and the modes after it.

The fourth and fifth measured frequencies take no part in the first fit and are compared with; higher ones are
not at hand, and what is said of them stands here to be compared with by others. Shapes are not published with
the frequencies: each measured mode has that of the model's mode of its name, loosely, which pairs them and
tells nothing of how close modes mix.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured import garteur
from measured.rows import row
from middeck.structure.correlation.measured_modes import MeasuredModes, sensor_rows
from middeck.structure.modes.solve import Modes
from middeck.updating.orbit.predicted_frequencies import Prediction
from middeck.updating.refinement.refine import Refined

CASE = "Torsion of GARTEUR"
NAMES, HZ = tuple(garteur.MEASURED_HZ), np.array(list(garteur.MEASURED_HZ.values()))
# Printed to 0.01 Hz; of one laboratory among twelve. A bolted aeroplane is not the same twice to 0.1 %.
STD = 1e-3
# Of a model of beams and rigid connectors, before anything is seen.
MODEL_ERROR = 0.02
LOOSE, AFTER = 0.3, 6


def rows(_: Path) -> list[dict[str, Any]]:
    """From three modes, from all but one in turn, and from all five."""
    article = garteur.aeroplane()
    modes = md.solve_modes(md.solve_equilibrium(article, garteur.on_bungees()), garteur.MODES)
    three, five = (_predicted(refined(modes, chosen)) for chosen in ((0, 1, 2), range(5)))
    told = [r for k, level in ((3, 1.5), (4, None)) for r in _compared(three, k, level)]
    left_out = [_left_out(modes, k) for k in range(len(HZ))]
    told += [r for r, _ in left_out]
    missed = float(sum(miss for _, miss in left_out))
    told.append(row(CASE, "of five left out in turn, outside their intervals", "", missed, 0.0))
    return [*told, *_after("three", three), *_after("five", five)]


def _compared(told: Prediction, k: int, level: float | None) -> list[dict[str, Any]]:
    hz, low, high = _of(told, k)
    error, name = 100.0 * abs(hz / HZ[k] - 1.0), f"{NAMES[k]} from three modes"
    note = f"{hz:.2f} Hz, 95 % {low:.2f} to {high:.2f}, measured {HZ[k]:.2f}"
    return [
        row(CASE, f"{name}, error", "%", error, level, note=note),
        row(CASE, f"{name}, outside its interval", "", float(not low < HZ[k] < high), 0.0),
    ]


def _left_out(modes: Modes, k: int) -> tuple[dict[str, Any], bool]:
    hz, low, high = _of(_predicted(refined(modes, [j for j in range(len(HZ)) if j != k])), k)
    error, note = 100.0 * (hz / HZ[k] - 1.0), f"{hz:.2f} Hz, 95 % {low:.2f} to {high:.2f}"
    told = row(CASE, f"{NAMES[k]} from the four others, error", "%", error, note=note)
    return told, not low < HZ[k] < high


def unknowns() -> list[md.Unknown]:
    """What of the published article is doubtful: `garteur.VARIANTS` has how much each matters."""

    def of(part: str, *fields: str) -> tuple[str, ...]:
        return tuple(f"member.{part} [0-9]*.{field}" for field in fields)

    bending = ("EI_y", "EI_z")
    found = {
        "wing, bending": (of("wing", *bending), 0.03),
        "wing, torsion": (of("wing", "GJ"), 0.1),
        "plate and its bond": (of("plate", "E"), 0.5),
        "fuselage, bending": (of("fuselage", *bending), 0.03),
        "fin and tail, bending": ((*of("fin", *bending), *of("tail plane", *bending)), 0.03),
        "drums' inertia": (of("wing drum", "rho"), 0.03),
        "sensors' connectors, mass": (of("sensor", "rho"), 1.0),
        "connectors of fuselage": ((*of("fuselage to wing", "E"), *of("fuselage to fin", "E")), 1.0),
        "drums on the wing, stiffness": ((*of("wing under drum", "E"), *of("drum", "E")), 1.0),
        "bungees": (("environment.bushing.*.stiffness.33",), 0.05),
    }
    return [md.Unknown(name=n, parameters=p, spread=s) for n, (p, s) in found.items()]


def refined(modes: Modes, chosen: Sequence[int]) -> Refined:
    """On some of the five measured modes; ``modes`` are those of the article as published."""
    article = modes.equilibrium.model.structure
    hz = HZ[list(chosen)]
    channels = [(n.name, d) for n in article.nodes for d in "xyz"]
    node, direction = zip(*channels, strict=True)
    shape = np.asarray(sensor_rows(modes, node, direction) @ modes.shapes)
    shape = shape[:, [named(modes, NAMES[k]) for k in chosen]]
    measured = MeasuredModes(
        frequency_hz=hz,
        damping=np.full(len(hz), np.nan),
        node=node,
        direction=direction,
        shape=shape,
        frequency_std_hz=STD * hz,
        shape_std=LOOSE * np.abs(shape).max(axis=0) * np.ones_like(shape),
    )
    survey = md.Survey(name="participant C", measured=measured, environment=garteur.on_bungees())
    return md.refine(article, [survey], unknowns(), MODEL_ERROR)


def named(modes: Modes, name: str) -> int:
    """The lowest mode of this name."""
    article = modes.equilibrium.model.structure
    size = 6 * len(article.nodes)
    return next(
        int(k)
        for k in np.flatnonzero(np.array(modes.kind) == "flexible")
        if garteur.shape_name(article, modes.shapes[:size, k].reshape(-1, 6)) == name
    )


def _predicted(found: Refined) -> Prediction:
    return md.predict_modes(found, garteur.on_bungees(), count=len(HZ) + AFTER + 2)


def _of(told: Prediction, k: int) -> tuple[float, float, float]:
    """Frequency and interval of one of the measured modes."""
    at = int(np.flatnonzero(told.index == named(told.modes, NAMES[k]))[0])
    low, high = told.interval_hz[at].tolist()
    return float(told.frequency_hz[at]), low, high


def _after(what: str, told: Prediction) -> list[dict[str, Any]]:
    """The modes after the measured ones."""
    known = {named(told.modes, name) for name in NAMES}
    flexible = np.array(told.modes.kind)[told.index] == "flexible"
    places = [a for a in np.flatnonzero(flexible).tolist() if int(told.index[a]) not in known]
    out = []
    for number, a in enumerate(places[:AFTER], start=len(HZ) + 1):
        low, high = told.interval_hz[a].tolist()
        note = f"95 % {low:.2f} to {high:.2f}; {told.modes.name[int(told.index[a])]}; not compared"
        hz = float(told.frequency_hz[a])
        out.append(row(CASE, f"mode {number} from {what} modes", "Hz", hz, note=note))
    return out
