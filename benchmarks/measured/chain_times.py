"""What the chain from the ground test to the promise takes: an update, and the study's chapter."""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured import prediction
from measured.promise import case
from measured.rows import row
from middeck.control.robust.verification.monte_carlo import outcomes_on, which_decay
from middeck.files.studies.documents import load_study
from middeck.study.chapters.promise.chapter import PROMISE
from middeck.updating.promise.draws import draw_plants
from middeck.updating.promise.plan import close_inner, group_loop, plant_of, weights_of
from middeck.updating.promise.promise import design_ladder
from middeck.updating.refinement.refine import refine

ROOT = Path(__file__).resolve().parents[2]
ELEMENTS, TRUTHS, MODES = 5, 5, 20
DRAWS, LAWS, CORES = 100, 10.0 ** np.linspace(0.0, 6.0, 20), 2


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


def verdict_rows() -> list[dict[str, Any]]:
    """Verdicts and decibels of drawn plants in closed loop, a half of the laws of a ladder on each core.

    What no law changes of a plant is found once for it, as in a promise.
    """
    refined, asked = case.refined(0), case.plan(LAWS, DRAWS)
    assert asked.ladder is not None
    place = next(iter(asked.environments.values()))
    drawn = draw_plants(
        refined, place, partial(plant_of, asked), draws=DRAWS,
        rng=np.random.default_rng(asked.seed), loop=asked.loop, finish=partial(close_inner, asked),
    ).plants(range(DRAWS))  # fmt: skip
    loops = [group_loop(asked, p, asked.ladder.drives, asked.ladder.reads) for p in drawn.plants]
    laws = list(design_ladder(case.modes_in_orbit(refined), asked).values())
    weights = weights_of(asked, laws[0].outputs, laws[0].inputs)
    halves = [laws[k::CORES] for k in range(CORES)]
    with ProcessPoolExecutor(CORES) as pool:
        list(pool.map(abs, range(CORES)))  # the processes are there before the clock runs
        start = time.perf_counter()
        stable = list(pool.map(partial(_stable, loops, weights), halves))
        decided = time.perf_counter()
        outcomes = list(pool.map(partial(_outcomes, loops, weights), halves))
        measured = time.perf_counter()
    differ = sum(int(np.sum(np.not_equal(a, b))) for a, b in zip(stable, outcomes, strict=True))
    title = f"verdicts, {len(loops) * len(laws)} closed loops: {len(loops)} drawn plants, {len(laws)} laws"
    return [
        row(title, f"stability, {CORES} cores", "s", decided - start, 4.0),
        row(title, f"decibels, {CORES} cores", "s", measured - decided, 20.0),
        row(title, "verdicts that differ", "", differ, 0.0),
    ]


def _stable(loops: list[Any], weights: Any, laws: list[Any]) -> list[Any]:
    return [which_decay(loops, law, weights) for law in laws]


def _outcomes(loops: list[Any], weights: Any, laws: list[Any]) -> list[Any]:
    return [outcomes_on(loops, law, weights)[0].stable for law in laws]
