"""Rigid modes behind delays that are no sums: the response, the integrators kept, and a loop's stability."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes
from middeck.control.lqg.design import design_lqg
from middeck.control.noise import measure_noise_rms
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.delay.pade import pade
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.state_space.modal_system import ModalSystem, select_modes
from middeck.systems.state_space.statespace import gain_system
from plant_builders import grouped_plant, sum_of_modes, unit_weights

pytestmark = pytest.mark.kernels

WAY, RATE = Port("way", "m"), Port("rate", "m/s")


@pytest.mark.parametrize(
    "delay_s", [[[0.1, 0.4], [0.3, 0.2], [0.3, 0.1]], [[0.1, 0.4, 0.1], [0.3, 0.2, 0.3]]]
)
def test_rigid_modes_behind_delays_that_are_no_sums_are_kept_once(delay_s: list[list[float]]) -> None:
    """The response is that of each path with its own approximation, on as few integrators as there are."""
    rng, delay = np.random.default_rng(3), np.array(delay_s)
    outputs, inputs = delay.shape
    omega = np.array([0.0, 0.0, 5.0, 0.0])
    # The last one is out of reach and sight.
    psi, shapes = rng.standard_normal((4, inputs)), rng.standard_normal((3, outputs, 4))
    psi[3], shapes[:, :, 3] = 0.0, 0.0
    modal = ModalSystem(
        omega=omega,
        zeta=np.where(omega > 0.0, 0.01, 0.0),
        psi=psi,
        phi=shapes[0],
        phi_rate=shapes[1],
        names=("x", "turn", "bend", "away"),
        phi_acceleration=shapes[2],
        direct=rng.standard_normal(delay.shape),
    )
    ports = [tuple(Port(f"{side}{i}", "1") for i in range(n)) for side, n in (("u", inputs), ("y", outputs))]
    plant = Plant(dynamics=modal, inputs=ports[0], outputs=ports[1])
    near = approximate_delays(delay_plant(plant, delay), 4)
    f = np.array([1e-3, 0.1, 2.0])
    # What a channel of the smaller side has in common is put there.
    common = np.broadcast_to(delay.min(axis=int(inputs > outputs), keepdims=True), delay.shape)
    wanted = evaluate_plant(plant, f).H.copy()
    for o, i in np.ndindex(delay.shape):
        for tau in (common[o, i], delay[o, i] - common[o, i]):
            wanted[:, o, i] *= statespace_response(pade(float(tau), 4), 2.0 * np.pi * f)[:, 0, 0]
    # The double pole makes 1e-3 Hz large beside the rest: rounding of a few products.
    assert pytest.approx(wanted, rel=1e-11) == evaluate_plant(near, f).H
    assert "away" in partition_modes(near).inert
    values = np.linalg.eigvals(partition_modes(near).active.system.A)
    # Two double poles: the smaller side sees or drives both, which leaves no other integrator.
    assert np.sum(np.abs(values) < 1e-6) == 4
    one = dataclasses.replace(plant, dynamics=select_modes(modal, np.array([0])))
    alone = approximate_delays(delay_plant(one, delay), 4)
    # One body: integrated twice together, and once more where one output sees a force earlier than another.
    assert np.sum(np.abs(np.linalg.eigvals(alone.system.A)) < 1e-6) == 3


def test_a_rigid_body_whose_paths_are_delayed_each_by_its_own_time() -> None:
    """Two forces, position and rate: 1 + g h / s^2 + g^2 det k (e^-s(t11 + t22) - e^-s(t12 + t21)) / s^3."""
    tau, k = np.array([[0.05, 0.3], [0.4, 0.1]]), np.array([[1.0, 0.9], [0.5, 0.6]])
    forces = (Port("a", "N"), Port("b", "N"))
    body = sum_of_modes([0.0], 0.0, [[1.0, 1.0]], [[1.0], [0.0]], phi_rate=[[0.0], [1.0]], names=("body",))
    delayed = delay_plant(Plant(dynamics=body, inputs=forces, outputs=(WAY, RATE)), tau)

    def terms(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        e = np.exp(-s * tau[:, :, None])
        first = (k[0, 0] * e[0, 0] + k[1, 0] * e[0, 1] + s * (k[0, 1] * e[1, 0] + k[1, 1] * e[1, 1])) / s**2
        return first, np.linalg.det(k) * (e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0]) / s**3

    # Where on the axis both gains that solve the quadratic become real and positive, the least first.
    omega = np.linspace(1e-2, 60.0, 600_001)
    h, d = terms(1j * omega)
    root = np.sqrt(h**2 - 4.0 * d)
    limits = []
    for g in ((-h + root) / (2.0 * d), (-h - root) / (2.0 * d)):
        turns = (np.diff(np.sign(g.imag)) != 0) & (np.abs(np.diff(g)) < 0.1)
        limits += list(g.real[np.flatnonzero(turns & (g.real[1:] > 0.0))])
    limit = min(limits)
    for factor in (0.1, 0.5, 0.99, 0.999, 1.001, 1.01, 1.5, 2.0):
        gain = factor * limit
        found = decide_stability(delayed, Compensator(gain_system(-gain * k), (WAY, RATE), forces))
        # The grid of 1e-4 rad/s leaves 1e-4 of the limit.
        assert found.stable is (factor < 1.0)
        first, second = terms(np.array([found.pole]))
        assert np.abs(1.0 + gain * first + gain**2 * second) < 1e-9


def test_designs_hold_a_rigid_body_whose_paths_are_delayed_each_by_its_own_time() -> None:
    """The cost that a design promises is what its loop costs with exact delays."""
    forces = (Port("a", "N"), Port("b", "N"))
    body = sum_of_modes([0.0], 0.0, [[1.0, 1.0]], [[1.0], [0.0]], phi_rate=[[0.0], [1.0]], names=("body",))
    plant = grouped_plant(body, forces, (WAY, RATE), z=("way",))
    delayed = delay_plant(plant, np.array([[0.05, 0.3], [0.4, 0.1]]))
    weights = unit_weights(("a", "b"), [1e-2, 1e-2], inputs=2)
    for order, error in ((3, 1e-4), (10, 1e-6)):
        law = design_lqg(approximate_delays(delayed, order), weights, 1.0)
        found = measure_noise_rms(delayed, law, weights)
        # White noise reaches frequencies at which an approximation is wrong; there the loop is weak.
        assert found.rms**2 + found.control_rms**2 == pytest.approx(law.cost, rel=error)
    sampled = design_sampled_lqg(delayed, weights, 1.0, 0.02, "current")
    outcome = measure_sampled_loop(delayed, sampled, weights, 1.0)
    assert outcome.cost == pytest.approx(sampled.cost, rel=1e-10)
    # Exact, each path with the states it needs.
    assert decide_stability(delayed, sampled).growing == 0
    # A hold of 0.02 s is 0.01 s more of delay.
    assert law.cost < sampled.cost < 1.01 * law.cost
