"""What the chain from the ground test to the promise takes: an update, and the study's chapter."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured import prediction
from measured.rows import row
from middeck.files.studies.documents import load_study
from middeck.study.chapters.promise.chapter import PROMISE
from middeck.updating.refinement.refine import refine

ROOT = Path(__file__).resolve().parents[2]
ELEMENTS, TRUTHS, MODES = 5, 5, 20


def update_rows() -> list[dict[str, Any]]:
    """The article of 5 elements a strut, 23 unknowns, 20 modes at two gimbal angles."""
    article, _ = md.load_setup(
        ROOT / "articles/mace-dm.toml",
        ROOT / "environments/lab.toml",
        [f"mesh.elements_per_strut={ELEMENTS}"],
    )
    angles = (prediction.case.STRAIGHT, prediction.case.TURNED)
    seconds = []
    for seed in range(TRUTHS):
        surveys = [prediction.case.survey(seed, k, a, range(MODES)) for k, a in enumerate(angles)]
        start = time.process_time()
        refine(article, surveys, prediction.case.sheet_unknowns(article))
        seconds.append(time.process_time() - start)
    title = f"update, {ELEMENTS} elements a strut, {MODES} modes at two angles"
    return [row(title, f"a refinement, median of {TRUTHS} truths", "CPU s", np.median(seconds), 2.0)]


def chain_rows() -> list[dict[str, Any]]:
    """The chapter of the main study: records, fits, refinement, promise, flight."""
    study = load_study(ROOT / "studies/mace-1993.toml")
    start = time.process_time()
    PROMISE.compute(study, PROMISE.rng(study.seed))
    title = "chain, its share of the main study"
    return [row(title, "computation of the chapter", "CPU s", time.process_time() - start, 60.0)]
