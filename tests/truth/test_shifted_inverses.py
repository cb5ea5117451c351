"""Inverses from what loops share, against LAPACK; the error of a sum as rows tell it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.h2.closed_cost import Law
from middeck.control.robust.verification.many_loops import close_many, measure_many
from middeck.control.robust.verification.shifted_inverses import find_parts, invert_turned
from middeck.control.robust.verification.single_loop import measure_one
from middeck.control.robust.verification.squaring import _gap, _probes


def _plants(rng, count, blocks):
    """Light modes, of 1 to 3 states each, every loop's own."""
    n = sum(blocks)
    A, first = np.zeros((count, n, n)), 0
    for size in blocks:
        own = slice(first, first + size)
        turn = np.cross(np.eye(3), [0.3, 1.0, 0.5])[:size, :size] * rng.uniform(1.0, 9.0)
        A[:, own, own] = turn * rng.uniform(0.97, 1.03, (count, 1, 1)) - 0.05 * np.eye(size)
        first += size
    return A


def _loops(kind, seed=0, count=20):
    rng = np.random.default_rng(seed)
    A = _plants(rng, count, {"pairs": [2] * 5, "sizes": [1, 3, 2, 1, 3], "one": [1]}.get(kind, [2] * 5))
    n = A.shape[1]
    B, C = 0.3 * rng.standard_normal((count, n, 2)), 0.3 * rng.standard_normal((count, 2, n))
    if kind == "dense":
        T = np.eye(n) + 0.2 * rng.standard_normal((n, n))
        A = T @ A @ np.linalg.inv(T)
    if kind == "first without":
        B[0] = 0.0
    if kind == "first with one":
        B[0, :, 1] = 0.0
    own = rng.standard_normal((n, n)) / np.sqrt(n) - 3.0 * np.eye(n)
    law = Law(own, rng.standard_normal((n, 2)), rng.standard_normal((2, n)))
    return close_many(A, (B, B), (C, C), law)


KINDS = ["pairs", "sizes", "one", "dense", "first without", "first with one"]


@pytest.mark.parametrize("kind", KINDS)
def test_inverses_from_parts_are_those_of_lapack(kind):
    A = _loops(kind)[0]
    parts = find_parts(A, np.ones(A.shape[1]), 3.0)
    assert parts is not None
    moved, turned = A - 3.0 * np.eye(A.shape[1]), np.empty_like(A)
    invert_turned(moved, parts, turned)
    true = np.linalg.inv(moved)
    shared = slice(0, None) if "first" not in kind else slice(0, 1)  # what the first lacks, no part has
    np.testing.assert_allclose(turned.swapaxes(1, 2)[shared], true[shared], atol=1e-11 * np.abs(true).max())


@pytest.mark.parametrize("kind", KINDS)
def test_loops_of_shared_parts_are_those_of_one_loop(kind):
    A, B, C = _loops(kind, seed=1)
    found = measure_many(A, B, C)
    assert not found.alone[1:].any()
    for i in range(len(A)):
        stable, rms, _, _ = measure_one(A[i], B[i], C[i])
        assert found.stable[i] == stable
        np.testing.assert_allclose(found.rms[i], rms, rtol=1e-9)


def test_loops_without_a_shared_block_have_no_parts():
    A = np.random.default_rng(0).standard_normal((3, 4, 4))
    assert find_parts(A, np.ones(4), 3.0) is None


def test_a_wrong_sum_is_seen():
    rng, n = np.random.default_rng(5), 6
    A, B = rng.standard_normal((n, n)) - 4.0 * np.eye(n), rng.standard_normal((n, 2))
    M = np.linalg.solve(A - 2.0 * np.eye(n), A + 2.0 * np.eye(n))
    X, P = sla.solve_continuous_lyapunov(A, -B @ B.T), np.linalg.matrix_power(M, 4)
    probes, Y = _probes(n), X - P @ X @ P.T
    assert np.abs(_gap(P, Y, A, B, probes)).max() < 1e-12
    wrong = rng.standard_normal((n, n))
    wrong = 1e-3 * (wrong + wrong.T)
    Z = wrong + P @ wrong @ P.T
    reported = np.array([v @ (A @ Z + Z @ A.T) @ v for v in probes])
    np.testing.assert_allclose(_gap(P, Y + wrong, A, B, probes), reported, atol=1e-12)
    assert np.abs(reported).min() > 1e-4
