"""Rates as models of a design: the plant in the w-plane, and the exchange of models for the worst of many."""

import numpy as np
import pytest

from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.nominal_law import lqg_law
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import ModeShift, Uncertainty, finished_plants
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.robust.designs.plant_as_sampled import plant_as_sampled
from middeck.control.robust.designs.worst_of_many import design_for_worst
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant, subsystem
from middeck.systems.plants.response import statespace_response
from middeck.systems.sampling.sampling import sample_dynamics, tustin
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes, unit_weights

WEIGHTS = unit_weights(("w",), 1e-3)
NAMES = ("low", "high")
PERIOD = 0.1  # twenty samples in a period of the faster mode


def oscillator(delay=0.0):
    phi = np.array([[1.0, 0.6], [1.0, 0.8]])
    modal = sum_of_modes(np.array([1.0, 3.0]), 0.01, phi.T, phi, names=NAMES)
    ports = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))
    plant = Plant(dynamics=modal, inputs=ports[0], outputs=ports[1], w=("w",), u=("u",), z=("z",), y=("y",))
    return delay_plant(plant, np.array([[0.0, 0.0], [delay, delay]])) if delay else plant


def a_law(plant):
    law = lqg_law(generalize(plant, WEIGHTS, 10.0))
    return Compensator(
        StateSpace(law.A, law.B, law.C, np.zeros((1, 1))), (Port("y", "m"),), (Port("u", "N"),)
    )


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.25])
def test_response_at_the_tangent_is_that_of_the_samples(delay):
    mapped = plant_as_sampled(oscillator(delay), PERIOD)
    held = sample_dynamics(subsystem(oscillator(), ["u"], ["z", "y"]), PERIOD, delay)
    omega = np.array([0.3, 1.01, 3.0, 20.0])
    found = statespace_response(mapped.system, 2.0 / PERIOD * np.tan(0.5 * omega * PERIOD))
    z = np.exp(1j * omega * PERIOD)
    expected = [held.C @ np.linalg.solve(at * np.eye(len(held.A)) - held.A, held.B) + held.D for at in z]
    column = mapped.input_indices(["u"])
    np.testing.assert_allclose(found[:, :, column], expected, rtol=1e-10)  # rounding beside a resonance


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.25])
def test_poles_of_the_loop_are_those_of_the_sampled_loop(delay):
    law = a_law(oscillator())
    mapped = close_loop(plant_as_sampled(oscillator(delay), PERIOD), law).poles
    held = sample_dynamics(subsystem(oscillator(), ["u"], ["y"]), PERIOD, delay)
    K = tustin(law.system, PERIOD)
    through = 1.0 / (1.0 - K.D[0, 0] * held.D[0, 0])
    loop = np.block(
        [
            [held.A + through * held.B @ K.D @ held.C, through * held.B @ K.C],
            [through * K.B @ held.C, K.A + through * K.B @ held.D @ K.C],
        ]
    )
    expected = np.linalg.eigvals(loop)
    found = (1.0 + 0.5 * PERIOD * mapped) / (1.0 - 0.5 * PERIOD * mapped)
    assert len(found) == len(expected)
    # Of the delay's states some are defective at z = 0, where rounding comes as its third root.
    assert np.abs(found[:, None] - expected[None]).min(axis=1).max() < 1e-5


def test_rms_is_nearly_that_of_the_samples():
    plant = oscillator(0.25)
    law = design_multimodel(
        plant, WEIGHTS, 1.0, uncertainty=[plant_as_sampled(plant, PERIOD)], tolerance=1e-5
    )
    sampled = outcomes_on([plant], law, WEIGHTS, rates_hz=(1.0 / PERIOD,))[1]
    mapped = outcomes_on([plant_as_sampled(plant, PERIOD)], law, WEIGHTS)[0]
    assert sampled.stable[0]
    # What is left out, (omega T / 2)^2, is 2 % of the variance at the faster mode.
    assert mapped.rms[0] == pytest.approx(sampled.rms[0], rel=0.02)
    assert mapped.control_rms[0] == pytest.approx(sampled.control_rms[0], rel=0.1)


def test_the_law_for_the_worst_of_many_is_that_for_all():
    box = Uncertainty(shifts=tuple(ModeShift((name,), 0.02) for name in NAMES))
    steps = np.linspace(-1.0, 1.0, 5)
    plants = finished_plants(oscillator(), box, np.array([[a, b] for a in steps for b in steps]))
    law, chosen = design_for_worst(oscillator(), WEIGHTS, 1.0, candidates=plants, tolerance=1e-5)
    assert len(law.costs) == len(chosen) + 1 < 20
    every = design_multimodel(oscillator(), WEIGHTS, 1.0, uncertainty=plants, over="maximum", tolerance=1e-5)
    # One per cent is what the exchange ends within; the maximum is a 64th root of a sum, 3 % for 26 models.
    assert law.cost == pytest.approx(every.cost, rel=0.04)
    costs = [outcomes_on([p], law, WEIGHTS)[0] for p in plants]
    worst = max(c.rms[0] ** 2 + c.control_rms[0] ** 2 for c in costs)
    assert worst <= 1.01 * law.cost * (1.0 + 1e-9)


def test_nothing_worse_than_the_nominal_plant_needs_one_model():
    law, chosen = design_for_worst(oscillator(), WEIGHTS, 10.0, candidates=[oscillator()])
    assert chosen == ()
    assert law.cost == pytest.approx(design_lqg(oscillator(), WEIGHTS, 10.0).cost, rel=1e-4)


def test_what_makes_no_sense_is_refused():
    plant = oscillator()
    with pytest.raises(ConfigError, match="is a disturbance and a control"):
        plant_as_sampled(
            Plant(
                dynamics=plant.dynamics,
                inputs=plant.inputs,
                outputs=plant.outputs,
                w=("u",),
                u=("u",),
                z=("z",),
                y=("y",),
            ),
            0.1,
        )
    half = sum_of_modes([np.pi], 0.0, [[1.0, 1.0]], [[1.0], [1.0]], names=("half",))
    with pytest.raises(ConfigError, match="half the sample rate of 1 Hz"):
        plant_as_sampled(
            Plant(
                dynamics=half,
                inputs=plant.inputs,
                outputs=plant.outputs,
                w=("w",),
                u=("u",),
                z=("z",),
                y=("y",),
            ),
            1.0,
        )
