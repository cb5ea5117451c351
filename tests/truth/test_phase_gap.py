"""The delay between a model and a measured response, beside deep zeros whose phase is noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.study.chapters.gravity_responses.computation import phase_gap
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.plants.response import FrequencyResponse, evaluate_plant

DELAY_S, NOISE = 0.013, 1e-2


def two_modes() -> Plant:
    """With a zero between them, 80 dB below their peaks."""
    omega, zeta = 2.0 * np.pi * np.array([6.0, 12.0]), 1e-3
    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, :2], A[2:, 2:] = np.eye(2), -np.diag(omega**2), -2.0 * zeta * np.diag(omega)
    return make_plant(A, np.array([[0.0], [0.0], [1.0], [1.0]]), np.array([[0.0, 0.0, 1.0, 1.0]]))


def later(response: FrequencyResponse) -> np.ndarray:
    return response.H * np.exp(-2j * np.pi * response.frequency_hz * DELAY_S)[:, None, None]


@pytest.mark.parametrize("seed", range(4))
def test_noise_in_deep_zeros_adds_no_turn(seed: int):
    """In the zero it turns the phase at random."""
    plant = two_modes()
    response = evaluate_plant(plant, np.arange(5.0, 30.0, 1.0 / 64.0))
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((2, *response.H.shape)) * NOISE * np.abs(response.H).max() * 1e-2
    measured = dataclasses.replace(response, H=later(response) + noise[0] + 1j * noise[1])
    assert phase_gap(plant, measured) == pytest.approx([DELAY_S], abs=2e-5)


@pytest.mark.parametrize("step_hz", [0.5, 1.0, 2.0, 6.0, 100.0])
def test_coarse_lines_or_one_tell_the_shortest_delay(step_hz):
    """On lines a step apart a delay of 1/step more is the same; with two peaks, nearly so at their period."""
    plant = two_modes()
    response = evaluate_plant(plant, np.arange(6.0, 40.0, step_hz))
    measured = dataclasses.replace(response, H=later(response))
    assert phase_gap(plant, measured) == pytest.approx([DELAY_S], abs=1e-9)
