"""Shapes of the stiffest modes: responses far above them against elimination in long double."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from frame_reference import carried
from middeck.structure.eigenproblem.eigen import solve_all

Fine = np.longdouble


def bodies_on_bushings(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of a tree of free bodies of 0.01 to 3 m whose nodes full 6x6 bushings join."""
    K, M = np.zeros((2, 6 * count, 6 * count))
    for b in range(count):
        size, mass = 10 ** rng.uniform(-2, 0.5), 10 ** rng.uniform(-1, 2)
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        at_centre = np.diag(np.repeat(mass, 6))
        at_centre[3:, 3:] = mass * size**2 * axes * rng.uniform(0.2, 0.4, 3) @ axes.T
        arm = carried(0.3 * size * rng.standard_normal(3))
        here = slice(6 * b, 6 * b + 6)
        M[here, here] = arm.T @ at_centre @ arm
        if b:
            length, other = 10 ** rng.uniform(-2, 0.5), 6 * int(rng.integers(b))
            mix = np.repeat([1.0, length], 3)[:, None] * rng.standard_normal((6, 6))
            strain = np.zeros((6, 6 * count))
            strain[:, here] = np.eye(6)
            strain[:, other : other + 6] = -carried(length * rng.standard_normal(3))
            K += 10 ** rng.uniform(2, 8) * strain.T @ mix @ mix.T @ strain
    return 0.5 * (K + K.T), 0.5 * (M + M.T)


def inverted(A: np.ndarray) -> np.ndarray:
    """The inverse of a positive definite matrix by elimination in long double."""
    A, inverse = A.copy(), np.eye(len(A), dtype=A.dtype)
    for j in range(len(A)):
        A[j], inverse[j] = A[j] / A[j, j], inverse[j] / A[j, j]
        ratio = A[:, j].copy()
        ratio[j] = 0.0
        A -= np.outer(ratio, A[j])
        inverse -= np.outer(ratio, inverse[j])
    return inverse


@pytest.mark.parametrize("seed", range(8))
def test_residues_cancel_above_the_stiffest_mode(seed: int) -> None:
    """Where no bushing joins two bodies 1/s^2 and 1/s^4 cancel: 1e-9 to 1e-6 of the terms was left."""
    K, M = bodies_on_bushings(np.random.default_rng([41, seed]), 4)
    modes = solve_all(sp.csr_array(K), sp.csr_array(M))
    assert modes is not None
    X, lam = modes.shapes, modes.lam
    for factor in (2.0, 30.0, 1e3):
        square = factor * lam[-1]
        exact = inverted(K.astype(Fine) + Fine(square) * M.astype(Fine))
        terms = X[:, None, :] * X[None, :, :] / (lam + square)
        error = np.abs(terms.sum(axis=2) - exact) / np.abs(terms).sum(axis=2)
        assert error.max() < 1e-10


@pytest.mark.parametrize("part", [0.0, 1e-12, 1e-6, 1e-3])
def test_stiff_modes_of_nearly_one_frequency_are_parted(part: float) -> None:
    """Two stiff modes whose omega^2 differ by ``part``, beside soft ones."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    stiff = np.array([1.0, 1e8, 1e13, 1e13 * (1.0 + part)])
    K, M = turn * stiff @ turn.T, np.eye(4)
    modes = solve_all(sp.csr_array(K), sp.csr_array(M))
    assert modes is not None
    X, lam = modes.shapes, modes.lam
    np.testing.assert_allclose(X.T @ X, np.eye(4), atol=1e-10)
    np.testing.assert_allclose(X * lam @ X.T, K, atol=1e-14 * stiff[-1])
    np.testing.assert_allclose(lam[2:], stiff[2:], rtol=1e-14)


def test_shapes_of_stiff_modes_beside_nearly_equal_ones_are_orthogonal() -> None:
    """A pair 1e-13 to 0.1 apart with others beside it: what is left of its turn couples to the others."""
    for seed in range(80):
        rng = np.random.default_rng(seed)
        part, count = 10.0 ** rng.uniform(-13.0, -1.0), int(rng.integers(4, 9))
        turn = np.linalg.qr(rng.standard_normal((count, count)))[0]
        beside = 10.0 ** rng.uniform(9.0, 13.0, count - 4)
        stiff = np.concatenate([[1.0, 1e8], beside, [1e13, 1e13 * (1.0 + part)]])
        modes = solve_all(sp.csr_array(turn * stiff @ turn.T), sp.csr_array(np.eye(count)))
        assert modes is not None
        np.testing.assert_allclose(modes.shapes.T @ modes.shapes, np.eye(count), atol=1e-10)
        np.testing.assert_allclose(modes.lam[-2:], np.sort(stiff)[-2:], rtol=1e-13)


@pytest.mark.parametrize("count", [3, 4, 8])
@pytest.mark.parametrize("spread", [0.0, 1e-12, 1e-6])
def test_three_and_more_stiff_modes_of_nearly_one_frequency_are_parted(count: int, spread: float) -> None:
    """As of equal arms on a hub: turned pair by pair at once they came out alike."""
    for seed in range(4):
        rng = np.random.default_rng([count, seed])
        stiff = np.repeat([1.0, 1e13], count) * (1.0 + spread * rng.standard_normal(2 * count))
        turn = np.linalg.qr(rng.standard_normal((2 * count, 2 * count)))[0]
        modes = solve_all(sp.csr_array(turn * stiff @ turn.T), sp.csr_array(np.eye(2 * count)))
        assert modes is not None
        np.testing.assert_allclose(modes.shapes.T @ modes.shapes, np.eye(2 * count), atol=1e-10)
        np.testing.assert_allclose(np.sort(modes.lam)[count:], np.sort(stiff)[count:], rtol=1e-13)
