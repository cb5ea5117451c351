"""Joints with friction beside few modes: right where they are soft, refused where the modes are too few."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.updating.residuals.own_articles import check_spare, own_articles
from middeck.updating.residuals.surveyed_friction import Added

COUNT = 13
NUMBERS = np.pi * np.arange(1, COUNT + 1)
"""Of a pinned beam of unit length, stiffness and mass; its modes are sqrt(2) sin(n pi x)."""


@dataclass
class BeamModes:
    """What of `Modes` is asked for."""

    omega: np.ndarray
    shapes: np.ndarray
    kind: tuple[str, ...] = ("flexible",) * COUNT
    name: tuple[str, ...] = ("bending",) * COUNT
    stated_name: tuple[str, ...] = ()
    rigid_share: np.ndarray = field(default_factory=NUMBERS.copy)
    strain_share: np.ndarray = field(default_factory=NUMBERS.copy)
    residual: np.ndarray = field(default_factory=NUMBERS.copy)

    @property
    def frequency_hz(self) -> np.ndarray:
        return self.omega / (2.0 * np.pi)


def held_at_one_end(stiffness: float) -> float:
    """The first frequency with a spring against turning at one end."""
    free: Any = BeamModes(NUMBERS**2, np.eye(COUNT))
    spring = Added(
        coordinate=0, row=np.sqrt(2.0) * NUMBERS, stiffness=np.array([stiffness + 0j]), slope=np.zeros((0, 1))
    )
    own = own_articles(free, COUNT, [spring])
    check_spare(free.omega, own, np.array([[0, 0]]), [spring])
    return float(own.modes.omega[0])


def test_a_soft_joint_raises_the_frequency_by_its_share():
    """Rayleigh: omega^2 grows by k phi'(0)^2, to second order in k."""
    assert held_at_one_end(0.05) ** 2 == pytest.approx(np.pi**4 + 0.05 * 2.0 * np.pi**2, rel=1e-4)


def test_a_joint_that_sticks_asks_for_more_modes():
    """A clamped end has 15.42; what thirteen modes make of it still moves with the last of them."""
    with pytest.raises(ConfigError, match="too stiff for 13 modes"):
        held_at_one_end(1e6)
