"""Many loops at once: verdicts of one loop alone, rms against exact fractions and LAPACK."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.h2.closed_cost import Law, closed_matrices
from middeck.control.h2.generalized_plant import generalize
from middeck.control.lqg.design import design_lqg
from middeck.control.robust.verification.many_loops import close_many, decide_many, measure_many
from middeck.control.robust.verification.single_loop import measure_one
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant, group_ports
from middeck.systems.poles.verdict import is_stable
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes, unit_weights
from repeats import repeats


def _single(A):
    return is_stable(StateSpace(A, np.zeros((len(A), 1)), np.zeros((1, len(A))), np.zeros((1, 1))))


def _modes(rng, count, modes, damping, decades=2.0):
    """Block diagonal modes within a random basis of moderate condition, in badly chosen units."""
    n = 2 * modes
    omega = 10.0 ** rng.uniform(-decades / 2.0, decades / 2.0, (count, modes))
    A, k = np.zeros((count, n, n)), 2 * np.arange(modes)
    A[:, k, k + 1], A[:, k + 1, k] = omega, -omega
    A[:, k + 1, k + 1] = -2.0 * damping * omega
    T = np.eye(n) + 0.3 * rng.standard_normal((n, n)) / np.sqrt(n)
    unit = 10.0 ** rng.uniform(-4.0, 4.0, n)
    return unit[:, None] * (T @ A @ np.linalg.inv(T)) / unit, unit


KINDS = {
    "light": lambda r: r.uniform(0.002, 0.05, (12, 4)),
    "some grow": lambda r: r.uniform(-0.01, 0.05, (12, 4)),
    "marginal": lambda r: r.choice([0.0, 1e-11, -1e-11, 1e-7, -1e-7, 0.1], (12, 4)),
    "hardly damped": lambda r: 10.0 ** r.uniform(-7.0, -1.0, (12, 4)),
}


@pytest.mark.parametrize("seed", repeats(range(50), quick=2))
@pytest.mark.parametrize("kind", KINDS)
def test_verdicts_and_rms_are_those_of_one_loop(kind, seed):
    rng = np.random.default_rng(seed)
    A, unit = _modes(rng, 12, 4, KINDS[kind](rng))
    B, C = unit[:, None] * rng.standard_normal((12, 8, 2)), rng.standard_normal((12, 3, 8)) / unit
    found = measure_many(A, B, C)
    np.testing.assert_array_equal(found.stable, [_single(a) for a in A])
    np.testing.assert_array_equal(decide_many(A), found.stable)
    finite = np.isfinite(found.rms[:, 0])
    assert finite[~found.alone & found.stable].all()
    assert not np.isfinite(found.rms[~found.stable]).any()
    for a, b, c, rms in zip(A[finite], B[finite], C[finite], found.rms[finite], strict=True):
        a, b, c = a / unit[:, None] * unit, b / unit[:, None], c * unit
        X = sla.solve_continuous_lyapunov(a, -b @ b.T)
        # Rounding of A moves the damping, by 1e-15 of a thousand at 1e-7.
        np.testing.assert_allclose(rms, np.sqrt(np.diag(c @ X @ c.T)), rtol=1e-6 if kind[0] in "hm" else 1e-9)


def test_rms_against_fractions():
    rng = np.random.default_rng(7)
    A, unit = _modes(rng, 2, 2, rng.uniform(0.005, 0.02, (2, 2)))
    B, C = unit[:, None] * rng.standard_normal((2, 4, 1)), rng.standard_normal((2, 1, 4)) / unit
    found = measure_many(A, B, C)
    assert not found.alone.any()
    for a, b, c, rms in zip(A, B, C, found.rms, strict=True):
        x = _exact_covariance(a, b)
        square = sum(Fraction(c[0, i]) * Fraction(c[0, j]) * x[4 * i + j] for i in range(4) for j in range(4))
        assert abs(float(square) ** 0.5 / rms[0] - 1.0) < 1e-11


@pytest.mark.parametrize("seed", repeats(range(12), quick=2))
@pytest.mark.parametrize("mixed", [True, False])
@pytest.mark.parametrize("share", [1e-7, 1e-5, 1e-3])
def test_the_error_of_a_small_output_is_reported(share, mixed, seed):
    """A mode that another hardly drives; its rms is lost in the rounding of a basis that mixes both."""
    rng = np.random.default_rng(seed)
    omega, zeta = 10.0 ** rng.uniform(-1.0, 1.0, 2), rng.uniform(0.002, 0.05, 2)
    A, B, C = np.zeros((5, 4, 4)), np.zeros((5, 4, 1)), np.zeros((5, 2, 4))
    A[:, [0, 2], [1, 3]] = drawn = omega * (1.0 + 0.03 * rng.standard_normal((5, 2)))
    A[:, [1, 3], [0, 2]], A[:, [1, 3], [1, 3]], A[:, 3, 0] = -drawn, -2.0 * zeta * drawn, share
    B[:, 1], C[:, [0, 1], [0, 2]] = 1.0, 1.0
    if mixed:
        T = np.eye(4) + 0.3 * rng.standard_normal((4, 4))
        A, B, C = T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T)
    found = measure_many(A, B, C)
    true = np.array([_exact_rms(a, b, c) for a, b, c in zip(A[:2], B[:2], C[:2], strict=True)])
    assert (np.abs(found.rms[:2] / true - 1.0) <= found.error[:2] + 1e-14).all()
    assert found.error[:, 0].max() < 1e-9
    if not mixed:
        assert found.error.max() < 1e-4


def _exact_rms(a, b, c):
    x, n = _exact_covariance(a, b), range(len(a))
    square = [sum(Fraction(r[i]) * Fraction(r[j]) * x[len(a) * i + j] for i in n for j in n) for r in c]
    return np.sqrt([float(s) for s in square])


def test_loops_with_delays_are_not_decided_alone():
    """An approximated delay is far from normal: in fitting units the powers of its loop hardly grow."""
    force, place = Port("force", "N"), Port("place", "m")
    omega, shape = np.array([1.0, 3.0, 9.0, 30.0, 60.0]), np.array([[1.0, 0.6, 0.8, 0.7, 0.5]])
    weights = unit_weights(("force",), 1e-8)
    models = []
    for factor in 1.0 + 0.01 * np.random.default_rng(5).uniform(-1.0, 1.0, (6, 5)):
        modal = sum_of_modes(omega * factor, 0.01, shape.T, shape)
        plant = Plant(dynamics=modal, inputs=(force,), outputs=(place,))
        plant = group_ports(plant, w=("force",), u=("force",), z=("place",), y=("place",))
        models.append(approximate_delays(delay_plant(plant, 0.01), 20))
    law = design_lqg(models[0], weights, 1e5).system
    stack = [generalize(m, weights, 1.0) for m in models]
    A, B, C = (
        np.array(x) for x in zip(*(closed_matrices(m, Law(law.A, law.B, law.C)) for m in stack), strict=True)
    )
    found = measure_many(A, B, C)
    assert not found.alone.any()
    np.testing.assert_array_equal(found.stable, [_single(a) for a in A])
    held = found.stable
    assert held.any()
    for a, b, c, rms in zip(A[held], B[held], C[held], found.rms[held], strict=True):
        X = sla.solve_continuous_lyapunov(a, -b @ b.T)
        np.testing.assert_allclose(rms, np.sqrt(np.diag(c @ X @ c.T)), rtol=1e-6)


def _exact_covariance(a, b):
    """A X + X A' + B B' = 0 by Gauss's elimination of fractions, row by row of X."""
    n = len(a)
    F = [[Fraction(v) for v in row] for row in a]
    G = [
        [sum((Fraction(p) * Fraction(q) for p, q in zip(r, t, strict=True)), Fraction(0)) for t in b]
        for r in b
    ]
    rows = []
    for i in range(n):
        for j in range(n):
            row = [Fraction(0)] * (n * n) + [-G[i][j]]
            for k in range(n):
                row[n * k + j] += F[i][k]
                row[n * i + k] += F[j][k]
            rows.append(row)
    for k in range(n * n):
        at = next(i for i in range(k, n * n) if rows[i][k])
        rows[k], rows[at] = rows[at], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for i in range(n * n):
            if i != k and rows[i][k]:
                share = rows[i][k]
                rows[i] = [v - share * w for v, w in zip(rows[i], rows[k], strict=True)]
    return [row[-1] for row in rows]


