"""LQG with correlated noise, filters at ports, spectra and integral action, against covariances by hand."""

import dataclasses

import mace_like
import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.law.compensator import evaluate_compensator
from middeck.control.law.pd_loops import close_inner_loop
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.errors import ConfigError, NotStabilisableError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace, gain_system
from plant_builders import grouped_plant, sum_of_modes, unit_weights

PORTS = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))


def lag(corner, gain=1.0):
    return StateSpace([[-corner]], [[corner]], [[gain]], [[0.0]])


def lead(zero, pole):
    """(s + zero) / (s + pole)."""
    return StateSpace([[-pole]], [[1.0]], [[zero - pole]], [[1.0]])


def oscillator(D=((0.0, 0.0), (0.0, 0.0))):
    """Two modes between (w, u) and (z, y), not collocated."""
    omega = np.array([1.0, 3.0])
    A = sla.block_diag(*[np.array([[0.0, w], [-w, -0.02 * w]]) for w in omega])
    B = np.array([[0.0, 0.0], [1.0, 0.7], [0.0, 0.0], [0.5, -1.0]])
    C = np.array([[1.0, 0.0, 0.4, 0.0], [0.8, 0.0, -1.0, 0.0]])
    return Plant(
        dynamics=StateSpace(A, B, C, D),
        inputs=PORTS[0],
        outputs=PORTS[1],
        w=("w",),
        u=("u",),
        z=("z",),
        y=("y",),
    )


def weights(process=2.0, sensor=1e-2, inputs=0.7):
    return LQGWeights(
        output=np.array([1.3]),
        input=np.array([inputs]),
        disturbed=("w",),
        process=np.array([[process]]),
        sensor=np.array([sensor]),
    )


def covariance_cost(A, B, C, D, law, W, V, N, Q, R):
    """E[x'Qx + u'Ru] of x' = Ax + B(w, u), y = Cx + D(w, u) + v under ``law``; w, v correlated by N."""
    Bw, Bu, Dw, Du = B[:, :1], B[:, 1:], D[:, :1], D[:, 1:]
    assert not np.any(law.D)
    F = np.block([[A, Bu @ law.C], [law.B @ C, law.A + law.B @ Du @ law.C]])
    G = np.block([[Bw, np.zeros((len(A), 1))], [law.B @ Dw, law.B]])
    X = sla.solve_continuous_lyapunov(F, -G @ np.block([[W, N], [N.T, V]]) @ G.T)
    return np.sum(X * sla.block_diag(Q, law.C.T @ R @ law.C)), X


@pytest.mark.parametrize("cross", [-0.1, 0.0, 0.1])
def test_correlated_noise_of_a_scalar(cross):
    # 2 a s + W - (s + N)^2 / V = 0: with h = s + N, h^2/V - 2 a h + 2 a N - W = 0.
    a, W, V = 0.7, 3.0, 0.1
    plant = grouped_plant(
        StateSpace([[a]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]]),
        PORTS[0],
        (Port("x", "m"),),
        w=("w",),
        u=("u",),
    )
    shaping = Shaping(cross=np.array([[cross]]))
    law = design_lqg(
        plant,
        unit_weights(("w",), V, process=W),
        4.0,
        shaping=shaping,
    )
    h = V * a + np.sqrt((V * a) ** 2 - V * (2.0 * a * cross - W))
    # Three states in all, well conditioned: a few roundings.
    assert law.system.B[0, 0] == pytest.approx(h / V, rel=1e-12)
    given = [np.array([[v]]) for v in (W, V, cross, 1.0, 0.25)]
    cost, _ = covariance_cost(
        np.array([[a]]), np.ones((1, 2)), np.eye(1), np.zeros((1, 2)), law.system, *given
    )
    assert law.cost == pytest.approx(cost, rel=1e-12)


