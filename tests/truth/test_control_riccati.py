"""Riccati equations against closed forms, against SciPy where it works, and where it does not."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as sla
from hypothesis import given, settings
from hypothesis import strategies as st

import middeck as md
from middeck.control.riccati import continuous
from middeck.control.riccati.continuous import solve_riccati
from middeck.errors import ConfigError, NotStabilisableError, NumericalError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.delay.pade import pade
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.modal_system import ModalSystem
from plant_builders import unit_weights

ROOT = Path(__file__).parents[2]
DM, LAB = ROOT / "articles/mace-dm.toml", ROOT / "environments/lab.toml"


def residual(X, A, B, Q, R, S=None):
    """Written out again, without the factors the solver uses."""
    S = np.zeros_like(B) if S is None else S
    gain = np.linalg.solve(R, (X @ B + S).T)
    terms = [A.T @ X, X @ A, -(X @ B + S) @ gain, Q]
    return np.linalg.norm(sum(terms)) / sum(np.linalg.norm(t) for t in terms)


@pytest.mark.parametrize("a", [-2.0, 0.0, 0.5, 30.0])
@pytest.mark.parametrize(("b", "q", "r"), [(1.0, 1.0, 1.0), (0.3, 5.0, 1e-6), (2.0, 1e-4, 1e3)])
def test_scalar_closed_form(a, b, q, r):
    # 2 a x - b^2 x^2 / r + q = 0; the root whose closed-loop pole -sqrt(a^2 + b^2 q / r) is stable.
    pole = -np.sqrt(a**2 + b**2 * q / r)
    solution = solve_riccati(*(np.array([[v]]) for v in (a, b, q, r)))
    # The sum a - pole is exact to rounding for a >= 0 and cancels a little for a < 0: x = q / -(a + pole).
    expected = (a - pole) * r / b**2 if a >= 0.0 else -q / (a + pole)
    assert solution.X[0, 0] == pytest.approx(expected, rel=1e-12)
    assert solution.poles[0] == pytest.approx(pole, rel=1e-12)


@pytest.mark.parametrize("rho", [1.0, 1e-6, 1e6])
def test_double_integrator(rho):
    # Cost x1^2 + rho u^2: X = [[sqrt2 rho^1/4, rho^1/2], [., sqrt2 rho^3/4]]; Butterworth pattern.
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    solution = solve_riccati(A, B, np.diag([1.0, 0.0]), np.array([[rho]]))
    off = rho**0.5
    expected = np.array([[np.sqrt(2.0) * rho**0.25, off], [off, np.sqrt(2.0) * rho**0.75]])
    # Two states, well conditioned after balancing: a few roundings.
    np.testing.assert_allclose(solution.X, expected, rtol=1e-12)
    np.testing.assert_allclose(np.abs(solution.poles), rho**-0.25, rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 12), cross=st.booleans())
def test_random_problems_agree_with_scipy(seed, n, cross):
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((n, n)), rng.standard_normal((n, 2)), rng.standard_normal((3, n))
    D = rng.standard_normal((3, 2)) if cross else np.zeros((3, 2))
    Q, R, S = C.T @ C, D.T @ D + np.eye(2), C.T @ D
    mine = solve_riccati(A, B, Q, R, S)
    theirs = sla.solve_continuous_are(A, B, Q, R, s=S)
    assert residual(mine.X, A, B, Q, R, S) < 1e-12  # rounding of 12 states
    assert np.all(mine.poles.real < 0.0)
    # The oracle's own error, for random problems now and then badly conditioned.
    np.testing.assert_allclose(mine.X, theirs, atol=1e-7 * np.abs(theirs).max())


def benign(n=20, seed=1):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, n)), rng.standard_normal((n, 3)), rng.standard_normal((4, n))


def test_twenty_decades_of_scaling_change_nothing():
    # States in units from 1e-10 to 1e10: the solution must transform exactly as the units do.
    A, B, C = benign()
    t = 10.0 ** np.linspace(-10.0, 10.0, len(A))[np.random.default_rng(0).permutation(len(A))]
    plain = solve_riccati(A, B, C.T @ C, np.eye(3))
    Ct = C * t
    scaled = solve_riccati(A * t / t[:, None], B / t[:, None], Ct.T @ Ct, np.eye(3))
    back = scaled.X / np.outer(t, t)
    # The scaled data carry their own rounding into the problem: 20 states, condition about 1e2.
    np.testing.assert_allclose(back, plain.X, atol=1e-10 * np.abs(plain.X).max())
    assert scaled.residual < 1e-10


def test_intensities_of_twenty_decades():
    # Resonators with process noise from 1e-15 to 1e3 and sensor noise 1e-9, as in the study.
    omega = 2.0 * np.pi * np.geomspace(0.03, 45.0, 12)
    A = sla.block_diag(*[np.array([[0.0, w], [-w, -0.02 * w]]) for w in omega])
    rng = np.random.default_rng(4)
    B = np.zeros((24, 3))
    B[1::2] = rng.standard_normal((12, 3))
    C = np.zeros((3, 24))
    C[:, ::2] = rng.standard_normal((3, 12))
    Q = B @ np.diag([1e-15, 1e-6, 1e3]) @ B.T
    R = np.diag([1e-9, 1e-9, 1e-4])
    solution = solve_riccati(A.T, C.T, Q, R)
    assert solution.residual < 1e-11
    assert residual(solution.X, A.T, C.T, Q, R) < 1e-10
    assert np.all(solution.poles.real < 0.0)


@pytest.mark.parametrize("noise", [1e-10, 1e-12, 1e-16])
@pytest.mark.parametrize("order", [2, 4, 6])
def test_states_that_no_noise_drives_spoil_nothing(order, noise):
    """Delays of one input beside a disturbance at another: of their states the covariance is zero."""
    omega = 2.0 * np.pi * np.array([0.3, 2.0, 9.0])
    psi = np.array([[1.0, 1.0], [1.0, -1.0], [0.5, 1.0]])
    phi = np.array([[1.0, 0.8, 0.3], [0.9, -0.5, 0.6]])
    modes = ModalSystem(
        omega=omega, zeta=np.full(3, 0.01), psi=psi, phi=phi, phi_rate=np.zeros((2, 3)), names=tuple("abc")
    )
    plant = Plant(
        dynamics=modes, inputs=(Port("u", "N"), Port("w", "N")), outputs=(Port("z", "m"), Port("y", "m"))
    )
    delayed = approximate_delays(delay_plant(plant, 0.0075), order).system
    Q, R = 1e-8 * delayed.B[:, 1:] @ delayed.B[:, 1:].T, np.array([[noise]])
    C = delayed.C[1:]
    solution = solve_riccati(delayed.A.T, C.T, Q, R)
    # Rounding of a dozen rows; the level asked of five hundred is 1e-10.
    assert solution.residual < 1e-13
    assert residual(solution.X, delayed.A.T, C.T, Q, R) < 1e-13


def test_unreachable_growing_mode_is_named():
    A, B = np.diag([0.5, -1.0]), np.array([[0.0], [1.0]])
    with pytest.raises(NotStabilisableError, match="yaw") as caught:
        solve_riccati(A, B, np.eye(2), np.eye(1), names=("yaw", "roll"))
    assert caught.value.data["modes"] == ("yaw",)


def test_unreachable_free_mode_is_named_even_if_rotated():
    # A double integrator without input, hidden by a rotation of all coordinates.
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    B = np.array([[0.0], [0.0], [0.0], [1.0]])
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))
    with pytest.raises(NotStabilisableError):
        solve_riccati(turn @ A @ turn.T, turn @ B, np.eye(4), np.eye(1))


def test_modes_that_are_out_of_reach_in_a_combination_only_are_reported():
    # One force on two free masses moves their sum; neither alone is out of reach.
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    B = np.array([[0.0], [1.0], [0.0], [1.0]])
    names = ("left", "left", "right", "right")
    with pytest.raises(NotStabilisableError, match="a combination of left, right") as caught:
        solve_riccati(A, B, np.eye(4), np.eye(1), names=names)
    assert caught.value.data["modes"] == ("left", "right")


def test_free_mode_outside_the_cost_is_named():
    A, B = np.diag([0.0, -1.0]), np.ones((2, 1))
    with pytest.raises(NotStabilisableError, match=r"the cost .* misses it.*drift"):
        solve_riccati(A, B, np.diag([0.0, 1.0]), np.eye(1), names=("drift", "lag"))


def test_unreachable_but_decaying_mode_is_no_obstacle():
    A, B = np.diag([-1e-3, -1.0]), np.array([[0.0], [1.0]])
    assert solve_riccati(A, B, np.eye(2), np.eye(1)).X[0, 0] == pytest.approx(500.0, rel=1e-12)


def test_weight_that_is_not_positive_is_refused():
    with pytest.raises(ConfigError, match="positive definite"):
        solve_riccati(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)))


def test_indefinite_cost_without_solution_is_refused():
    with pytest.raises(NumericalError):
        solve_riccati(-np.eye(1), np.eye(1), np.array([[-5.0]]), np.eye(1))


def test_a_newton_step_near_the_axis_is_judged_by_its_residual_without_a_warning():
    """At 1e24 the closed loop's poles span so much that SciPy perturbs the Lyapunov equation of the step."""
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(DM, LAB)))
    u, y = ["pri_rel_z"], ["pri_in_z"]
    plant = md.build_plant(modes, inputs=u, outputs=y, count=12, w=u, u=u, z=y, y=y)
    weights = unit_weights(tuple(u), 4e-10, process=1e-4)
    regulator = md.design_lqg(plant, weights, 1e24).regulator
    assert regulator.residual < 1e-12  # rounding leaves 1e-15 to 1e-12
    assert regulator.poles.real.max() < 0.0


