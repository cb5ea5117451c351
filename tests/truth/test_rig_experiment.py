"""The drift that breaks a controller: `shift_modes`, and the verdict against eigenvalues made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.realtime.rig import build_linear_rig, close_sampled_loop
from middeck.study.rig_experiment import shift_modes
from middeck.systems.modal import ModalSystem
from middeck.systems.plant import Plant
from middeck.systems.ports import Port
from middeck.systems.sampling import tustin
from middeck.systems.stability import is_stable
from middeck.systems.statespace import StateSpace

SAMPLE_HZ = 4000.0  # so fast that hold and Tustin's rule turn the phase at 9 Hz by half a degree only
ZETA = 0.003
FILTER_HZ, FILTER_ZETA = 9.0, 0.05


def plant_of(frequency_hz: tuple[float, ...], sign: tuple[float, ...]) -> Plant:
    """Unit modes from a torque to an angle, residues of the given signs."""
    count = len(frequency_hz)
    modal = ModalSystem(
        2.0 * np.pi * np.array(frequency_hz),
        np.full(count, ZETA),
        np.ones((count, 1)),
        np.array([sign]),
        np.zeros((1, count)),
        tuple(f"mode {k}" for k in range(count)),
    )
    return Plant(modal, (Port("u", "N m"),), (Port("y", "rad"),), ("u",), ("u",), ("y",), ("y",))


@pytest.mark.parametrize(("near", "moved"), [(9.0, {1, 2}), (1.0, {0, 1}), (30.0, {2, 3})])
def test_only_the_two_nearest_modes_move(near: float, moved: set[int]) -> None:
    plant = plant_of((1.0, 8.5, 9.4, 30.0), (1.0, -1.0, 1.0, 1.0))
    shifted = shift_modes(plant, near, 1.02)
    factor = np.array([1.02 if k in moved else 1.0 for k in range(4)])
    assert isinstance(shifted.dynamics, ModalSystem)
    assert isinstance(plant.dynamics, ModalSystem)
    np.testing.assert_array_equal(shifted.dynamics.omega, plant.dynamics.omega * factor)
    back = dataclasses.replace(shifted.dynamics, omega=plant.dynamics.omega)
    assert dataclasses.replace(shifted, dynamics=back) == plant


def between_the_pair(gain: float) -> StateSpace:
    """K = -gain s w^2 / (s^2 + 2 z w s + w^2): rate feedback, whose sign turns over at `FILTER_HZ`.

    It damps a mode of positive residue below and one of negative residue above; past it, it drives them.
    """
    w = 2.0 * np.pi * FILTER_HZ
    A = np.array([[0.0, 1.0], [-w * w, -2.0 * FILTER_ZETA * w]])
    return StateSpace(A, np.array([[0.0], [1.0]]), np.array([[0.0, -gain * w * w]]), np.zeros((1, 1)))


def growth_by_hand(frequency_hz: tuple[float, ...], sign: tuple[float, ...], law: StateSpace) -> float:
    """Largest real part of q_k'' + 2 z w_k q_k' + w_k^2 q_k = K sum(sign q), continuous and without delay."""
    n = len(frequency_hz)
    w = 2.0 * np.pi * np.array(frequency_hz)
    A = np.zeros((2 * n + 2, 2 * n + 2))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -np.diag(w**2)
    A[n : 2 * n, n : 2 * n] = -np.diag(2.0 * ZETA * w)
    A[n : 2 * n, 2 * n :] = np.ones((n, 1)) @ law.C
    A[2 * n :, :n] = law.B @ np.array([sign])
    A[2 * n :, 2 * n :] = law.A
    return float(np.linalg.eigvals(A).real.max())


@pytest.mark.parametrize(
    ("gain", "percent", "survives"),
    [
        (0.15, 0.0, True),
        (0.15, 8.0, False),
        (0.15, -8.0, False),
        (0.005, 8.0, True),
        (0.005, -8.0, True),
    ],
)
def test_the_verdict_is_that_of_the_eigenvalues(gain: float, percent: float, survives: bool) -> None:
    pair, sign = (8.5, 9.5), (1.0, -1.0)
    law = between_the_pair(gain)
    factor = 1.0 + percent / 100.0
    growth = growth_by_hand((pair[0] * factor, pair[1] * factor), sign, law)
    assert (growth < 0.0) == survives
    # The phase turned by sampling moves an eigenvalue by less than a hundredth of its distance to the open
    # loop's, some 0.01 rad/s: ten times less than what is asked for here.
    assert abs(growth) > 0.1
    rig = build_linear_rig(
        shift_modes(plant_of(pair, sign), 9.0, factor),
        sample_hz=SAMPLE_HZ,
        delay_s=0.5 / SAMPLE_HZ,
        noise_rms=np.zeros(1),
    )
    assert is_stable(close_sampled_loop(rig.sampled, tustin(law, 1.0 / SAMPLE_HZ))) == survives