def test_integrators_chains_and_empty_stacks_are_decided_as_one_loop():
    still = np.zeros((4, 3, 3))
    still[1, 0, 1] = still[2, 0, 0] = 1.0  # a free body; a pole that grows, and equals p
    still[3] = -np.eye(3) + 1e4 * np.triu(np.ones((3, 3)), 1)  # far from normal
    found = measure_many(still, np.ones((4, 3, 1)), np.ones((4, 1, 3)))
    assert found.stable.tolist() == [_single(a) for a in still] == [True, True, False, True]
    assert np.isfinite(found.rms[:, 0]).tolist() == [False, False, False, True]
    assert measure_many(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0))).stable.all()
    assert decide_many(np.zeros((0, 3, 3))).shape == (0,)


def test_plants_under_one_law():
    rng = np.random.default_rng(3)
    A = rng.standard_normal((5, 4, 4)) - 4.0 * np.eye(4)
    B1, B2, C1, C2 = (rng.standard_normal((5, *s)) for s in ((4, 1), (4, 2), (3, 4), (1, 4)))
    law = Law(-np.eye(2), rng.standard_normal((2, 1)), rng.standard_normal((2, 2)))
    found = close_many(A, (B1, B2), (C1, C2), law)
    for i in range(5):
        np.testing.assert_array_equal(found[0][i], np.block([[A[i], B2[i] @ law.C], [law.B @ C2[i], law.A]]))
    assert np.isfinite(measure_many(*found).rms).all() == bool(decide_many(found[0]).all())


