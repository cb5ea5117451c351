"""LQG: closed forms, separation, cost, and the modes that nothing reaches."""

import dataclasses
import warnings

import mace_like
import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator, evaluate_compensator
from middeck.control.law.partition import partition_modes
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.loop.closed_loop import (
    close_loop,
    leave_open,
    predict_closed_loop_response,
)
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import ConfigError, NotStabilisableError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace, gain_system
from plant_builders import grouped_plant, sum_of_modes, unit_weights

INTENSITY = 2e-6


def scalar_plant(a):
    ports = (Port("w", "N"), Port("u", "N")), (Port("x", "m"),)
    return grouped_plant(
        StateSpace([[a]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]]), ports[0], ports[1], w=("w",), u=("u",)
    )


def scalar_weights(process, sensor):
    return unit_weights(("w",), sensor, process=process)


@pytest.fixture(scope="module")
def orbit():
    return close_inner_loop(mace_like.build("orbit"), mace_like.pd_loops())


def test_scalar_closed_form():
    # x' = a x + u + w, y = x + v: gain a + sqrt(a^2 + 1/rho), filter a + sqrt(a^2 + W/V).
    a, rho, process, sensor = 0.7, 0.01, 3.0, 1e-4
    law = design_lqg(scalar_plant(a), scalar_weights(process, sensor), 1.0 / rho)
    k, g = a + np.sqrt(a**2 + 1.0 / rho), a + np.sqrt(a**2 + process / sensor)
    # Three states in all, well conditioned: a few roundings.
    np.testing.assert_allclose(law.system.C, [[-k]], rtol=1e-12)
    np.testing.assert_allclose(law.system.B, [[g]], rtol=1e-12)
    np.testing.assert_allclose(law.system.A, [[a - k - g]], rtol=1e-12)
    P, Sigma = k * rho, g * sensor
    assert law.cost == pytest.approx(P * process + Sigma * k**2 * rho, rel=1e-12)


def test_separation(orbit):
    law = design_lqg(orbit, mace_like.weights(INTENSITY), 10.0)
    together = np.concatenate([law.regulator.poles, law.estimator.poles])
    loop = close_loop(orbit, law)
    apart = np.abs(loop.poles[:, None] - together[None]).min(axis=1)
    # 92 poles of a matrix whose eigenvectors are far from orthogonal: 1e-8 of the pole, not rounding.
    assert np.all(apart <= 1e-8 * np.abs(loop.poles))
    assert loop.stable


def test_cost_is_that_of_the_closed_loop(orbit):
    # The trace formula against the covariance of the loop driven by all noises (Lyapunov).
    weights, authority = mace_like.weights(INTENSITY, process_ratio=1e-2), 10.0
    law = design_lqg(orbit, weights, authority)
    plant = dataclasses.replace(orbit, w=weights.disturbed)
    loop = close_loop(plant, law).system
    n = len(orbit.system.A)
    noise = sla.block_diag(np.zeros((n, n)), law.system.B @ np.diag(weights.sensor) @ law.system.B.T)
    X = sla.solve_continuous_lyapunov(loop.A, -(loop.B @ weights.process @ loop.B.T + noise))
    z = weights.output[:, None] * loop.C
    u = np.hstack([np.zeros((5, n)), law.system.C])
    cost = np.trace(z @ X @ z.T) + np.trace(u @ X @ u.T) / authority
    # Poles from 0.01 to 300 rad/s: Lyapunov keeps about ten digits.
    assert law.cost == pytest.approx(cost, rel=1e-8)


def test_no_neighbouring_gain_is_cheaper():
    # The optimum is a minimum: detune the scalar law and the closed-loop cost rises.
    plant, weights, authority = scalar_plant(0.3), scalar_weights(1.0, 0.1), 4.0
    law = design_lqg(plant, weights, authority)

    def cost(gain, injection):
        k, g = gain, injection
        A = np.array([[0.3, -k], [g, 0.3 - k - g]])
        X = sla.solve_continuous_lyapunov(A, -np.diag([1.0, 0.1 * g**2]))
        return X[0, 0] + k**2 * X[1, 1] / authority

    k, g = -law.system.C[0, 0], law.system.B[0, 0]
    assert cost(k, g) == pytest.approx(law.cost, rel=1e-12)
    for factor in (0.99, 1.01):
        assert cost(factor * k, g) > law.cost
        assert cost(k, factor * g) > law.cost


