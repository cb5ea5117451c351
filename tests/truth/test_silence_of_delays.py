"""What a delay, an order of ports or a period must not change in silence."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.control.analysis.rms.measure_rms import measure_rms
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator, evaluate_compensator
from middeck.control.loop.closed_loop import predict_closed_loop_response
from middeck.control.loop.performance import Performance
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.noise import measure_noise_rms
from middeck.control.qualification import qualify_compensator
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.control.sampled.emulation import emulate
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError, NotStabilisableError
from middeck.identification.uncertainty.accuracy import expected_accuracy
from middeck.signals.record import Record
from middeck.systems.delay.delay_approximation import approximate_delays, evaluate_approximation
from middeck.systems.plants.plant import Plant, delay_plant, group_ports, name_states
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes

A = np.zeros((5, 5))
A[:2, :2], A[2:4, 2:4] = [[0.0, 1.0], [-4.0, -0.2]], [[0.0, 1.0], [-30.0, -0.4]]
B = np.array([[0.0, 0.0], [1.0, 0.3], [0.0, 0.0], [0.5, -1.0]])
C = np.array([[1.0, 0.0, 0.2, 0.0], [0.4, 0.0, 1.0, 0.0]])
PORTS = {"inputs": ["f1", "f2"], "outputs": ["y1", "y2"]}
GROUPS = {"w": ["f1", "f2"], "u": ["f1", "f2"], "z": ["y1", "y2"], "y": ["y1", "y2"]}
UNLIKE = np.array([[0.01, 0.03], [0.07, 0.02]])
WEIGHTS = LQGWeights(
    output=[1.0, 2.0],
    input=[0.1, 5.0],
    disturbed=("f1", "f2"),
    process=np.diag([1.0, 0.5]),
    sensor=[0.01, 3.0],
)
PLANT = make_plant(A[:4, :4], B, C, **PORTS, **GROUPS)
LAW = Compensator(
    StateSpace(np.diag([-3.0, -5.0]), [[1.0, 0.2], [0.0, 1.0]], [[-1.0, 0.3], [0.2, -0.8]], np.zeros((2, 2))),
    PLANT.outputs, PLANT.inputs,
)  # fmt: skip


def with_integrator(into: float, seen: float, drives: float, delay_s: np.ndarray) -> Plant:
    dynamics = A.copy()
    dynamics[3, 4] = drives
    return make_plant(
        dynamics, np.vstack([B, [[into, into]]]), np.hstack([C, [[seen], [0.0]]]), **PORTS, **GROUPS,
        state_names=["m1", "m1", "m2", "m2", "odd"], delay_s=delay_s,
    )  # fmt: skip


@pytest.mark.parametrize("delay_s", [np.full((2, 2), 0.02), UNLIKE], ids=["alike", "unlike"])
@pytest.mark.parametrize(("into", "seen", "drives"), [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_an_integrator_that_nothing_holds_is_refused_behind_delays(into, seen, drives, delay_s):
    plant = with_integrator(into, seen, drives, delay_s)
    near = approximate_delays(plant, 3)
    assert name_states(near).count("odd") >= 1
    for design in (
        lambda: design_lqg(near, WEIGHTS, 1.0),
        lambda: design_sampled_lqg(plant, WEIGHTS, 1.0, 0.01),
    ):
        with pytest.raises(NotStabilisableError, match="odd"):
            design()
    assert measure_noise_rms(plant, LAW, WEIGHTS).rms == np.inf
    assert measure_noise_rms(plant, emulate(LAW, 0.01), WEIGHTS).rms == np.inf
    assert not any(o.stable[0] for o in outcomes_on([plant], LAW, WEIGHTS, rates_hz=[100.0]))
    hz = np.array([0.05, 0.3, 1.0])
    H = [evaluate_plant(p, hz).H for p in (approximate_delays(plant, 8), plant)]
    np.testing.assert_allclose(*H, rtol=1e-10, atol=1e-12)


def test_an_inert_integrator_stays_apart_by_name():
    near = approximate_delays(with_integrator(0.0, 0.0, 0.0, UNLIKE), 3)
    assert design_lqg(near, WEIGHTS, 1.0).inert == ("odd",)


def test_rigid_modes_that_two_forces_cannot_hold_are_refused_behind_unlike_delays():
    rng = np.random.default_rng(0)
    modal = ModalSystem(
        omega=[0.0, 0.0, 0.0, 5.0],
        zeta=[0.0, 0.0, 0.0, 0.02],
        psi=rng.normal(size=(4, 2)),
        phi=rng.normal(size=(2, 4)),
        phi_rate=np.zeros((2, 4)),
        names=("x", "y", "turn", "bend"),
    )
    plant = delay_plant(dataclasses.replace(PLANT, dynamics=modal, state_names=()), UNLIKE)
    with pytest.raises(NotStabilisableError):
        design_lqg(approximate_delays(plant, 3), WEIGHTS, 1.0)


@pytest.mark.parametrize("delay_s", [0.0, 0.05])
def test_weights_go_by_the_plants_groups_whatever_the_order_of_the_law(delay_s: float) -> None:
    s, turn = LAW.system, [1, 0]
    dynamics = StateSpace(s.A, s.B[:, turn], s.C[turn], s.D)
    other = Compensator(dynamics, tuple(LAW.inputs[i] for i in turn), tuple(LAW.outputs[i] for i in turn))
    plant = delay_plant(PLANT, delay_s)
    for one, same in ((LAW, other), (emulate(LAW, 0.01), emulate(other, 0.01))):
        found, again = (measure_noise_rms(plant, law, WEIGHTS) for law in (one, same))
        assert again.rms == pytest.approx(found.rms, rel=1e-9)
        assert again.control_rms == pytest.approx(found.control_rms, rel=1e-9)
        rows = [qualify_compensator(law, {"p": plant}, WEIGHTS)[0] for law in (one, same)]
        assert rows[1].db == pytest.approx(rows[0].db, rel=1e-9)
    with pytest.raises(ConfigError, match="groups y and u are y2"):
        measure_noise_rms(group_ports(plant, w=["f1"], u=["f1"], z=["y1"], y=["y2"]), LAW, WEIGHTS)


def test_a_common_delay_of_a_plant_is_one_delay_of_each_output() -> None:
    rng = np.random.default_rng(3)
    u = rng.standard_normal((2, 1, 500, 2))
    taken = Record(
        sample_hz=50.0,
        u=u,
        y=np.zeros((2, 1, 500, 2)),
        inputs=PLANT.inputs,
        outputs=PLANT.outputs,
        periodic=True,
        held=True,
    )
    own = expected_accuracy(delay_plant(PLANT, 0.02), taken, 1e-3)
    predicted = expected_accuracy(PLANT, taken, 1e-3, delay_s=0.02)
    np.testing.assert_allclose(own.error, predicted.error, rtol=1e-9)
    np.testing.assert_allclose(own.uncertainty.delay_s, predicted.uncertainty.delay_s, rtol=1e-9)


def test_a_sampled_law_is_not_joined_to_a_continuous_response() -> None:
    hz = np.array([0.2, 1.0])
    law = evaluate_compensator(emulate(LAW, 0.05), hz)
    with pytest.raises(ConfigError, match=r"hold of 0 s, the compensator's period is 0\.05 s"):
        predict_closed_loop_response(evaluate_plant(PLANT, hz), law)
    assert predict_closed_loop_response(evaluate_plant(sample_plant(PLANT, 0.05), hz), law).hold_s is None


def test_the_rms_refuses_alike_with_delays_and_without() -> None:
    wrong = Performance(np.ones(2), np.eye(3), (0.0, 5.0))
    fast = dataclasses.replace(emulate(LAW, 0.05))
    band = Performance(np.ones(2), np.eye(2), (0.0, 5.0))
    for plant in (PLANT, delay_plant(PLANT, UNLIKE), delay_plant(PLANT, 3.0)):
        with pytest.raises(ConfigError, match="3 intensities for 2 ports"):
            measure_rms(plant, LAW, wrong)
        with pytest.raises(ConfigError, match="a compensator sampled at 20 Hz"):
            measure_rms(plant, fast, band)


def test_an_inert_mode_that_grows_is_no_stable_loop() -> None:
    modal = sum_of_modes([2.0, 5.0], [0.05, -0.01], [[1.0, 0.3], [0.0, 0.0]], [[1.0, 0.0], [0.4, 0.0]])
    plant = dataclasses.replace(PLANT, dynamics=modal, state_names=())
    dense = dataclasses.replace(plant, dynamics=plant.system, state_names=name_states(plant))
    for each in (plant, dense, delay_plant(plant, 0.02), delay_plant(plant, UNLIKE)):
        assert not decide_stability(each, LAW).stable
        assert not decide_stability(each, emulate(LAW, 0.01)).stable


def test_a_direct_term_stays_where_no_state_meets_a_port() -> None:
    through = np.array([[1.0, -2.0], [0.5, 3.0]])
    plant = dataclasses.replace(
        PLANT,
        dynamics=StateSpace([[-1.0]], np.zeros((1, 2)), np.zeros((2, 1)), through),
        state_names=("alone",),
        delay_s=UNLIKE,
    )
    near = approximate_delays(plant, 4)
    s = 1j * np.array([0.1, 1.0])
    turn = evaluate_approximation(UNLIKE, 4, s)
    np.testing.assert_allclose(statespace_response(near.system, s.imag), through * turn, rtol=1e-12)
    assert near.state_names[-1] == "alone"