@pytest.mark.parametrize("A", [np.zeros((2, 3, 4)), np.full((2, 3, 3), np.nan), np.zeros((3, 3))])
def test_what_is_no_stack_of_loops_is_refused(A):
    with pytest.raises(ConfigError):
        measure_many(A, np.zeros((2, 3, 1)), np.zeros((2, 1, 3)))


def test_what_rounding_hides_has_no_error_of_zero():
    """One mode of three over five decades, states mixed: rms (b^2 / (4 zeta w^3))^1/2, or told as lost."""
    rng, lost = np.random.default_rng(11), 0
    for _ in range(150):
        w, zeta = 2.0 * np.pi * 10.0 ** rng.uniform(-2, 3, 3), 10.0 ** rng.uniform(-5, -1, 3)
        A, b, C = np.zeros((6, 6)), np.zeros((6, 1)), np.zeros((1, 6))
        A[:3, 3:], A[3:, :3], A[3:, 3:] = np.eye(3), -np.diag(w**2), -np.diag(2.0 * zeta * w)
        b[3:, 0], top = rng.standard_normal(3), int(np.argmax(w))
        C[0, top], R = 1.0, rng.standard_normal((6, 6))
        back = np.linalg.inv(R)
        stable, rms, error, _ = measure_one(R @ A @ back, R @ b, C @ back)
        true = abs(b[3 + top, 0]) / np.sqrt(4.0 * zeta[top] * w[top] ** 3)
        assert error[0] > 0.0
        assert not stable or abs(rms[0] / true - 1.0) <= 3.0 * error[0] + 1e-9
        lost += error[0] > 1.0
    assert lost  # else nothing here is hidden


def test_an_output_that_sees_nothing_is_zero_with_the_others():
    """Its sum has no terms: no loop is decided alone for it."""
    A = np.array([[[-1.0 - k / 10.0, 0.0], [0.0, -2.0]] for k in range(20)])
    B, C = np.tile([[1.0], [0.0]], (20, 1, 1)), np.tile(np.eye(2), (20, 1, 1))
    found = measure_many(A, B, C)
    assert not found.alone.any()
    assert np.all(found.rms[:, 1] == 0.0)
    assert np.all(found.error[:, 1] == 0.0)
    assert found.rms[:, 0] == pytest.approx((2.0 * (1.0 + np.arange(20) / 10.0)) ** -0.5, rel=1e-9)