def test_a_law_whose_gains_are_rounding_says_so():
    # An accurate cost leaves the directions that it hardly sees to rounding. By 700-bit arithmetic the law of
    # u1 at 1 and 3 rad/s is as below: 1e-4 to 2e-3 off, the more or less with the last digits of a product.
    A = sla.block_diag([[0.0, 1.0], [-0.7834, -0.0064]], [[0.0, 1.0], [-6.1594, -0.0325]])
    B, C = [[0.0, 0.0], [-0.75, -1.65], [0.0, 0.0], [1.09, -1.61]], [[-1.96, 0.0, -1.91, 0.0]]
    u = ("u1", "u2")
    delayed = make_plant(A, B, C, w=u, u=u, z=("y1",), y=("y1",), delay_s=np.array([[0.0045, 0.0586]]))
    plant = approximate_delays(delayed, 3)

    def law(price, noise):
        weights = LQGWeights(
            output=[1.1e4],
            input=[price, price],
            disturbed=u,
            process=np.diag([0.0246, 1.4e-9]),
            sensor=[noise],
        )
        return design_lqg(plant, weights, 0.015)

    with pytest.warns(UserWarning, match="by fewer decades, would decide"):
        found = law(1.4e-7, 6.4e8)
    want = np.array(
        [4.999847779570885e-06 - 1.702340935536668e-06j, 5.32856188960958e-06 + 1.454419465087807e-06j]
    )
    there = statespace_response(found.system, np.array([1.0, 3.0]))[:, 0, 0]
    assert np.abs(there - want).max() < 1e-2 * np.abs(want).max()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        law(1.4, 6.4)


def test_a_law_whose_regulator_leaves_poles_all_but_at_rest_says_so():
    # A light cost of a free body leaves poles at 4e-6 rad/s beside those of the delays at 600, and a residual
    # of the Riccati equation. By 700-bit arithmetic the cost is 9518.214: found 0.7 to 3 % off, by kernel.
    A = sla.block_diag(
        [[0.0, 1.0], [-4.38, -0.0703]], [[0.0, 1.0], [-30.0, -0.522]], [[0.0, 1.0], [0.0, 0.0]]
    )
    B = [[0.0], [1.59], [0.0], [1.67], [0.0], [-0.527]]
    C = [[0.607, 0.0, -0.629, 0.0, -1.57, 0.0], [-0.375, 0.0, -0.396, 0.0, 1.15, 0.0]]
    y, delay_s = ("y1", "y2"), np.array([[0.0158], [0.0232]])
    delayed = make_plant(A, B, C, w=("u1",), u=("u1",), z=y, y=y, delay_s=delay_s)
    plant = approximate_delays(delayed, 3)

    def law(price):
        return design_lqg(
            plant,
            LQGWeights(
                output=[4.42e-6, 1.38e-5],
                input=[price],
                disturbed=("u1",),
                process=[[0.00646]],
                sensor=[1.94e8, 5.99e-5],
            ),
            1.1,
        )

    with pytest.warns(UserWarning, match="by fewer decades, would decide"):
        found = law(2.66e11)
    assert found.cost == pytest.approx(9518.214003400239, rel=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        law(2.66)


def test_direct_terms_are_part_of_the_design():
    # z = x + 0.5 u and y = x + 0.2 u: the same law as for y without u, fed with y - 0.2 u.
    ports = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))
    C = [[1.0], [1.0]]
    plain = Plant(
        dynamics=StateSpace([[0.4]], [[1.0, 1.0]], C, [[0.0, 0.5], [0.0, 0.0]]),
        inputs=ports[0],
        outputs=ports[1],
        w=("w",),
        u=("u",),
        z=("z",),
        y=("y",),
    )
    direct = dataclasses.replace(
        plain, dynamics=StateSpace([[0.4]], [[1.0, 1.0]], C, [[0.0, 0.5], [0.0, 0.2]])
    )
    weights = scalar_weights(1.0, 0.01)
    laws = [design_lqg(p, weights, 5.0) for p in (plain, direct)]
    assert laws[0].cost == pytest.approx(laws[1].cost, rel=1e-13)
    loops = [close_loop(p, law) for p, law in zip((plain, direct), laws, strict=True)]
    np.testing.assert_allclose(np.sort(loops[0].poles), np.sort(loops[1].poles), rtol=1e-12)
    # The gain of a cost with cross term: minimise over k the cost of z = x + 0.5 u by hand.
    rho = 0.2
    k = -laws[0].system.C[0, 0]
    costs = [((1 - 0.5 * g) ** 2 + rho * g**2) / (2.0 * (g - 0.4)) for g in (0.999 * k, k, 1.001 * k)]
    assert costs[1] < min(costs[0], costs[2])


