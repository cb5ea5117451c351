"""Coverage of what is said of orbit, on truths that no other row draws: frequencies and the response.

That of decibels is a row of the promise. Lines of one response miss together (a sensor's gain is common to
all), so that the truths count, not the lines, and the last row is of what lines do not share. The truth has
all modes to 200 Hz, a drawn plant the lowest 26.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from measured import prediction
from measured.promise import case
from measured.rows import miss_row
from middeck.campaign.confidence_of_draws import level
from middeck.structure.model.environment import Environment
from middeck.systems.plants.plant import Plant, select_ports
from middeck.systems.plants.response import evaluate_plant
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.promise.draws import draw_plants
from middeck.updating.promise.plan import close_inner, plant_of
from middeck.updating.refinement.bayesian_estimate import NORMAL_95

SEEDS, DRAWS = range(200, 240), 60
# Of the gimbal's torque to the payload's angle under the PD loops, over the first ten flexible modes.
LINES_HZ = np.geomspace(0.5, 30.0, 40)


class Judged(NamedTuple):
    """Of each interval whether it misses, and half of its width, in per cent or decibels."""

    missed: np.ndarray
    half_width: np.ndarray


def rows(_: Any) -> list[dict[str, Any]]:
    """Shares of 95 % intervals that miss, of all truths; 1 to 10 % are asked."""
    found = [_judged(seed) for seed in SEEDS]
    title = f"coverage, {len(found)} other truths"
    asked = (
        ("ten frequencies", "%"),
        ("response, 40 lines", "dB"),
        ("response, what all lines share left out", "dB"),
    )
    return [_row(title, *what, [one[k] for one in found]) for k, what in enumerate(asked)]


def _row(title: str, what: str, unit: str, judged: Sequence[Judged]) -> dict[str, Any]:
    missed = np.array([one.missed for one in judged])
    half = np.median([one.half_width for one in judged])
    some = f"{np.sum(missed.any(axis=1))} truths of {len(missed)} have one"
    note = f"{some}; median half-width {half:.3g} {unit}"
    return miss_row(title, f"{what}: 95 % intervals that miss", float(100.0 * np.mean(missed)), note=note)


def _judged(seed: int) -> tuple[Judged, ...]:
    refined, asked = case.refined(seed), case.plan([1.0], DRAWS)
    told = predict_modes(refined, Environment.orbit())
    errors = prediction.case.log_errors(
        told.modes, told.frequency_hz, told.index, prediction.case.ten_in_orbit(seed)
    )
    drawn = draw_plants(
        refined, Environment.orbit(), partial(plant_of, asked), draws=DRAWS,
        rng=np.random.default_rng(asked.seed), loop=asked.loop, finish=partial(close_inner, asked),
    ).plants(range(DRAWS))  # fmt: skip
    said, came = np.array([_gain(plant) for plant in drawn.plants]), _gain(case.true_plant(seed))
    half = NORMAL_95 * told.log_std
    whole = (
        Judged(np.abs(errors) > half, 100.0 * half),
        _lines(said, came),
        _lines(_shape(said), _shape(came)),
    )
    print(
        f"truth {seed}: {', '.join(str(np.sum(m.missed)) for m in whole)} of {len(errors)}, 40 and 40 missed",
        flush=True,
    )
    return whole


def _lines(said: np.ndarray, came: np.ndarray) -> Judged:
    low, high = (np.array([level(line, share) for line in said.T]) for share in (0.025, 0.975))
    return Judged((came < low) | (came > high), 10.0 * np.log10(high / low))


def _shape(size: np.ndarray) -> np.ndarray:
    """Over its geometric mean: without the gain of the sensor, common to all lines."""
    return size / np.exp(np.mean(np.log(size), axis=-1, keepdims=True))


def _gain(plant: Plant) -> np.ndarray:
    return np.abs(evaluate_plant(select_ports(plant, [case.INPUT], [case.OUTPUT]), LINES_HZ).H[:, 0, 0])
