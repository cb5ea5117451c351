"""What responses beside the modes of a ground survey do to frequencies in orbit, on the frozen truths."""

from __future__ import annotations

import dataclasses
import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np

from measured.prediction import FIRST, case
from measured.rows import row
from middeck.structure.model.environment import Environment
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.refinement.bayesian_estimate import NORMAL_95
from middeck.updating.refinement.refine import refine

# The truths with responses are shared with the tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
heard = importlib.import_module("test_responses")
MEASURED = {"18 modes": (range(18), range(7)), "5 modes": (range(FIRST, FIRST + 5), range(4))}


def rows() -> list[dict[str, Any]]:
    """Of the truths, the median rms of ten frequencies in orbit, by modes alone and with responses."""
    return [
        _row(name, modes, seeds, with_response)
        for name, (modes, seeds) in MEASURED.items()
        for with_response in (False, True)
    ]


def _row(name: str, modes: range, seeds: range, with_response: bool) -> dict[str, Any]:
    error, std = np.swapaxes([_tried(seed, modes, with_response) for seed in seeds], 0, 1)
    rms = 100.0 * np.sqrt(np.mean(error**2, axis=1))
    missed = int(np.sum(np.abs(error) > NORMAL_95 * std))
    what = "with responses" if with_response else "modes alone"
    note = f"{', '.join(f'{x:.3g}' for x in rms)}; {missed} of {error.size} miss their 95 % interval"
    return row(f"response, {name}", f"{what}: rms of ten 0-g frequencies", "%", np.median(rms), note=note)


def _tried(seed: int, modes: range, with_response: bool) -> tuple[np.ndarray, np.ndarray]:
    """Errors of ten log frequencies in orbit, and what was said of them."""
    article, _ = case.sheet()
    survey, unknowns = case.survey(seed, 0, case.STRAIGHT, modes), case.sheet_unknowns(article)
    if with_response:
        survey = dataclasses.replace(survey, response=heard.truth(seed)[0].response)
        unknowns = [*unknowns, heard.DELAY, heard.GAIN, heard.MOTOR]
    told = predict_modes(refine(article, [survey], unknowns), Environment.orbit())
    error = case.log_errors(told.modes, told.frequency_hz, told.index, case.ten_in_orbit(seed))
    return error, told.log_std