def test_noise_straight_into_z_is_refused():
    ports = (Port("w", "N"), Port("u", "N")), (Port("x", "m"),)
    plant = grouped_plant(
        StateSpace([[0.4]], [[1.0, 1.0]], [[1.0]], [[1.0, 0.0]]), ports[0], ports[1], w=("w",), u=("u",)
    )
    with pytest.raises(ConfigError, match="infinite"):
        design_lqg(plant, scalar_weights(1.0, 1.0), 1.0)


def test_weights_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="sensor noise"):
        scalar_weights(1.0, 0.0)
    with pytest.raises(ConfigError, match="semidefinite"):
        scalar_weights(-1.0, 1.0)
    weights = unit_weights(("w",), 1.0, outputs=2)
    with pytest.raises(ConfigError, match="2 output weights for 1"):
        design_lqg(scalar_plant(1.0), weights, 1.0)
    for authority in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ConfigError, match="authority"):
            design_lqg(scalar_plant(1.0), scalar_weights(1.0, 1.0), authority)
    for bad in ({"input": np.zeros(1)}, {"output": np.array([np.nan])}, {"sensor": np.array([np.inf])},
                {"process": np.array([[np.nan]])}, {"disturbed": ("w", "u")}):  # fmt: skip
        with pytest.raises(ConfigError):
            dataclasses.replace(scalar_weights(1.0, 1.0), **bad)


def test_no_process_noise_at_all_is_named_where_a_mode_needs_it():
    # A decaying plant needs no noise: the filter does nothing. One on the axis has no stationary filter.
    quiet = scalar_weights(0.0, 1.0)
    assert design_filter(scalar_plant(-1.0), quiet).gain[0, 0] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(NotStabilisableError, match="process noise"):
        design_filter(scalar_plant(0.0), quiet)


def test_a_filter_for_other_noise_is_refused():
    other = design_filter(scalar_plant(-1.0), scalar_weights(2.0, 1.0))
    with pytest.raises(ConfigError, match="other noise intensities"):
        design_lqg(scalar_plant(-1.0), scalar_weights(1.0, 1.0), 1.0, kalman=other)


def test_translations_are_set_aside_by_name():
    part = partition_modes(mace_like.build("orbit"))
    assert part.inert == ("translation x", "translation y", "translation z")
    assert len(part.active.system.A) == 46
    assert partition_modes(mace_like.build("lab")).inert == ()


def test_design_on_the_bare_orbit_plant_leaves_the_translations_out():
    plant = mace_like.build("orbit")
    secondary = dataclasses.replace(plant, u=mace_like.LOOPS, y=tuple(p.name for p in plant.outputs))
    weights = dataclasses.replace(
        mace_like.weights(INTENSITY), input=np.ones(7), sensor=np.repeat([2e-5**2, 2e-4**2], 9)
    )
    # The metric does not see the secondary payload's free motion: as a cost it must.
    everything = dataclasses.replace(secondary, z=secondary.y[:9])
    law = design_lqg(everything, dataclasses.replace(weights, output=np.ones(9)), 10.0)
    assert law.inert == ("translation x", "translation y", "translation z")
    loop = close_loop(everything, law)
    assert loop.stable
    assert loop.inert == law.inert
    with pytest.raises(NotStabilisableError, match="the cost"):
        design_lqg(secondary, weights, 10.0)


