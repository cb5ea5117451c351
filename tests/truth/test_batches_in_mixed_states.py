"""Verdicts on many loops at once in mixed states: those of the loop's own states, or said to be open."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy.linalg as sla
from test_verdicts_in_mixed_states import _loop, _mixed

from middeck.control.robust.verification.many_loops import close_many, decide_many, measure_many
from middeck.systems.state_space.statespace import StateSpace

pytestmark = pytest.mark.kernels


def _together(plant: StateSpace, law: StateSpace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    A, B, C = (np.repeat(M[None], 4, 0) for M in (plant.A, plant.B, plant.C))
    return close_many(A, (B, B), (C, C), law)


def _lags(rng: np.random.Generator) -> StateSpace:
    """A law of equal lags in series: a pole that repeats up to six times."""
    n, p = int(rng.integers(2, 7)), 10.0 ** rng.uniform(-1.0, 1.0)
    A = p * (np.diag(np.ones(n - 1), -1) - np.eye(n))
    return StateSpace(A, p * np.eye(n)[:, :1], 0.1 * rng.standard_normal() * np.eye(n)[-1:], np.zeros((1, 1)))


def _optimal(rng: np.random.Generator) -> tuple[StateSpace, StateSpace]:
    """Light modes, two of them alike, under LQG of little authority: every pole nearly repeats."""
    m = int(rng.integers(2, 6))
    w, z = 10.0 ** rng.uniform(-1.0, 1.5, m), 10.0 ** rng.uniform(-3.0, -1.0, m)
    A = sla.block_diag(*[[[0.0, 1.0], [-(a**2), -2.0 * b * a]] for a, b in zip(w, z, strict=True)])
    B = np.kron(rng.standard_normal((m, 1)), [[0.0], [1.0]])
    C = np.kron(rng.standard_normal((1, m)), [[1.0, 0.0]])
    X = sla.solve_continuous_are(A, B, C.T @ C, np.eye(1) * 1e2)
    Y = sla.solve_continuous_are(A.T, C.T, B @ B.T, np.eye(1) * 1e2)
    K, L = B.T @ X / 1e2, Y @ C.T / 1e2
    none = np.zeros((1, 1))
    return StateSpace(A, B, C, none), StateSpace(A - B @ K - L @ C, L, -K, none)


def test_no_verdict_on_many_loops_is_silently_wrong(campaign) -> None:
    """At 1e8 fifteen of eighty were. An rms is not wrong by more than ten times the error that it states."""
    known = warned = 0
    for seed in campaign(80):
        rng = np.random.default_rng([79, seed])
        plant, law = _loop(rng, free=0)
        for halves in ((plant.continuous, law.system), (plant.continuous, _lags(rng)), _optimal(rng)):
            own = measure_many(*_together(*halves))
            assert own.stable[0] == (np.linalg.eigvals(_together(*halves)[0][0]).real.max() < 0.0)
            for condition in (1e2, 1e4, 1e7, 1e8, 1e10, 1e12):
                which = rng.integers(2)
                mixed = [_mixed(s, condition, rng) if i == which else s for i, s in enumerate(halves)]
                stacks = _together(*mixed)
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always")
                    found, decided = measure_many(*stacks), decide_many(stacks[0])
                if caught:
                    assert np.array_equal(found.stable, decided), (seed, condition)
                    warned += condition < 1e7
                    continue
                known += condition < 1e7
                assert np.array_equal(found.stable, own.stable), (seed, condition)
                assert np.array_equal(decided, own.stable), (seed, condition)
                if own.stable[0]:
                    off = np.abs(found.rms / own.rms - 1.0)
                    assert np.all(off < np.maximum(10.0 * found.error, 1e-6)), (seed, condition)
    assert warned <= 0.02 * known
