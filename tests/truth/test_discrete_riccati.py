"""Discrete Riccati equations: closed forms, SciPy, delay states, fast sampling, and what has no answer."""

import numpy as np
import pytest
import scipy.linalg as sla
from hypothesis import given, settings
from hypothesis import strategies as st

from middeck.control.riccati.continuous import solve_riccati
from middeck.control.riccati.discrete import solve_discrete_riccati
from middeck.control.riccati.lyapunov import solve_discrete_lyapunov
from middeck.errors import ConfigError, NotStabilisableError, NumericalError


def residual(X, A, B, Q, R, S):
    """Written out again, without the factors the solver uses."""
    cross = A.T @ X @ B + S
    terms = [A.T @ X @ A, -X, -cross @ np.linalg.solve(R + B.T @ X @ B, cross.T), Q]
    return np.linalg.norm(sum(terms)) / sum(np.linalg.norm(t) for t in terms)


@pytest.mark.parametrize("a", [0.0, 0.5, 1.0, 3.0])
@pytest.mark.parametrize(("q", "r"), [(1.0, 1.0), (1e-6, 1.0), (5.0, 1e-6)])
def test_scalar_closed_form(a, q, r):
    # x^2 - x (q - r (1 - a^2)) - q r = 0, the positive root; pole a r / (r + x).
    found = solve_discrete_riccati(*(np.array([[v]]) for v in (a, 1.0, q, r)))
    p = q - r * (1.0 - a**2)
    root = np.sqrt(p**2 + 4.0 * q * r)
    x = (p + root) / 2.0 if p >= 0.0 else 2.0 * q * r / (root - p)
    # One scalar after a few tens of doublings; the pole a - b k cancels to rounding of a.
    assert found.X[0, 0] == pytest.approx(x, rel=1e-11)
    assert found.poles[0] == pytest.approx(a * r / (r + x), rel=1e-11, abs=1e-15)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 12), cross=st.booleans(), singular=st.booleans())
def test_random_problems_agree_with_scipy(seed, n, cross, singular):
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((n, n)), rng.standard_normal((n, 2)), rng.standard_normal((3, n))
    if singular:
        A[:, 0] = 0.0
    D = rng.standard_normal((3, 2)) if cross else np.zeros((3, 2))
    Q, R, S = C.T @ C, D.T @ D + np.eye(2), C.T @ D
    mine = solve_discrete_riccati(A, B, Q, R, S)
    theirs = sla.solve_discrete_are(A, B, Q, R, s=S)
    assert residual(mine.X, A, B, Q, R, S) < 1e-12  # rounding of 12 states
    assert np.abs(mine.poles).max() < 1.0
    # The oracle's own error, for random problems now and then badly conditioned.
    np.testing.assert_allclose(mine.X, theirs, atol=1e-7 * np.abs(theirs).max())


def sampled_resonators(period, count=15):
    omega = 2.0 * np.pi * np.geomspace(0.03, 60.0, count)
    A = sla.block_diag(*[np.array([[0.0, w], [-w, -2e-3 * w]]) for w in omega])
    rng = np.random.default_rng(4)
    B, C = np.zeros((2 * count, 2)), np.zeros((3, 2 * count))
    B[1::2] = rng.standard_normal((count, 2)) / omega[:, None]
    C[:, ::2] = rng.standard_normal((3, count))
    hold = sla.expm(np.block([[A, B], [np.zeros((2, 2 * count + 2))]]) * period)
    return hold[:-2, :-2], hold[:-2, -2:], C


def delayed(A, B, C, steps):
    """The same with inputs late by whole samples: a shift register, poles at zero, defective."""
    n, m = B.shape
    delay = steps * m
    Ad = np.zeros((n + delay, n + delay))
    Ad[:n, :n], Ad[:n, n : n + m] = A, B
    Ad[n : n + delay - m, n + m :] = np.eye(delay - m)
    Bd = np.zeros((n + delay, m))
    Bd[-m:] = np.eye(m)
    return Ad, Bd, np.hstack([C, np.zeros((len(C), delay))])


@pytest.mark.parametrize("period", [1e-2, 1e-3, 1e-4])
def test_light_damping_sampled_fast_with_delay(period):
    # Poles from 2e-8 inside the circle (0.03 Hz, 1e-3, 10 kHz) to zero.
    A, B, C = delayed(*sampled_resonators(period), 4)
    found = solve_discrete_riccati(A, B, period * C.T @ C, period * 1e-4 * np.eye(2))
    assert found.residual < 1e-12
    assert residual(found.X, A, B, period * C.T @ C, period * 1e-4 * np.eye(2), np.zeros(B.shape)) < 1e-11
    assert np.abs(found.poles).max() < 1.0


def test_a_delay_of_the_input_costs_what_the_algebra_says():
    A, B, C = delayed(np.array([[0.9]]), np.eye(1), np.eye(1), 3)
    found = solve_discrete_riccati(A, B, C.T @ C, np.eye(1))
    closed = A - B @ found.gain
    cost = solve_discrete_lyapunov(closed, C.T @ C + found.gain.T @ found.gain)
    # X is the cost to go: two routes, four states.
    np.testing.assert_allclose(found.X, cost, rtol=1e-12, atol=1e-12)


def test_fast_sampling_returns_the_continuous_solution():
    rng = np.random.default_rng(1)
    A, B, C = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.standard_normal((3, 5))
    slow = solve_riccati(A, B, C.T @ C, np.eye(2)).X

    def off(T):
        hold = sla.expm(np.block([[A, B], [np.zeros((2, 7))]]) * T)
        X = solve_discrete_riccati(hold[:5, :5], hold[:5, 5:], T * C.T @ C, T * np.eye(2)).X
        return np.linalg.norm(X - slow) / np.linalg.norm(slow)

    # First order in the period: a tenth of it leaves a tenth of the difference.
    assert off(1e-4) == pytest.approx(off(1e-3) / 10.0, rel=0.05)
    assert off(1e-4) < 1e-3


def test_twenty_decades_of_scaling_change_nothing():
    A, B, C = sampled_resonators(1e-2)
    t = 10.0 ** np.linspace(-10.0, 10.0, len(A))[np.random.default_rng(0).permutation(len(A))]
    plain = solve_discrete_riccati(A, B, C.T @ C, np.eye(2))
    Ct = C * t
    scaled = solve_discrete_riccati(A * t / t[:, None], B / t[:, None], Ct.T @ Ct, np.eye(2))
    # The scaled data carry their own rounding into a problem of condition 1e6 (poles 1e-5 from the circle).
    np.testing.assert_allclose(scaled.X / np.outer(t, t), plain.X, atol=1e-9 * np.abs(plain.X).max())


def test_modes_that_cannot_be_held_are_named():
    with pytest.raises(NotStabilisableError, match="yaw"):
        solve_discrete_riccati(
            np.diag([1.0, 0.5]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1), names=("yaw", "roll")
        )
    with pytest.raises(NotStabilisableError, match=r"the cost .* misses it.*yaw"):
        solve_discrete_riccati(
            np.diag([1.0, 0.5]), np.ones((2, 1)), np.diag([0.0, 1.0]), np.eye(1), names=("yaw", "roll")
        )
    with pytest.raises(ConfigError, match="positive definite"):
        solve_discrete_riccati(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)))
    with pytest.raises(NumericalError):
        solve_discrete_riccati(0.5 * np.eye(1), np.eye(1), -5.0 * np.eye(1), np.eye(1))


def test_lyapunov_of_an_unstable_matrix_is_none():
    assert solve_discrete_lyapunov(np.array([[1.1]]), np.eye(1)) is None