def test_knowing_the_correlation_is_worth_something():
    plant, asked = oscillator(), weights()
    cross = np.array([[0.9 * np.sqrt(2.0 * 1e-2)]])
    knowing = design_lqg(plant, asked, 10.0, shaping=Shaping(cross=cross))
    blind = design_lqg(plant, asked, 10.0)
    s = plant.system
    Q = 1.3**2 * s.C[:1].T @ s.C[:1]
    given = s.A, s.B, s.C[1:], s.D[1:]
    noise = np.array([[2.0]]), np.array([[1e-2]]), cross, Q, np.array([[0.07]])
    costs = [covariance_cost(*given, law.system, *noise)[0] for law in (knowing, blind)]
    # Five Lyapunov states of condition 1e3.
    assert knowing.cost == pytest.approx(costs[0], rel=1e-10)
    assert costs[0] < 0.995 * costs[1]


def test_cost_with_every_direct_term_is_that_of_the_loop():
    # u into z, w and u into y, and correlated noise besides.
    plant = oscillator(((0.0, 0.3), (0.2, 0.1)))
    cross = np.array([[0.05]])
    law = design_lqg(plant, weights(), 10.0, shaping=Shaping(cross=cross))
    s = plant.system
    _, X = covariance_cost(s.A, s.B, s.C[1:], s.D[1:], law.system, np.array([[2.0]]), np.array([[1e-2]]),
                           cross, np.zeros((4, 4)), np.eye(1))  # fmt: skip
    z = 1.3 * np.hstack([s.C[:1], s.D[:1, 1:] @ law.system.C])
    u = np.hstack([np.zeros((1, 4)), law.system.C])
    assert law.cost == pytest.approx((z @ X @ z.T + 0.07 * u @ X @ u.T)[0, 0], rel=1e-10)


def by_hand(plant, colour, on_z, on_u):
    """The plant between its filters, states written out: colour, plant, weight on z, weight on u."""
    p, f, a, b = plant.system, colour, on_z, on_u
    n = [len(m.A) for m in (f, p, a, b)]
    A = np.zeros((sum(n), sum(n)))
    at = np.split(np.arange(sum(n)), np.cumsum(n)[:-1])
    A[np.ix_(at[0], at[0])], A[np.ix_(at[1], at[1])] = f.A, p.A
    A[np.ix_(at[2], at[2])], A[np.ix_(at[3], at[3])] = a.A, b.A
    A[np.ix_(at[1], at[0])] = p.B[:, :1] @ f.C
    A[np.ix_(at[2], at[1])] = a.B @ p.C[:1]
    B = np.zeros((sum(n), 2))
    B[at[0], :1], B[at[1], 1:], B[at[3], 1:] = f.B, p.B[:, 1:], b.B
    C = np.zeros((3, sum(n)))
    C[0, at[1]], C[0, at[2]] = (a.D @ p.C[:1])[0], a.C[0]
    C[1, at[3]] = b.C[0]
    C[2, at[1]] = p.C[1]
    return StateSpace(A, B, C, np.array([[0.0, 0.0], [0.0, b.D[0, 0]], [0.0, 0.0]]))


def test_filters_at_ports_are_the_augmented_plant():
    plant, authority = oscillator(), 30.0
    colour, on_z, on_u = lag(0.5, 2.0), lead(8.0, 0.8), lead(2.0, 40.0)
    shaping = Shaping(outputs=(("z", on_z),), inputs=(("u", on_u),), colours=(("w", colour),))
    law = design_lqg(plant, weights(), authority, shaping=shaping)
    s = by_hand(plant, colour, on_z, on_u)
    ports = PORTS[0], (Port("z", "m"), Port("cu", "N"), Port("y", "m"))
    # The same cost written as a plain one: the weighed control is one more output, u itself costs nothing.
    plain = Plant(dynamics=s, inputs=ports[0], outputs=ports[1], w=("w",), u=("u",), z=("z", "cu"), y=("y",))
    tiny = 1e-9
    asked = LQGWeights(
        output=np.array([1.3, np.sqrt(0.7 / authority)]),
        input=np.array([tiny]),
        disturbed=("w",),
        process=np.array([[2.0]]),
        sensor=np.array([1e-2]),
    )
    expected = design_lqg(plain, asked, authority)
    # The tiny weight changes the gain by tiny/authority over R = 0.02.
    np.testing.assert_allclose(law.system.C, expected.system.C, rtol=1e-6)
    np.testing.assert_allclose(law.system.B, expected.system.B, rtol=1e-9, atol=1e-12)
    assert law.cost == pytest.approx(expected.cost, rel=1e-6)
    assert law.state_names == (
        "colour of w", "state 0", "state 1", "state 2", "state 3", "weight on z", "weight on u"
    )  # fmt: skip
    assert close_loop(plant, law).stable


