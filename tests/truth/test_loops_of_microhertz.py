"""Loops so slow that they decay by less than what counts as growth: their rms is that of their equations."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.control.law.compensator import Compensator
from middeck.systems.poles.stability import all_decay
from middeck.systems.state_space.statespace import StateSpace


@pytest.mark.parametrize("omega", [1.0, 1e-3, 1e-6, 3e-7])
def test_a_slow_loop_that_decays_has_a_finite_rms(omega: float) -> None:
    """x'' + (d + k) x' + omega^2 x = w - k v has the mean square (S + k^2 R) / (2 (d + k) omega^2)."""
    d, k, S, R = 0.004 * omega, 0.006 * omega, 2.0, 3.0 / omega**2
    A, B = [[0.0, 1.0], [-(omega**2), -d]], [[0.0, 0.0], [1.0, 1.0]]
    plant = md.make_plant(
        A, B, [[1.0, 0.0], [0.0, 1.0]], inputs=["w [N]", "u [N]"], outputs=["z [m]", "y [m/s]"],
        w=["w"], u=["u"], z=["z"], y=["y"],
    )  # fmt: skip
    rate = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[-k]]))
    law = Compensator(rate, plant.outputs[1:], plant.inputs[1:])
    quiet = md.LQGWeights(output=[1.0], input=[1.0], disturbed=("w",), process=[[S]], sensor=[1e-9 * R])
    found = md.measure_noise_rms(plant, law, quiet)
    assert found.rms == pytest.approx(np.sqrt((S + 1e-9 * k**2 * R) / (2.0 * (d + k) * omega**2)), rel=1e-6)


def test_growth_and_rounding_about_zero_are_no_decay() -> None:
    assert not all_decay(np.array([-1e-6 + 1e-6j, 3e-9 + 1e-6j]))
    assert not all_decay(np.array([-1e-17 + 0j, -1e-15 + 0j]))
    assert not all_decay(np.array([-1.0 + 0j, -3e-9 + 0j]))


@pytest.mark.parametrize(("period_s", "omega"), [(1e-3, 1e-4), (0.02, 1e-4), (1.0, 1e-6)])
def test_an_integrator_of_a_slow_sampled_loop_does_not_decay(period_s: float, omega: float) -> None:
    """States mixed by 100 move it by a hundred roundings: 57 of 300 were said to decay."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        A = np.diag([0.0, *-rng.uniform(0.1, 1.0, 4)]) + np.diag(rng.standard_normal(4), 1)
        turned, _ = np.linalg.qr(rng.standard_normal((5, 5)))
        mixed = turned * np.geomspace(1.0, 100.0, 5) @ np.linalg.qr(rng.standard_normal((5, 5)))[0]
        z = np.linalg.eigvals(mixed @ scipy.linalg.expm(omega * period_s * A) @ np.linalg.inv(mixed))
        assert not all_decay(np.log(z.astype(complex)) / period_s, period_s)


def test_a_slow_sampled_loop_that_decays_does() -> None:
    assert all_decay(np.array([-3e-9 + 3e-7j, -3e-9 - 3e-7j]), 0.1)
