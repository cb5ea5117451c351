"""Pointing budgets against closed forms in time, against samples, and where there is none."""

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.loop.closed_loop import leave_open
from middeck.control.loop.performance import Performance
from middeck.control.loop.pointing import (
    PointingWindow,
    budget_pointing,
    drift_weight,
    mean_weight,
    relative_weight,
)
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace


def loop_of(A, B, C):
    system = StateSpace(A, B, C, np.zeros((len(C), np.shape(B)[1])))
    inputs = tuple(Port(f"w{i}", "N") for i in range(np.shape(B)[1]))
    outputs = tuple(Port(f"z{i}", "rad") for i in range(len(C)))
    w, z = tuple(p.name for p in inputs), tuple(p.name for p in outputs)
    return leave_open(Plant(dynamics=system, inputs=inputs, outputs=outputs, w=w, z=z))


def two_modes():
    A = sla.block_diag(*[np.array([[0.0, w], [-w, -0.1 * w]]) for w in (2.0, 9.0)])
    B = np.array([[0.0], [1.0], [0.0], [2.0]])
    C = np.array([[1.0, 0.0, 0.5, 0.0], [0.0, 0.0, 1.0, 0.0]])
    return A, B, C


def in_time(A, B, C, window):
    """The budget over all frequencies, by integrals of the covariance function R(s) = C exp(A s) X C'."""
    X = sla.solve_continuous_lyapunov(A, -B @ B.T)
    T, tau, n = window.length_s, window.lag_s, len(A)

    def second_integral(t):
        """M(t) C' with M(t) = integral over s of (t - s) exp(A s), twice integrated exponential."""
        inverse = np.linalg.inv(A)
        return inverse @ (inverse @ (sla.expm(A * t) - np.eye(n)) - t * np.eye(n))

    def covariance(k):
        """Of two means, k: V(t) = 2 C M(t) X C' is the variance of an integral over t."""
        return np.diag(C @ second_integral(k) @ X @ C.T)

    absolute = np.diag(C @ X @ C.T)
    mean = 2.0 * covariance(T) / T**2
    # E[m(t) m(t + tau)] = (F(tau + T) - 2 F(tau) + F(tau - T)) / T^2 with F'' = R, F even.
    F = {s: covariance(abs(s)) for s in (tau + T, tau, tau - T)}
    together = (F[tau + T] - 2.0 * F[tau] + F[tau - T]) / T**2
    return np.sqrt([absolute, mean, absolute - mean, 2.0 * (mean - together)])


@pytest.mark.parametrize(
    "window", [PointingWindow(1.0, 4.0), PointingWindow(3.0, 3.0), PointingWindow(0.2, 0.05)]
)
def test_budget_equals_the_covariance_function(window):
    A, B, C = two_modes()
    budget = budget_pointing(loop_of(A, B, C), Performance(np.ones(2), np.eye(1), (0.0, 300.0)), window)
    found = np.array([budget.absolute, budget.mean, budget.relative, budget.drift])
    # Above 300 Hz |G|^2 = 4/w^4 is left out: 1e-9 of the smallest, a drift over 50 ms.
    np.testing.assert_allclose(found, in_time(A, B, C, window), rtol=1e-7)


def test_mean_and_relative_make_the_absolute():
    A, B, C = two_modes()
    budget = budget_pointing(
        loop_of(A, B, C), Performance(np.ones(2), 3.0 * np.eye(1), (0.1, 20.0)), PointingWindow(1.0, 2.0)
    )
    # Three integrals, each to 1e-12.
    np.testing.assert_allclose(budget.mean**2 + budget.relative**2, budget.absolute**2, rtol=1e-10)


def test_weights_are_those_of_a_sine():
    # A sine of any phase: variances of its window mean, of what is left, of the difference of two means.
    window, f = PointingWindow(0.7, 1.9), 1.3
    phase = 2.0 * np.pi * (np.arange(64) + 0.5) / 64
    a, b = 2.0 * np.pi * f * window.length_s, 2.0 * np.pi * f * window.lag_s
    mean = (np.cos(phase) - np.cos(phase + a)) / a
    later = (np.cos(phase + b) - np.cos(phase + b + a)) / a
    # Averages over 64 equidistant phases are exact for second harmonics.
    assert np.mean(mean**2) / 0.5 == pytest.approx(mean_weight(np.array([f]), window)[0], rel=1e-13)
    assert np.mean((later - mean) ** 2) / 0.5 == pytest.approx(
        drift_weight(np.array([f]), window)[0], rel=1e-13
    )
    square = 0.5 - (np.sin(2.0 * (phase + a)) - np.sin(2.0 * phase)) / (4.0 * a)
    assert np.mean(square - mean**2) / 0.5 == pytest.approx(
        relative_weight(np.array([f]), window)[0], rel=1e-12
    )


def test_the_series_meets_the_difference():
    edge = np.sqrt(1e-2) / np.pi * np.array([1.0 - 1e-9, 1.0 + 1e-9])
    low, high = relative_weight(edge, PointingWindow(1.0, 1.0))
    # The first term left out is x^8 / 14175 of x^2 / 3: 4e-10 times 1e-6; the difference cancels 3e-14.
    assert low == pytest.approx(high, rel=1e-8)


def test_an_unstable_loop_has_no_budget():
    budget = budget_pointing(
        loop_of([[0.1]], [[1.0]], [[1.0]]),
        Performance(np.ones(1), np.eye(1), (0.1, 1.0)),
        PointingWindow(1.0, 1.0),
    )
    assert all(x[0] == np.inf for x in (budget.absolute, budget.mean, budget.relative, budget.drift))


def test_a_random_walk_has_no_mean_but_a_jitter_and_a_drift():
    # Of a walk of unit rate: tau - T/3 and T/6; beyond f2 each lacks the integral of 2 a weight / (2 pi f)^2,
    # 1/(2 pi^2 f2) under the weight one, and of the order of f2^-3 under sinc^2.
    window, f2 = PointingWindow(0.5, 2.0), 200.0
    budget = budget_pointing(
        loop_of([[0.0]], [[1.0]], [[1.0]]), Performance(np.ones(1), np.eye(1), (0.0, f2)), window
    )
    assert budget.absolute[0] == budget.mean[0] == np.inf
    assert budget.drift[0] ** 2 == pytest.approx(2.0 - 0.5 / 3.0, rel=1e-7)
    assert budget.relative[0] ** 2 == pytest.approx(0.5 / 6.0 - 1.0 / (2.0 * np.pi**2 * f2), rel=1e-6)


@pytest.mark.parametrize(
    ("A", "B"), [([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), ([[0.0, 9.0], [-9.0, 0.0]], [[0.0], [1.0]])]
)
def test_what_diverges_is_infinite(A, B):
    # A free mass has a rate that walks; an undamped mode in the band no spectrum at all.
    budget = budget_pointing(
        loop_of(A, B, [[1.0, 0.0]]), Performance(np.ones(1), np.eye(1), (0.0, 20.0)), PointingWindow(0.5, 2.0)
    )
    assert all(x[0] == np.inf for x in (budget.absolute, budget.mean, budget.relative, budget.drift))


def test_windows_without_sense_are_refused():
    with pytest.raises(ConfigError, match="window"):
        PointingWindow(0.0, 1.0)
    with pytest.raises(ConfigError, match="periods"):
        budget_pointing(
            loop_of(*two_modes()), Performance(np.ones(2), np.eye(1), (0.1, 60.0)), PointingWindow(1e4, 1.0)
        )
