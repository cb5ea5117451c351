"""The frozen case "Updating and promise": refined on two ground surveys, promised to orbit, compared."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import middeck as md
from measured.rows import miss_row, row
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.refinement.bayesian_estimate import NORMAL_95
from middeck.updating.refinement.refine import refine
from middeck.updating.residuals.pairing import pair
from middeck.updating.residuals.surveys import Survey

# The frozen case is shared with the tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "truth"))
case = importlib.import_module("updating_case")

SEEDS = 50
FIRST = case.SUSPENSION
TEN = np.arange(FIRST, FIRST + 10)


class Outcome(NamedTuple):
    """Errors of the logarithms of ten frequencies in orbit, and what was said of them."""

    sheet: np.ndarray
    ratio: np.ndarray
    refined: np.ndarray
    std: np.ndarray
    seconds: float


def rows(name: str, chosen: Sequence[int]) -> list[dict[str, Any]]:
    """Fifty truths; modes ``chosen`` are measured, at two gimbal angles."""
    orbit, lab = sheet_modes()
    outcomes = [
        outcome(
            seed,
            [case.survey(seed, k, s, chosen) for k, s in enumerate((case.STRAIGHT, case.TURNED))],
            orbit,
            lab,
        )
        for seed in range(SEEDS)
    ]
    return rows_of(f"{name}, {len(chosen)} modes at two angles", outcomes, level=name == "sheet")


def sheet_modes() -> tuple[Modes, Modes]:
    """Those of the sheet, in orbit and in the laboratory."""
    article, lab = case.sheet()
    orbit, ground = (md.solve_modes(md.solve_equilibrium(article, e)) for e in (Environment.orbit(), lab))
    return orbit, ground


def rows_of(title: str, outcomes: Sequence[Outcome], *, level: bool) -> list[dict[str, Any]]:
    """What came out of the truths, beside what is asked where ``level`` says so."""
    count = len(outcomes)
    share = np.array([_rms(o.refined) / _rms(o.sheet) for o in outcomes])
    by_ratio = [_rms(o.ratio) / _rms(o.sheet) for o in outcomes]
    missed = float(100.0 * np.mean([np.abs(o.refined) > NORMAL_95 * o.std for o in outcomes]))
    half = float(np.median([NORMAL_95 * o.std for o in outcomes]))
    errors = [_rms(o.refined) for o in outcomes]

    def asked(value: float) -> float | None:
        return value if level else None

    return [
        row(title, "rms error of ln f of ten modes, median", "", np.median(errors), asked(1e-3)),
        row(title, f"the same, largest of {count}", "", max(errors), asked(1e-3)),
        row(title, "rms error over the sheet's, median", "", np.median(share), asked(1.0 / 30.0)),
        row(title, f"the same, largest of {count}", "", share.max(), asked(1.0 / 8.0)),
        row(title, "by ratios mode by mode, median", "", np.median(by_ratio)),
        miss_row(title, "95 % intervals that miss", missed),
        row(title, "half-width of the intervals, median", "", half, asked(1.5e-3)),
        row(title, "a refinement, median", "CPU s", np.median([o.seconds for o in outcomes]), asked(2.0)),
    ]


def outcome(seed: int, surveys: Sequence[Survey], orbit: Modes, lab: Modes) -> Outcome:
    """The sheet refined on ``surveys`` of the truth ``seed``; ``orbit`` and ``lab`` are `sheet_modes`."""
    article, _ = case.sheet()
    start = time.process_time()
    found = refine(article, surveys, case.sheet_unknowns(article))
    seconds = time.process_time() - start
    predicted = predict_modes(found, Environment.orbit())
    true = case.ten_in_orbit(seed)
    return Outcome(
        sheet=case.log_errors(orbit, orbit.frequency_hz[TEN], TEN, true),
        ratio=case.log_errors(orbit, _by_ratio(surveys[0], orbit, lab), TEN, true),
        refined=case.log_errors(predicted.modes, predicted.frequency_hz, predicted.index, true),
        std=predicted.log_std,
        seconds=seconds,
    )


def _by_ratio(survey: Survey, orbit: Modes, lab: Modes) -> np.ndarray:
    """The sheet's frequencies in orbit, each times measured over computed of its partner on the ground."""
    measured = {int(i): survey.measured.frequency_hz[j] for i, j in pair(lab, survey.measured)}
    partner = dict(md.compare_modes(orbit, lab).pairs.tolist())
    ratio = [
        measured.get(partner.get(i, -1), np.nan) / lab.frequency_hz[partner.get(i, 0)] for i in TEN.tolist()
    ]
    return orbit.frequency_hz[TEN] * np.where(np.isfinite(ratio), ratio, 1.0)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))