@pytest.mark.parametrize("order", range(2, 9))
def test_states_that_cost_nothing_spoil_no_unit(order: int) -> None:
    """A way late by two times is weighed; what is late by two others costs nothing, and X is zero there."""
    delay = [(0.05, 0, 1.0), (0.4, 0, 0.0), (0.1, 1, 0.0), (0.3, 1, 1.0)]
    parts = [pade(tau, order) for tau, _, _ in delay]
    A = sla.block_diag([[0.0, 1.0], [0.0, 0.0]], *(p.A for p in parts))
    drives = [p.B * (np.arange(2) == i) for p, (_, i, _) in zip(parts, delay, strict=True)]
    B = np.vstack([[[-0.05, -0.3], [1.0, 1.0]], *drives])
    seen = [w * np.linalg.solve((p.A @ p.A).T, p.C[0]) for p, (_, _, w) in zip(parts, delay, strict=True)]
    way = np.concatenate([[1.0, 0.0], *seen])
    found = solve_riccati(A, B, np.outer(way, way), np.eye(2))
    # The level asked for at 500 states; here rounding leaves 1e-16 to 1e-12.
    assert found.residual < 1e-10
    silent = np.arange(2 + order, 2 + 3 * order)
    assert np.abs(found.X[silent]).max() < 1e-10 * np.abs(found.X).max()


def test_the_residual_of_a_step_from_far_away_is_infinite_without_a_warning():
    far, one = np.full((2, 2), 1e160), np.eye(2)
    assert continuous.residual(far, -one, one, one)[1] == np.inf
    assert continuous.residual(one, -one, one, 3.0 * one)[1] == 0.0