def test_a_weight_that_rises_takes_the_control_away_there():
    # u is made dear above 2 rad/s by 26 dB: the law is quieter at 20 rad/s and still holds the first mode.
    plant = oscillator()
    hz = np.array([1.0, 20.0]) / (2.0 * np.pi)
    plain = design_lqg(plant, weights(), 100.0)
    quiet = design_lqg(
        plant, weights(), 100.0, shaping=Shaping(inputs=(("u", gained(lead(2.0, 40.0), 20.0)),))
    )
    before, after = (np.abs(evaluate_compensator(law, hz).H[:, 0, 0]) for law in (plain, quiet))
    assert after[1] < 0.2 * before[1]
    assert close_loop(plant, quiet).stable


def gained(system, gain):
    return StateSpace(system.A, system.B, gain * system.C, gain * system.D)


def test_noise_straight_into_z_is_finite_behind_a_colour_or_a_weight():
    plant = oscillator(((0.5, 0.0), (0.0, 0.0)))
    with pytest.raises(ConfigError, match="infinite"):
        design_lqg(plant, weights(), 1.0)
    for shaping in (Shaping(colours=(("w", lag(5.0)),)), Shaping(outputs=(("z", lag(5.0)),))):
        law = design_lqg(plant, weights(), 1.0, shaping=shaping)
        assert 0.0 < law.cost < np.inf
        assert close_loop(plant, law).stable


def test_several_noises_make_one_colour():
    # Two noises in one colour: the sum of densities, so the filter is that of two disturbed inputs.
    plant = oscillator()
    one, two = lag(0.5), lag(4.0, 2.0)
    both = StateSpace(np.diag([-0.5, -4.0]), np.diag([0.5, 4.0]), [[1.0, 2.0]], [[0.0, 0.0]])
    law = design_lqg(plant, weights(), 3.0, shaping=Shaping(colours=(("w", both),)))
    s = plant.system
    ports = (Port("w", "N"), Port("v", "N"), Port("u", "N")), PORTS[1]
    system = StateSpace(s.A, s.B[:, [0, 0, 1]], s.C, np.zeros((2, 3)))
    twice = Plant(
        dynamics=system, inputs=ports[0], outputs=ports[1], w=("w", "v"), u=("u",), z=("z",), y=("y",)
    )
    asked = dataclasses.replace(weights(), disturbed=("w", "v"), process=2.0 * np.eye(2))
    expected = design_lqg(twice, asked, 3.0, shaping=Shaping(colours=(("w", one), ("v", two))))
    assert law.cost == pytest.approx(expected.cost, rel=1e-12)
    np.testing.assert_allclose(law.system.C, expected.system.C, rtol=1e-11)


def test_integral_action_leaves_no_error_at_rest():
    plant = oscillator()
    shaping = Shaping(integral=(("y", 0.5),))
    law = design_lqg(plant, weights(), 10.0, shaping=shaping)
    # The pole at zero is exact: the row of the integral reads nothing but the measurement.
    assert not law.system.A[-1].any()
    assert law.system.B[-1].tolist() == [1.0]
    assert law.state_names[-1] == "integral of y"
    seen = dataclasses.replace(plant, z=("y",))
    loop = close_loop(seen, law)
    assert loop.stable
    rest = loop.system.C @ np.linalg.solve(-loop.system.A, loop.system.B) + loop.system.D
    free = np.abs(plant.system.C[1] @ np.linalg.solve(-plant.system.A, plant.system.B[:, 0]))
    # Rounding of a solution with nine states.
    assert np.abs(rest).max() < 1e-12 * free


