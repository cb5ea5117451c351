"""Zeros held in the left half-plane: against a search over all of them, where there are few."""

import numpy as np
import pytest

from middeck.study.chapters.two_sensor_control.left_zeros import refit_left

F = np.linspace(0.1, 4.0, 80)
S = 2j * np.pi * F


def least_error(shapes, data):
    """Over paths g * shape with the best real gain g of each."""
    flat, wanted = (np.concatenate([x.real, x.imag], axis=-1) for x in (shapes, data))
    gain = flat @ wanted / np.sum(flat**2, axis=-1)
    return np.min(np.linalg.norm(gain[:, None] * flat - wanted, axis=-1)) / np.linalg.norm(wanted)


def test_one_zero_is_the_best_of_all_left_ones():
    poles = (S + 2.0) * (S**2 + 0.4 * S + 100.0)
    data = (S - 9.0) / poles
    left = np.geomspace(1e-6, 1e9, 4001)
    wanted = least_error((S + left[:, None]) / poles, data)
    # Half a step of the search is 0.4 %, and moves a least error by its square.
    assert refit_left(F, data, data, np.array([9.0 + 0j])) == pytest.approx(wanted, rel=1e-4)
    assert wanted > 0.1


def test_a_pair_may_become_two_real_zeros():
    poles = (S**2 + 0.4 * S + 100.0) * (S**2 + S + 400.0)
    data = (S**2 - 6.0 * S + 200.0) / poles
    a, b = (x.ravel() for x in np.meshgrid(np.geomspace(1e-3, 1e4, 281), np.geomspace(1.0, 1e6, 241)))
    wanted = least_error((S**2 + a[:, None] * S + b[:, None]) / poles, data)
    found = refit_left(F, data, data, np.array([3.0 + 1j * np.sqrt(191.0)]))
    # The search errs by the square of its steps, 3 %; what is fitted is no worse.
    assert wanted * (1.0 - 1e-3) < found <= wanted * (1.0 + 1e-9)


def test_zeros_that_are_left_already_stay():
    data = (S + 3.0) * S / ((S + 2.0) * (S**2 + 0.4 * S + 100.0))
    assert refit_left(F, data, data, np.array([0j, -3.0 + 0j])) < 1e-12
