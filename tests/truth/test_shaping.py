"""Sections against their transfer functions, written out."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.control.law.compensator import Compensator, evaluate_compensator
from middeck.control.shaping.leads_and_notches import (
    roll_off,
    second_order_section,
    shape_compensator,
)
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.poles.resolvent import by_solving
from middeck.systems.state_space.statespace import StateSpace, gain_system, poles

HZ = np.geomspace(0.01, 1000.0, 60)
S = 2j * np.pi * HZ


def _response(system: StateSpace) -> np.ndarray:
    # By solving: a sum over poles knows a response relative to its largest, not 1e-10 down a slope.
    return by_solving(system)(S)[:, 0, 0]


@pytest.mark.parametrize(("zero", "pole"), [(8.0, 10.0), (10.0, 8.0), (9.0, 9.0)])
def test_second_order_section_is_its_transfer_function(zero: float, pole: float) -> None:
    wz, wp = 2.0 * np.pi * zero, 2.0 * np.pi * pole
    expected = (wp / wz) ** 2 * (S**2 + 0.02 * wz * S + wz**2) / (S**2 + 0.06 * wp * S + wp**2)
    np.testing.assert_allclose(_response(second_order_section(zero, 0.01, pole, 0.03)), expected, rtol=1e-10)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 7])
def test_roll_off_is_butterworths(order: int) -> None:
    expected = 1.0 / np.sqrt(1.0 + (HZ / 20.0) ** (2 * order))
    np.testing.assert_allclose(np.abs(_response(roll_off(20.0, order))), expected, rtol=1e-9)
    assert np.all(poles(roll_off(20.0, order)).real < 0.0)


def test_shaping_multiplies_every_output() -> None:
    ports = (Port("a", "rad"), Port("b", "rad")), (Port("t", "N m"), Port("f", "N"))
    law = Compensator(gain_system(np.array([[1.0, 2.0], [3.0, 4.0]])), *ports)
    lead = second_order_section(8.0, 0.02, 10.0, 0.02)
    shaped = evaluate_compensator(shape_compensator(law, lead), HZ).H
    np.testing.assert_allclose(shaped, law.system.D * _response(lead)[:, None, None], rtol=1e-12)


def test_impossible_sections_are_refused() -> None:
    with pytest.raises(ConfigError, match="poles that decay"):
        second_order_section(8.0, 0.02, 10.0, 0.0)
    with pytest.raises(ConfigError, match="positive"):
        roll_off(10.0, 0)
    with pytest.raises(ConfigError, match="one of each"):
        shape_compensator(
            Compensator(gain_system(np.eye(1)), (Port("a", "rad"),), (Port("t", "N m"),)),
            gain_system(np.eye(2)),
        )
