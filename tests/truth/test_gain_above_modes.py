"""A plant's gain above its modes, and stability where a law has poles far above them."""

from __future__ import annotations

import numpy as np
import pytest

import middeck.control.robust.verification.monte_carlo as monte_carlo
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.robust.verification.gain_above_modes import gain_above
from middeck.control.robust.verification.monte_carlo import which_decay
from middeck.systems.plants.plant import delay_plant
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import FORCE, WAY, grouped_plant, sum_of_modes, unit_weights
from repeats import repeats

LATE_S = 2.0


def _modes(rng, modes, lags, ports=2):
    """Light modes of which one output reads the way and one the rate, lags, and a basis of mixed states."""
    omega, n = rng.uniform(0.3, 3.0, modes), 2 * modes + lags
    A, k = np.diag(-rng.uniform(0.3, 3.0, n)), np.arange(modes)
    A[k, k], A[k, modes + k], A[modes + k, k] = 0.0, 1.0, -(omega**2)
    A[modes + k, modes + k] = -2.0 * 0.005 * omega
    B, C = np.zeros((n, ports)), np.zeros((ports, n))
    B[modes:] = rng.standard_normal((n - modes, ports))
    C[0, :modes], C[1, modes:] = rng.standard_normal(modes), rng.standard_normal(n - modes)
    T = np.eye(n) + 0.2 * rng.standard_normal((n, n)) / np.sqrt(n)
    D = 0.01 * rng.standard_normal((ports, ports))
    return StateSpace(T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T), D)


@pytest.mark.parametrize("seed", repeats(range(40), quick=3))
def test_no_gain_above_the_modes_passes_the_bound(seed):
    rng = np.random.default_rng(seed)
    system = _modes(rng, 4, seed % 3)
    top = float(np.abs(np.linalg.eigvals(system.A).imag).max())
    ports = [[type(p)(f"{p.name}{i}", p.unit) for i in range(2)] for p in (FORCE, WAY)]
    plant = delay_plant(grouped_plant(system, tuple(ports[0]), tuple(ports[1])), LATE_S)
    n = len(system.A)
    for low in (top, 1.3 * top):
        omega = np.append(low, low * (1.0 + np.geomspace(1e-4, 1e3, 300)))
        gain = system.C @ np.linalg.solve(1j * omega[:, None, None] * np.eye(n) - system.A, system.B)
        assert np.linalg.norm(gain + system.D, axis=(1, 2)).max() <= gain_above(plant, low)


def test_the_bound_falls_as_the_square_of_frequency_where_a_way_is_read():
    """Residues alone fall as its inverse: at a hundred times the mode's they are a hundred times the gain."""
    plant = grouped_plant(
        StateSpace([[0.0, 1.0], [-1.0, -0.02]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]), (FORCE,), (WAY,)
    )
    assert 1e-4 < gain_above(plant, 100.0) < 1.1e-4


def test_of_poles_that_coincide_no_bound_is_known():
    body = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    assert not gain_above(grouped_plant(body, (FORCE,), (WAY,)), 1.0) < np.inf


def _late_plant():
    """A damped mode, and a light one that hardly moves."""
    modes = sum_of_modes([1.0, 0.5], [0.5, 0.01], [[1.0], [1e-3]], [[1.0, 1e-3]])
    return delay_plant(grouped_plant(modes.as_statespace(), (FORCE,), (WAY,)), LATE_S)


def _law(gain, turn, sign):
    """A pole far above the modes, where the loop has this gain."""
    A = [[0.0, 1.0], [-(turn**2), -0.02 * turn]]
    push = sign * gain * 0.02 * turn * (turn**2 - 1.0)
    return Compensator(StateSpace(A, [[0.0], [push]], [[0.0, 1.0]], [[0.0]]), (WAY,), (FORCE,))


@pytest.mark.parametrize("turn", [11.0, 14.0, 16.0])
def test_phase_decides_above_the_modes_only_where_gain_is_not_small(turn):
    """With an order for the modes alone unstable loops passed for stable, of a gain of 1.3 at 11 rad/s."""
    plant, weights = _late_plant(), unit_weights((FORCE.name,), 1e-4)
    stable = []
    for gain in (0.001, 1.3):
        for sign in (1.0, -1.0):
            law = _law(gain, turn, sign)
            assert monte_carlo._small_above([plant], law.system, turn) == [gain < 1.0]
            stable.append(bool(which_decay([plant], law, weights)[0]))
            assert stable[-1] == decide_stability(plant, law).stable
    assert not all(stable)
