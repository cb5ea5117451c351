"""Coverage of what is said of orbit, on truths that no other row draws: frequencies and the response.

That of decibels is a row of the promise. Lines of one response miss together (a sensor's gain is common to
all), so that the truths count, not the lines, and the last row is of what lines do not share. The truth has
all modes to 200 Hz, a drawn plant the lowest 26.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from measured import prediction
from measured.promise import case
from measured.rows import row
from middeck.structure.model.environment import Environment
from middeck.systems.plants.plant import Plant, select_ports
from middeck.systems.plants.response import evaluate_plant
from middeck.updating.orbit.frequencies import predict_modes
from middeck.updating.promise.draws import draw_plants
from middeck.updating.promise.outlook import level
from middeck.updating.promise.plan import close_inner, plant_of
from middeck.updating.refinement.posterior import NORMAL_95

SEEDS, DRAWS = range(200, 240), 60
# Of the gimbal's torque to the payload's angle under the PD loops, over the first ten flexible modes.
LINES_HZ = np.geomspace(0.5, 30.0, 40)


def rows(_: Any) -> list[dict[str, Any]]:
    """Shares of 95 % intervals that miss, of all truths; 1 to 10 % are asked."""
    found = [_missed(seed) for seed in SEEDS]
    title = f"coverage, {len(found)} other truths"
    return [
        _row(title, what, np.array([one[k] for one in found]))
        for k, what in enumerate(
            ("ten frequencies", "response, 40 lines", "response, what all lines share left out")
        )
    ]


def _row(title: str, what: str, missed: np.ndarray) -> dict[str, Any]:
    note = f"{np.sum(missed.any(axis=1))} truths of {len(missed)} have one"
    return row(title, f"{what}: 95 % intervals that miss", "%", 100.0 * np.mean(missed), 10.0, note=note)


def _missed(seed: int) -> tuple[np.ndarray, ...]:
    refined, asked = case.refined(seed), case.plan([1.0], DRAWS)
    told = predict_modes(refined, Environment.orbit())
    errors = prediction.case.log_errors(
        told.modes, told.frequency_hz, told.index, prediction.case.ten_in_orbit(seed)
    )
    drawn = draw_plants(
        refined, Environment.orbit(), partial(plant_of, asked), draws=DRAWS,
        rng=np.random.default_rng(asked.seed), loop=asked.loop, finish=partial(close_inner, asked),
    )  # fmt: skip
    said, came = np.array([_gain(plant) for plant in drawn.plants]), _gain(case.true_plant(seed))
    whole = (
        np.abs(errors) > NORMAL_95 * told.log_std,
        _outside(said, came),
        _outside(_shape(said), _shape(came)),
    )
    print(
        f"truth {seed}: {', '.join(str(np.sum(m)) for m in whole)} of {len(errors)}, 40 and 40 missed",
        flush=True,
    )
    return whole


def _outside(said: np.ndarray, came: np.ndarray) -> np.ndarray:
    low, high = (np.array([level(line, share) for line in said.T]) for share in (0.025, 0.975))
    return (came < low) | (came > high)


def _shape(size: np.ndarray) -> np.ndarray:
    """Over its geometric mean: without the gain of the sensor, common to all lines."""
    return size / np.exp(np.mean(np.log(size), axis=-1, keepdims=True))


def _gain(plant: Plant) -> np.ndarray:
    return np.abs(evaluate_plant(select_ports(plant, [case.INPUT], [case.OUTPUT]), LINES_HZ).H[:, 0, 0])
