"""Frequency responses of full matrices: against modes, against extended precision, and where poles fail."""

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.refined_poles import refine_poles
from middeck.systems.poles.resolvent import by_poles, by_schur_form, by_solving, evaluate_transfer, on_axis
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

RNG = np.random.default_rng(5)


def resonators(omega, zeta, inputs=2, outputs=3):
    n = len(omega)
    A = sla.block_diag(*[np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]) for w in omega])
    B, C = np.zeros((2 * n, inputs)), np.zeros((outputs, 2 * n))
    B[1::2] = RNG.standard_normal((n, inputs))
    C[:, ::2] = RNG.standard_normal((outputs, n))
    return StateSpace(A, B, C, RNG.standard_normal((outputs, inputs)))


def turned(system, seed=1):
    T, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal(system.A.shape))
    return StateSpace(T @ system.A @ T.T, T @ system.B, system.C @ T.T, system.D)


def relative(found, true):
    return np.sqrt(np.sum(np.abs(found - true) ** 2) / np.sum(np.abs(true) ** 2))


def in_extended_precision(system, points):
    """Solutions refined until their residual in extended precision is nothing."""
    A = system.A.astype(np.longdouble)
    found = []
    for p in points:
        lu = sla.lu_factor(p * np.eye(len(A)) - system.A)
        x = sla.lu_solve(lu, system.B.astype(complex)).astype(np.clongdouble)
        for _ in range(4):
            x = x + sla.lu_solve(lu, (system.B - (p * x - A @ x)).astype(complex))
        found.append(np.asarray(system.C.astype(np.longdouble) @ x + system.D, dtype=complex))
    return np.array(found)


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-17, reason="no extended precision on this machine")
def test_many_lines_are_as_good_as_the_matrices():
    # Modes 0.6 to 60 rad/s at 0.5 %: A is 3600, the narrowest half-width 0.003. Two modes come twice.
    omega = np.sort(np.concatenate([np.geomspace(0.6, 60.0, 20), [5.0, 5.0, 17.0, 17.0]]))
    system = turned(resonators(omega, 0.005))
    points = 1j * np.concatenate([omega, np.geomspace(0.1, 100.0, 40)])
    true = in_extended_precision(system, points)
    # Eigenvalues from LAPACK alone leave 1e-11; a few hundred roundings of the sum are left here.
    assert relative(evaluate_transfer(system, points), true) < 1e-13
    # Backward stable, so its error is that of a change of A in the last digit: |A| eps / half-width.
    assert relative(by_schur_form(system)(points), true) < 1e-10


def test_plain_poles_agree_with_solving():
    system = turned(resonators(np.geomspace(1.0, 30.0, 10), 0.02))
    points = 1j * np.geomspace(0.1, 100.0, 50)
    # Condition of the eigenvectors below 100.
    poles = refine_poles(system.A, system.B, system.C)
    assert relative(by_poles(poles)(points) + system.D, by_solving(system)(points)) < 1e-11
    assert relative(on_axis(poles, points.imag) + system.D, by_solving(system)(points)) < 1e-11


def test_real_poles_and_a_constant_of_the_system_count():
    # 1/(s + 1) + 1/(s + 3) + 2 on many lines, in full coordinates.
    system = turned(StateSpace(np.diag([-1.0, -3.0]), [[1.0], [1.0]], [[1.0, 1.0]], [[2.0]]))
    s = 1j * np.geomspace(0.1, 100.0, 50)
    found = statespace_response(system, s.imag)[:, 0, 0]
    np.testing.assert_allclose(found, 1.0 / (s + 1.0) + 1.0 / (s + 3.0) + 2.0, rtol=1e-13)


def test_defective_poles_go_by_substitution():
    # 1/(s + 5)^4 has one eigenvector, and a free body a double pole at the origin.
    lags = StateSpace(-5.0 * np.eye(4) + np.diag(np.ones(3), 1), np.eye(4)[:, 3:], np.eye(4)[:1], [[0.0]])
    omega = np.geomspace(0.1, 100.0, 200)
    assert relative(statespace_response(turned(lags), omega)[:, 0, 0], (1j * omega + 5.0) ** -4.0) < 1e-12
    free = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    assert relative(statespace_response(turned(free), omega)[:, 0, 0], (1j * omega) ** -2.0) < 1e-12


def test_sampled_systems_and_no_states():
    period = 0.01
    A = sla.expm(turned(resonators(np.array([3.0, 40.0]), 0.01)).A * period)
    system = SampledStateSpace(
        A, RNG.standard_normal((4, 1)), RNG.standard_normal((2, 4)), np.ones((2, 1)), period_s=period
    )
    omega = np.geomspace(0.1, 300.0, 100)
    p = np.exp(1j * omega * period)
    assert relative(statespace_response(system, omega), by_solving(system)(p)) < 1e-11
    gain = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((2, 0)), np.ones((2, 1)))
    np.testing.assert_array_equal(statespace_response(gain, omega), np.ones((100, 2, 1)))


def test_more_lines_than_fit_at_once():
    system = turned(resonators(np.geomspace(1.0, 30.0, 40), 0.02))
    omega = np.geomspace(0.1, 100.0, 3000)
    some = np.arange(0, 3000, 300)
    few = statespace_response(system, omega[some])  # solved line by line
    assert relative(statespace_response(system, omega)[some], few) < 1e-11
    assert relative(by_schur_form(system)(1j * omega)[some], few) < 1e-11
