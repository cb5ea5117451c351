"""Units of the states are the user's choice: in powers of two from 2^-20 to 2^20 every answer stays."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg as sla

from middeck import (
    Compensator,
    LQGWeights,
    Plant,
    approximate_delays,
    decide_stability,
    delay_plant,
    design_lqg,
    design_sampled_lqg,
    emulate,
    make_plant,
    measure_noise_rms,
)
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.statespace import System

OMEGA = np.geomspace(0.05, 50.0, 30)
WEIGHTS = LQGWeights(
    output=np.ones(2), input=np.ones(2), disturbed=("u1", "u2"), process=np.eye(2), sensor=[1e-3, 1e-3]
)
DELAY_S = np.array([[0.004, 0.011], [0.007, 0.002]])


def _plant(rng: np.random.Generator) -> Plant:
    """A free body and three light modes, named."""
    blocks = [[0.0, 1.0], [0.0, 0.0]], *([[0.0, 1.0], [-w * w, -0.01 * w]] for w in (0.7, 4.0, 21.0))
    B, C = np.zeros((8, 2)), np.zeros((2, 8))
    B[1::2], C[:, ::2] = rng.uniform(0.5, 2.0, (4, 2)), rng.uniform(0.5, 2.0, (2, 4))
    names = ["body", "body", "one", "one", "two", "two", "three", "three"]
    ports = {"w": ["u1", "u2"], "u": ["u1", "u2"], "z": ["y1", "y2"], "y": ["y1", "y2"]}
    return make_plant(sla.block_diag(*blocks), B, C, state_names=names, **ports)


def _in_other_units(system: System, rng: np.random.Generator) -> System:
    t = np.exp2(rng.integers(-20, 21, len(system.A)))
    return dataclasses.replace(system, A=system.A * t / t[:, None], B=system.B / t[:, None], C=system.C * t)


def _response(law: Compensator) -> np.ndarray:
    return statespace_response(law.dynamics, OMEGA)


def _stability(plant: Plant, law: Compensator) -> list[float]:
    found = decide_stability(plant, law)
    return [found.stable, found.margin, found.frequency_hz]


def _rms(plant: Plant, law: Compensator) -> list[float]:
    found = measure_noise_rms(plant, law, WEIGHTS)
    return [found.rms, found.control_rms]


ASKED: dict[str, Callable[[Plant, Compensator], object]] = {
    "law": lambda plant, law: _response(design_lqg(plant, WEIGHTS, 10.0)),
    "sampled law": lambda plant, law: _response(design_sampled_lqg(plant, WEIGHTS, 10.0, 0.02)),
    "stability": _stability,
    "stability with delays": lambda plant, law: _stability(delay_plant(plant, DELAY_S), law),
    "rms": _rms,
    "sampled rms": lambda plant, law: _rms(plant, emulate(law, 0.005)),
    "delays approximated": lambda plant, law: statespace_response(
        approximate_delays(delay_plant(plant, DELAY_S), 3).system, OMEGA
    ),
}


@pytest.mark.parametrize("asked", ASKED)
def test_nothing_hangs_on_the_units_of_the_states(asked: str) -> None:
    """Before, free bodies were refused as out of reach, stable loops called unstable, and sampled rms were
    80 % off in silence."""
    for seed in range(3):
        rng = np.random.default_rng([118, seed])
        plant = _plant(rng)
        law = design_lqg(plant, WEIGHTS, 10.0)
        other = dataclasses.replace(plant, dynamics=_in_other_units(plant.system, rng))
        its_law = Compensator(_in_other_units(law.system, rng), law.inputs, law.outputs)
        law = Compensator(law.system, law.inputs, law.outputs)
        one, two = (np.abs(ASKED[asked](*halves)) for halves in ((plant, law), (other, its_law)))
        assert np.isfinite(one).all()
        assert np.all(np.abs(one - two) <= 1e-6 * np.max(np.abs(one), axis=0))