def test_translations_are_set_aside_of_a_delayed_plant_too():
    plant = mace_like.build("orbit")
    everything = dataclasses.replace(
        plant,
        u=mace_like.LOOPS,
        y=tuple(p.name for p in plant.outputs),
        z=tuple(p.name for p in plant.outputs[:9]),
    )
    delayed = approximate_delays(delay_plant(everything, 0.01), 2)
    part = partition_modes(delayed)
    assert part.inert == ("translation x", "translation y", "translation z")
    assert len(part.active.system.A) == 46 + 2 * len(plant.inputs)
    omega = np.geomspace(0.1, 400.0, 50)
    np.testing.assert_allclose(
        statespace_response(part.active.system, omega), statespace_response(delayed.system, omega), rtol=1e-9
    )
    weights = dataclasses.replace(
        mace_like.weights(INTENSITY),
        output=np.ones(9),
        input=np.ones(7),
        sensor=np.repeat([2e-5**2, 2e-4**2], 9),
    )
    law = design_lqg(delayed, weights, 10.0)
    assert law.inert == part.inert
    assert close_loop(delayed, law).stable
    assert decide_stability(delay_plant(everything, 0.01), law).stable


def test_a_growing_part_that_meets_no_port_stays():
    apart = StateSpace(np.diag([-1.0, -2.0, 0.5]), [[1.0], [0.0], [0.0]], [[1.0, 0.0, 0.0]], [[0.0]])
    ports = (Port("u", "N"),), (Port("y", "m"),)
    part = partition_modes(
        Plant(dynamics=apart, inputs=ports[0], outputs=ports[1], state_names=("lag", "idle", "grows"))
    )
    assert part.inert == ("idle",)
    assert part.active.state_names == ("lag", "grows")


def test_translations_with_rounding_in_their_couplings_are_still_inert():
    plant = mace_like.build("orbit")
    modal = plant.dynamics
    rng = np.random.default_rng(0)
    psi = modal.psi + 1e-12 * rng.standard_normal(modal.psi.shape)
    phi = modal.phi + 1e-12 * rng.standard_normal(modal.phi.shape)
    noisy = dataclasses.replace(plant, dynamics=dataclasses.replace(modal, psi=psi, phi=phi))
    assert len(partition_modes(noisy).inert) == 3


def test_an_unreachable_but_observed_free_mode_is_named():
    plant = mace_like.build("orbit")
    modal = plant.dynamics
    phi = modal.phi.copy()
    phi[3, 1] = 0.5
    seen = dataclasses.replace(plant, dynamics=dataclasses.replace(modal, phi=phi))
    assert "translation y" not in partition_modes(seen).inert
    inner = close_inner_loop(seen, mace_like.pd_loops())
    with pytest.raises(NotStabilisableError, match="translation y") as caught:
        design_lqg(inner, mace_like.weights(INTENSITY), 1.0)
    assert caught.value.data["modes"] == ("translation y",)


def test_a_reachable_but_unmeasured_free_mode_is_named():
    modal = sum_of_modes(np.zeros(2), 0.0, np.eye(2), np.eye(2), names=("surge", "yaw"))
    ports = (Port("a", "N"), Port("b", "N")), (Port("a", "m"), Port("b", "m"))
    plant = grouped_plant(modal, ports[0], ports[1], w=("a",), y=("a",))
    weights = unit_weights(("a",), 1.0, outputs=2, inputs=2)
    with pytest.raises(NotStabilisableError, match=r"no measurement in y sees it.*yaw"):
        design_filter(plant, weights)


def test_pd_on_one_free_mode():
    # Inertia J under torque -(kp angle + kd rate): s^2 + kd/J s + kp/J.
    J, kp, kd = 4.0, 0.3, 1.1
    modal = ModalSystem(
        omega=[0.0],
        zeta=[0.0],
        psi=[[1 / np.sqrt(J)]],
        phi=[[1 / np.sqrt(J)], [0.0]],
        phi_rate=[[0.0], [1 / np.sqrt(J)]],
        names=("spin",),
    )
    plant = Plant(
        dynamics=modal, inputs=(Port("bus", "N m"),), outputs=(Port("bus", "rad"), Port("bus_rate", "rad/s"))
    )
    closed = close_inner_loop(plant, PDLoops(("bus",), np.array([kp]), np.array([kd])))
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(closed.system.A)),
        np.sort_complex(np.roots([1.0, kd / J, kp / J])),
        rtol=1e-14,
    )
    # Static response 1/kp, and the rate is the derivative of the angle.
    H = evaluate_plant(closed, np.array([0.0, 0.2])).H
    assert H[0, 0, 0] == pytest.approx(1.0 / kp, rel=1e-14)
    assert H[1, 1, 0] == pytest.approx(2j * np.pi * 0.2 * H[1, 0, 0], rel=1e-13)
    assert closed.state_names == ("spin", "spin")
    assert [p.name for p in closed.outputs] == ["bus", "bus_rate"]


