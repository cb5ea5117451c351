"""The delay between a model and a measured response, beside deep zeros whose phase is noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.study.chapters.gravity_responses.computation import phase_gap
from middeck.systems.plants.own_plant import make_plant
from middeck.systems.plants.response import evaluate_plant

DELAY_S, NOISE = 0.013, 1e-2


@pytest.mark.parametrize("seed", range(4))
def test_noise_in_deep_zeros_adds_no_turn(seed: int):
    """Two modes with a zero between them 80 dB below their peaks, where noise turns the phase at random."""
    omega, zeta = 2.0 * np.pi * np.array([6.0, 12.0]), 1e-3
    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, :2], A[2:, 2:] = np.eye(2), -np.diag(omega**2), -2.0 * zeta * np.diag(omega)
    B, C = np.array([[0.0], [0.0], [1.0], [1.0]]), np.array([[0.0, 0.0, 1.0, 1.0]])
    plant = make_plant(A, B, C)
    response = evaluate_plant(plant, np.arange(5.0, 30.0, 1.0 / 64.0))
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((2, *response.H.shape)) * NOISE * np.abs(response.H).max() * 1e-2
    late = response.H * np.exp(-2j * np.pi * response.frequency_hz * DELAY_S)[:, None, None]
    measured = dataclasses.replace(response, H=late + noise[0] + 1j * noise[1])
    assert phase_gap(plant, measured) == pytest.approx([DELAY_S], abs=2e-5)
