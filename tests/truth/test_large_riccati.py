"""Large Riccati equations, solved in blocks: light damping, integrators, many decades, and Lyapunov."""

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.riccati.continuous import solve_riccati
from middeck.control.riccati.lyapunov import solve_lyapunov
from middeck.control.riccati.stable_subspace import SMALL, solve_by_subspace
from middeck.errors import NotStabilisableError


def structure(modes, zeta, *, free=0, inputs=3, outputs=5, seed=0):
    """``free`` double integrators and modes from 0.05 to 500 Hz; states q, q'/omega."""
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * np.geomspace(0.05, 500.0, modes)
    blocks = free * [np.array([[0.0, 1.0], [0.0, 0.0]])]
    blocks += [np.array([[0.0, w], [-w, -2.0 * zeta * w]]) for w in omega]
    scale = np.concatenate([np.ones(free), omega])
    B, C = np.zeros((2 * (free + modes), inputs)), np.zeros((outputs, 2 * (free + modes)))
    B[1::2] = rng.standard_normal((free + modes, inputs)) / scale[:, None]
    C[:, ::2] = rng.standard_normal((outputs, free + modes))
    return sla.block_diag(*blocks), B, C


def residual(X, A, B, Q, R):
    terms = A.T @ X, X @ A, -X @ B @ np.linalg.solve(R, B.T @ X), Q
    return np.linalg.norm(sum(terms)) / sum(np.linalg.norm(t) for t in terms)


@pytest.mark.parametrize("zeta", [1e-2, 1e-3])
@pytest.mark.parametrize("free", [0, 3])
@pytest.mark.parametrize("rho", [1.0, 1e-8])
def test_light_damping_and_integrators(zeta, free, rho):
    A, B, C = structure(60, zeta, free=free)
    assert 2 * len(A) > SMALL  # in blocks
    found = solve_riccati(A, B, C.T @ C, rho * np.eye(3))
    # The level asked of 500 states; four decades of frequency and eight of weights.
    assert found.residual < 1e-10
    assert residual(found.X, A, B, C.T @ C, rho * np.eye(3)) < 1e-10
    assert found.poles.real.max() < 0.0


def test_blocks_and_one_piece_agree(monkeypatch):
    A, B, C = structure(55, 1e-2)
    blocks = solve_by_subspace(A, B @ B.T, C.T @ C)
    monkeypatch.setattr("middeck.control.riccati.stable_subspace.SMALL", 10**6)
    whole = solve_by_subspace(A, B @ B.T, C.T @ C)
    # The same subspace twice; its condition is that of poles 1e-2 of their size from the axis.
    np.testing.assert_allclose(blocks, whole, atol=1e-8 * np.abs(whole).max())


def test_intensities_of_twenty_decades_in_blocks():
    A, B, C = structure(60, 5e-3, outputs=3)
    R = np.diag([1e-9, 1e-9, 1e-4])
    found = solve_riccati(A.T, C.T, B @ np.diag([1e-15, 1e-6, 1e3]) @ B.T, R)
    assert found.residual < 1e-10
    assert found.poles.real.max() < 0.0


def test_a_mode_out_of_reach_among_many_is_named():
    A, B, C = structure(60, 1e-2, free=1)
    B[:2] = 0.0
    names = ("yaw", "yaw", *(f"mode {k // 2}" for k in range(120)))
    with pytest.raises(NotStabilisableError, match="yaw"):
        solve_riccati(A, B, C.T @ C, np.eye(3), names=names)


@pytest.mark.parametrize("n", [1, 2, 47, 48, 49, 150])
def test_lyapunov_in_blocks(n):
    rng = np.random.default_rng(n)
    A, Q = rng.standard_normal((n, n)) - 1.2 * np.sqrt(n) * np.eye(n), rng.standard_normal((n, n))
    Q = Q + Q.T
    X = solve_lyapunov(A, Q)
    # Poles well left of the axis: rounding of n states.
    np.testing.assert_allclose(A.T @ X + X @ A, -Q, atol=1e-12 * n)
    np.testing.assert_array_equal(X, X.T)