def test_cost_with_integral_action_is_that_of_the_loop():
    plant = oscillator()
    law = design_lqg(plant, weights(), 10.0, shaping=Shaping(integral=(("y", 0.5),)))
    s = plant.system
    _, X = covariance_cost(s.A, s.B, s.C[1:], s.D[1:], law.system, np.array([[2.0]]), np.array([[1e-2]]),
                           np.zeros((1, 1)), np.zeros((4, 4)), np.eye(1))  # fmt: skip
    z = 1.3 * np.hstack([s.C[0], np.zeros(5)])
    u = np.hstack([np.zeros((1, 4)), law.system.C])[0]
    integral = np.eye(9)[-1]
    expected = z @ X @ z + 0.07 * u @ X @ u + 0.25 * integral @ X @ integral
    assert law.cost == pytest.approx(expected, rel=1e-9)


def test_separation_with_everything_at_once():
    plant = oscillator()
    shaping = Shaping(
        outputs=(("z", lead(8.0, 0.8)),), inputs=(("u", lead(2.0, 40.0)),), colours=(("w", lag(0.5)),),
        integral=(("y", 0.5),), cross=np.array([[0.02]]),
    )  # fmt: skip
    law = design_lqg(plant, weights(), 10.0, shaping=shaping)
    loop = close_loop(plant, law)
    together = np.concatenate([law.regulator.poles, law.estimator.poles])
    apart = np.abs(loop.poles[:, None] - together[None]).min(axis=1)
    # The loop has the plant once; colours and weights are in the law alone: all poles are among the two sets.
    assert np.all(apart <= 1e-8 * np.maximum(np.abs(loop.poles), 1.0))
    assert loop.stable


def test_translations_stay_out_with_shaping():
    orbit = close_inner_loop(mace_like.build("orbit"), mace_like.pd_loops())
    shaping = Shaping(outputs=(("pri_in_x", lead(50.0, 5.0)),), colours=(("sec_rel_x", lag(60.0)),))
    law = design_lqg(mace_like_whole := orbit, mace_like.weights(2e-6), 10.0, shaping=shaping)
    assert law.regulator.residual < 1e-10
    assert law.estimator.residual < 1e-10
    assert close_loop(mace_like_whole, law).stable
    assert len(law.system.A) == len(orbit.system.A) + 2


def test_what_makes_no_sense_is_refused():
    plant, asked = oscillator(), weights()
    with pytest.raises(ConfigError, match="no direct term"):
        Shaping(inputs=(("u", lag(1.0)),))
    with pytest.raises(ConfigError, match="not stable"):
        Shaping(outputs=(("z", StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]])),))
    with pytest.raises(ConfigError, match="twice"):
        Shaping(colours=(("w", lag(1.0)), ("w", lag(2.0))))
    with pytest.raises(ConfigError, match="not one of each"):
        Shaping(outputs=(("z", gain_system(np.ones((1, 2)))),))
    with pytest.raises(ConfigError, match="integral is not positive"):
        Shaping(integral=(("y", 0.0),))
    with pytest.raises(ConfigError, match="no port 'nothing'"):
        design_lqg(plant, asked, 1.0, shaping=Shaping(colours=(("nothing", lag(1.0)),)))
    with pytest.raises(ConfigError, match="no port 'z'"):
        design_lqg(plant, asked, 1.0, shaping=Shaping(integral=(("z", 1.0),)))  # not measured
    with pytest.raises(ConfigError, match="correlation above one"):
        design_lqg(plant, asked, 1.0, shaping=Shaping(cross=np.array([[1.0]])))
    with pytest.raises(ConfigError, match="cross intensity"):
        design_lqg(plant, asked, 1.0, shaping=Shaping(cross=np.ones((2, 1))))
    kalman = design_filter(plant, asked)
    with pytest.raises(ConfigError, match="filter has 4 states, the design 5"):
        design_lqg(plant, asked, 1.0, kalman=kalman, shaping=Shaping(colours=(("w", lag(1.0)),)))


def test_an_integral_that_no_input_moves_is_named():
    # A rate has no response at rest: its integral cannot be held.
    modal = sum_of_modes(
        [2.0], 0.01, [[1.0, 1.0]], [[1.0], [0.0]], phi_rate=[[0.0], [1.0]], names=("bending",)
    )
    plant = Plant(dynamics=modal, inputs=PORTS[0], outputs=PORTS[1], w=("w",), u=("u",), z=("z",), y=("y",))
    with pytest.raises(NotStabilisableError, match="integral of y"):
        design_lqg(plant, weights(), 1.0, shaping=Shaping(integral=(("y", 1.0),)))
