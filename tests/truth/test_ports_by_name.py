"""A compensator finds its ports by name and unit, in whatever order they stand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator, evaluate_compensator
from middeck.control.loop.closed_loop import close_loop, predict_closed_loop_response
from middeck.control.lqg.weights import LQGWeights
from middeck.control.noise import measure_noise_rms
from middeck.control.qualification import align_plant
from middeck.control.reduction.reduced_compensators import reduce_compensator
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.control.sampled.emulation import emulate
from middeck.errors import ConfigError
from middeck.laboratory.rig.parts.computer import place_law
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes

INPUTS = Port("u0", "N m"), Port("u1", "N m")
OUTPUTS = Port("y0", "rad"), Port("y1", "rad")
WEIGHTS = LQGWeights(
    output=np.array([1.0, 2.0]), input=np.array([1.0, 3.0]), disturbed=("u0", "u1"),
    process=np.diag([1.0, 2.0]), sensor=np.array([1e-3, 2e-3]),
)  # fmt: skip
HZ = np.array([0.5, 1.0, 4.0])


@pytest.fixture(scope="module")
def plant():
    rng = np.random.default_rng(0)
    phi, names = rng.standard_normal((2, 2)), ("u0", "u1", "y0", "y1")
    modal = sum_of_modes(2.0 * np.pi * np.array([1.0, 3.0]), 0.05, rng.standard_normal((2, 2)), phi)
    return Plant(
        dynamics=modal, inputs=INPUTS, outputs=OUTPUTS, w=names[:2], u=names[:2], z=names[2:], y=names[2:]
    )


@pytest.fixture(scope="module")
def law():
    rng = np.random.default_rng(1)
    A = np.array([[-3.0, 1.0], [0.0, -5.0]])
    return Compensator(
        StateSpace(A, rng.standard_normal((2, 2)), 0.1 * rng.standard_normal((2, 2)), np.zeros((2, 2))),
        OUTPUTS,
        INPUTS,
    )


JUDGES = {
    "align_plant": lambda plant, law: align_plant(plant, law),
    "close_loop": lambda plant, law: np.sort_complex(close_loop(plant, law).poles),
    "measure_margins": lambda plant, law: sorted(
        (loop.channel, loop.sensitivity.gain) for loop in measure_margins(plant, law).loops
    ),
    "noise": lambda plant, law: measure_noise_rms(plant, law, WEIGHTS).rms,
    "sampled noise": lambda plant, law: measure_noise_rms(plant, emulate(law, 0.02), WEIGHTS).rms,
    "place_law": lambda plant, law: place_law(emulate(law, 0.02), plant.inputs, plant.outputs, 0.02).D,
    "predict": lambda plant, law: (
        predict_closed_loop_response(evaluate_plant(plant, HZ), evaluate_compensator(law, HZ)).H
    ),
}


@pytest.mark.parametrize("judge", JUDGES.values(), ids=JUDGES)
def test_the_order_of_ports_changes_nothing(plant, law, judge):
    turned = Compensator(law.dynamics.select((1, 0), (1, 0)), law.inputs[::-1], law.outputs[::-1])
    half = Compensator(law.dynamics.select((0, 1), (1, 0)), law.inputs, law.outputs[::-1])
    first, *others = (judge(plant, each) for each in (law, turned, half))
    for other in others:
        if isinstance(first, Plant):
            assert other == first
        elif isinstance(first, list):
            assert [name for name, _ in other] == [name for name, _ in first] == ["u0", "u1"]
            np.testing.assert_allclose([v for _, v in other], [v for _, v in first], rtol=1e-9)
        else:
            np.testing.assert_allclose(other, first, rtol=1e-9)


BY_GROUP = {
    "verify": lambda plant, law: outcomes_on([plant], law, WEIGHTS),
    "reduce": lambda plant, law: reduce_compensator(law, plant, 1),
}


@pytest.mark.parametrize("judge", [*JUDGES.values(), *BY_GROUP.values()], ids=[*JUDGES, *BY_GROUP])
def test_another_unit_is_refused(plant, law, judge):
    degrees = dataclasses.replace(law, inputs=(OUTPUTS[0], Port("y1", "deg")))
    with pytest.raises(ConfigError, match=r"reads y1 in deg, the (plant|rig) has it in rad"):
        judge(plant, degrees)
    kilo = dataclasses.replace(law, outputs=(Port("u0", "kN m"), INPUTS[1]))
    with pytest.raises(ConfigError, match=r"drives u0 in kN m, the (plant|rig) has it in N m"):
        judge(plant, kilo)
    judge(plant, dataclasses.replace(law, inputs=(OUTPUTS[0], Port("y1", ""))))  # not known: any
