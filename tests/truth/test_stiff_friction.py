"""Joints with friction beside few modes: right where they are soft, refused where the modes are too few."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.structure.plants.damped_modes import DampedModes
from middeck.updating.residuals.complex_roots import stiffened_roots
from middeck.updating.residuals.friction import Added

COUNT = 13
NUMBERS = np.pi * np.arange(1, COUNT + 1)
"""Of a pinned beam of unit length, stiffness and mass; its modes are sqrt(2) sin(n pi x)."""


def held_at_one_end(stiffness: float) -> complex:
    """The first root with a spring against turning at one end."""
    omega, nothing = NUMBERS**2, np.zeros((COUNT, COUNT))
    damped = DampedModes(1j * omega, np.eye(COUNT, dtype=complex), nothing, nothing)
    spring = Added(
        coordinate=0, row=np.sqrt(2.0) * NUMBERS, stiffness=np.array([stiffness + 0j]), slope=np.zeros((0, 1))
    )
    s, _ = stiffened_roots(damped, np.array([0]), [spring], omega)
    return complex(s[0])


def test_a_soft_joint_raises_the_frequency_by_its_share():
    """Rayleigh: omega^2 grows by k phi'(0)^2, to second order in k."""
    assert abs(held_at_one_end(0.05)) ** 2 == pytest.approx(np.pi**4 + 0.05 * 2.0 * np.pi**2, rel=1e-4)


def test_a_joint_that_sticks_asks_for_more_modes():
    """A clamped end has 15.42; what thirteen modes make of it still moves with the last of them."""
    with pytest.raises(ConfigError, match="too stiff for 13 modes"):
        held_at_one_end(1e6)
