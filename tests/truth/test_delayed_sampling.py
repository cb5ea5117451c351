"""Sampled equivalents with a delay for each path: against the step response at the sampling instants."""

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.errors import ConfigError
from middeck.systems.plants.response import statespace_response
from middeck.systems.sampling.delayed_sampling import sample_delayed, split_delays
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.statespace import StateSpace

T = 0.05
A = sla.block_diag([[-0.1, -6.0], [6.0, -0.1]], [[-0.5, -20.0], [20.0, -0.5]])


def a_system(inputs, outputs, rng):
    normal = rng.standard_normal
    return StateSpace(A, normal((4, inputs)), normal((outputs, 4)), normal((outputs, inputs)))


def step_response(system, t):
    """C A^-1 (exp(A t) - 1) B + D from t = 0 on, zero before."""
    if t < -1e-9 * T:
        return np.zeros(system.D.shape)
    x = np.linalg.solve(system.A, (sla.expm(system.A * t) - np.eye(4)) @ system.B)
    return system.C @ x + system.D


DELAYS = {
    "none": lambda rng, p, m: np.zeros((p, m)),
    "one for all": lambda rng, p, m: np.full((p, m), 0.2 * rng.random()),
    "whole samples": lambda rng, p, m: np.round(4.0 * rng.random((p, 1))) * T + np.zeros((1, m)),
    "inputs and outputs": lambda rng, p, m: 0.2 * rng.random((p, 1)) + 0.2 * rng.random((1, m)),
    "every path": lambda rng, p, m: 0.3 * rng.random((p, m)),
}


@pytest.mark.parametrize("kind", DELAYS)
@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (1, 3), (3, 1), (2, 3), (3, 2)])
def test_steps_are_met_at_every_sample(kind, inputs, outputs):
    rng = np.random.default_rng([inputs, outputs])
    system, delay_s = a_system(inputs, outputs, rng), DELAYS[kind](rng, outputs, inputs)
    sampled = sample_delayed(system, T, delay_s)
    for i in range(inputs):
        u = np.zeros((30, inputs))
        u[:, i] = 1.0
        y, _ = simulate(sampled, u)
        expected = [
            [step_response(system, k * T - delay_s[o, i])[o, i] for o in range(outputs)] for k in range(30)
        ]
        # Rounding of some ten exponentials.
        np.testing.assert_allclose(y, expected, atol=1e-12 * np.abs(expected).max() * 10)


def test_one_path_is_that_of_sample_plant():
    system = a_system(1, 1, np.random.default_rng(3))
    f = np.geomspace(0.1, 9.0, 50) * 2.0 * np.pi
    for delay_s in (0.0, 0.02, 0.05, 0.23):
        ours = sample_delayed(system, T, np.array([[delay_s]]))
        theirs = sample_dynamics(system, T, delay_s)
        assert ours.A.shape == theirs.A.shape
        # Rounding near resonances of 0.5 %.
        np.testing.assert_allclose(
            statespace_response(ours, f), statespace_response(theirs, f), rtol=1e-10, atol=1e-12
        )


@pytest.mark.parametrize(
    ("delay_ms", "inputs", "states"),
    [
        # The study's three sensors at 500 Hz: the latest path has 7.25 periods, and one input holds them all.
        ([10.0, 10.0, 14.5], 1, 8),
        # Two inputs: five past values of each and three of the late output (all at the inputs: sixteen).
        ([10.0, 10.0, 14.5], 2, 5 + 5 + 3),
        # One late output of three inputs waits as one output, not as three inputs.
        ([10.0], 3, 5),
        ([0.0, 0.0, 0.0], 2, 0),
    ],
)
def test_needs_few_states(delay_ms, inputs, states):
    system = a_system(inputs, len(delay_ms), np.random.default_rng(0))
    delay_s = 1e-3 * np.array(delay_ms)[:, None] + np.zeros((1, inputs))
    assert len(sample_delayed(system, 0.002, delay_s).A) == 4 + states


def test_stays_stable_whatever_the_delay():
    """Outputs are looked ahead for, never back: a fast pole is never run backwards."""
    fast = StateSpace(np.diag([-1.0, -1e5]), np.ones((2, 1)), np.ones((2, 2)), np.zeros((2, 1)))
    sampled = sample_delayed(fast, 0.01, np.array([[0.013], [0.042]]))
    assert np.abs(np.linalg.eigvals(sampled.A)).max() < 1.0
    assert np.abs(sampled.A).max() <= 1.0 + 1e-12


def test_splits_what_can_be_split():
    rng = np.random.default_rng(1)
    a, b = rng.random(4), rng.random(3)
    split = split_delays(b[:, None] + a)
    np.testing.assert_allclose(split.rest_s, 0.0, atol=1e-15)
    np.testing.assert_allclose(split.output_s[:, None] + split.input_s, b[:, None] + a, atol=1e-15)
    assert split.input_s.min() == 0.0
    whole = rng.random((3, 4))
    again = split_delays(whole)
    assert min(part.min() for part in (again.rest_s, again.input_s, again.output_s)) >= 0.0


@pytest.mark.parametrize(
    ("period_s", "delay_s"),
    [(0.0, [[0.1]]), (np.nan, [[0.1]]), (0.1, [[-0.1]]), (0.1, [[np.inf]]), (0.1, [[0.1, 0.2]])],
)
def test_refuses_what_cannot_be_sampled(period_s, delay_s):
    with pytest.raises(ConfigError):
        sample_delayed(a_system(1, 1, np.random.default_rng(0)), period_s, np.array(delay_s))
