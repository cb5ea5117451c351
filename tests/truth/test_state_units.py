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
    ModeShift,
    Plant,
    Uncertainty,
    approximate_delays,
    decide_stability,
    delay_plant,
    design_filter,
    design_lqg,
    design_sampled_lqg,
    emulate,
    make_plant,
    measure_noise_rms,
)
from middeck.control.law.partition import partition_modes
from middeck.control.robust.problem.directions import shift_directions
from middeck.control.sampled.aliases import filter_measurements
from middeck.control.sampled.sampled_design import Form
from middeck.errors import ConfigError
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.state_units import in_units, state_units
from middeck.systems.state_space.statespace import StateSpace, System

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


def test_filter_and_law_have_the_units_of_the_plant() -> None:
    """Before, the gain was of states in other units than the plant's: A - L C was another, in silence."""
    rng = np.random.default_rng([118, 7])
    plant = _plant(rng)
    t = np.exp2(rng.integers(-20, 21, 8))
    other = dataclasses.replace(plant, dynamics=in_units(plant.system, t))
    one, two = (design_filter(each, WEIGHTS) for each in (plant, other))
    for name in "AC":
        assert np.array_equal(getattr(two.model, name), getattr(other.system, name))
    assert np.array_equal(two.model.B, np.hstack([other.system.B, other.system.B]))
    _same(two.gain * t[:, None], one.gain)
    _same(two.solution.X * t * t[:, None], one.solution.X)
    law, its = design_lqg(plant, WEIGHTS, 10.0), design_lqg(other, WEIGHTS, 10.0, kalman=two)
    _same(its.regulator.gain / t, law.regulator.gain)
    _same(its.estimator.X * t * t[:, None], law.estimator.X)
    _same(its.system.A * t[:, None] / t, law.system.A)
    assert its.applied is not None
    assert law.applied is not None
    _same(its.applied * t[:, None], law.applied)
    stranger = dataclasses.replace(other, dynamics=dataclasses.replace(other.system, C=2.0 * other.system.C))
    with pytest.raises(ConfigError, match="another plant"):
        design_lqg(stranger, WEIGHTS, 10.0, kalman=two)


@pytest.mark.parametrize("form", ["predictor", "current"])
def test_sampled_laws_have_the_units_of_the_plant(form: Form) -> None:
    """Before, their gains and covariances were of other states, in silence."""
    rng = np.random.default_rng([118, 8])
    plant = _plant(rng)
    t = np.exp2(rng.integers(-20, 21, 8))
    other = dataclasses.replace(plant, dynamics=in_units(plant.system, t))
    law, its = (design_sampled_lqg(each, WEIGHTS, 10.0, 0.02, form) for each in (plant, other))
    _same(its.regulator.gain / t, law.regulator.gain)
    _same(its.estimator.X * t * t[:, None], law.estimator.X)
    _same(its.estimator.gain * t, law.estimator.gain)
    _same(its.sampled.B * t[:, None], law.sampled.B)
    assert its.applied is not None
    assert law.applied is not None
    _same(its.applied * t[:, None], law.applied)


def test_directions_have_the_units_of_the_plant_with_its_filters() -> None:
    """Before, those of the plant went to a filtered one in other units, 32 times off: shifts were refused."""
    A, B = (
        sla.block_diag([[0.0, 1.0], [0.0, 0.0]], [[0.0, 1.0], [-900.0, -0.6]]),
        [[0.0], [2e-3], [0.0], [1.0]],
    )
    ports = {"w": ["u1"], "u": ["u1"], "z": ["y1"], "y": ["y1"]}
    plant = make_plant(A, B, [[1.0, 0.0, 1.0, 0.0]], state_names=["body", "body", "bend", "bend"], **ports)
    fast = StateSpace([[0.0, 1.0], [-4e6, -2800.0]], [[0.0], [4e6]], [[1.0, 0.0]], [[0.0]])

    def finish(each: Plant) -> Plant:
        return filter_measurements(each, fast)

    shifts = (ModeShift(modes=("bend",), half_width=0.1),)
    found = shift_directions(plant, finish(plant), Uncertainty(shifts=shifts, finish=finish))
    active = partition_modes(finish(plant)).active.system
    moved = np.abs(np.linalg.eigvals(active.A + found.into @ (found.high[:, None] * found.out)))
    assert np.any(np.abs(moved / 33.0 - 1.0) < 1e-6)


def _same(one: np.ndarray, two: np.ndarray) -> None:
    assert np.all(np.abs(one - two) <= 1e-6 * np.max(np.abs(two)))


EXTREME = {
    "chain beyond range": (np.diag(np.full(39, 1e10), 1), np.eye(40)[:, -1:], np.eye(40)[:1]),
    "huge entries": (
        [[0.0, 1e300, 0.0], [0.0, 0.0, 1e300], [0.0, 0.0, 0.0]],
        [[0.0], [0.0], [1.0]],
        [[1.0, 0.0, 0.0]],
    ),
    "huge ports": ([[0.0, 1.0], [0.0, 0.0]], [[1e300], [1e300]], [[1e300, 1e300]]),
    "least entry": ([[0.0, 5e-324], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]]),
    "no input": (np.diag([1.0, 1.0], 1), np.zeros((3, 0)), np.ones((1, 3))),
    "no ports": (np.diag([1.0, 1.0], 1), np.zeros((3, 0)), np.zeros((0, 3))),
    "nothing driven": (np.diag([1.0, 1.0], 1), np.zeros((3, 1)), np.ones((1, 3))),
    "no state": (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))),
}


@pytest.mark.parametrize("system", EXTREME)
@pytest.mark.filterwarnings("error")
def test_units_of_extreme_systems_are_finite(system: str) -> None:
    A, B, C = (np.asarray(M, dtype=float) for M in EXTREME[system])
    unit = state_units(StateSpace(A, B, C, np.zeros((len(C), B.shape[1]))))
    assert unit.shape == (len(A),)
    assert np.all(np.isfinite(unit) & (np.frexp(unit)[0] == 0.5))