def test_pd_is_the_feedback_of_the_same_gains(orbit):
    # Closing PD as a static compensator over the ports gives the same poles.
    bare = mace_like.build("orbit")
    pd = mace_like.pd_loops()
    names = (*pd.names, *(f"{n}_rate" for n in pd.names))
    law = Compensator(
        gain_system(-np.hstack([np.diag(pd.kp), np.diag(pd.kd)])),
        tuple(bare.outputs[i] for i in bare.output_indices(names)),
        tuple(bare.inputs[i] for i in bare.input_indices(pd.names)),
    )
    loop = close_loop(bare, law)
    # The same sums in another order.
    np.testing.assert_allclose(loop.system.A, orbit.system.A, atol=1e-12 * np.abs(orbit.system.A).max())
    assert loop.stable
    assert not leave_open(bare).poles.real.max() < 0.0


def test_closed_loop_of_scalars_with_direct_terms():
    # T = G / (1 - G K), G = (s + 3)/(s + 1), K = -(2 s + 1)/(s + 5).
    G = StateSpace([[-1.0]], [[1.0]], [[2.0]], [[1.0]])
    K = StateSpace([[-5.0]], [[1.0]], [[9.0]], [[-2.0]])
    port = (Port("f", "N"),), (Port("x", "m"),)
    plant = Plant(dynamics=G, inputs=port[0], outputs=port[1], w=("f",), u=("f",), z=("x",), y=("x",))
    law = Compensator(K, (Port("x", "m"),), (Port("f", "N"),))
    loop = close_loop(plant, law)
    omega = np.array([0.0, 0.3, 2.0, 50.0])
    s = 1j * omega
    g, k = (s + 3) / (s + 1), -(2 * s + 1) / (s + 5)
    expected = g / (1.0 - g * k)
    np.testing.assert_allclose(statespace_response(loop.system, omega)[:, 0, 0], expected, rtol=1e-13)
    hz = omega / (2.0 * np.pi)
    predicted = predict_closed_loop_response(evaluate_plant(plant, hz), evaluate_compensator(law, hz))
    np.testing.assert_allclose(predicted.H[:, 0, 0], expected, rtol=1e-13)


def test_prediction_line_by_line_equals_the_closed_loop(orbit):
    law = design_lqg(orbit, mace_like.weights(INTENSITY), 10.0)
    hz = np.geomspace(0.05, 50.0, 60)
    predicted = predict_closed_loop_response(evaluate_plant(orbit, hz), evaluate_compensator(law, hz))
    rows, columns = orbit.output_indices(orbit.z), orbit.input_indices(orbit.w)
    direct = statespace_response(close_loop(orbit, law).system, 2.0 * np.pi * hz)
    error = np.linalg.norm(predicted.H[:, rows][:, :, columns] - direct, axis=(1, 2))
    # Two solutions of different size of the same 92-state problem.
    assert np.all(error <= 1e-9 * np.linalg.norm(direct, axis=(1, 2)))


def test_a_loop_without_solution_is_refused():
    port = (Port("f", "N"),), (Port("x", "m"),)
    plant = grouped_plant(gain_system([[2.0]]), port[0], port[1])
    with pytest.raises(ConfigError, match="no solution"):
        close_loop(plant, Compensator(gain_system([[0.5]]), (Port("x", "m"),), (Port("f", "N"),)))


def test_a_compensator_of_unknown_ports_is_refused():
    law = Compensator(gain_system([[0.5]]), (Port("nothing", "m"),), (Port("u", "N"),))
    with pytest.raises(ConfigError, match="nothing"):
        close_loop(scalar_plant(-1.0), law)
