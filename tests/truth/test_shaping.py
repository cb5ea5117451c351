"""Sections against their transfer functions, written out."""

from __future__ import annotations

import mace_like
import numpy as np
import pytest

from middeck.control.law.compensator import Compensator, evaluate_compensator
from middeck.control.law.pd_loops import close_inner_loop
from middeck.control.loop.closed_loop import close_loop
from middeck.control.shaping.sections import (
    design_pd,
    first_order_section,
    notch,
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


@pytest.mark.parametrize(("zero", "pole"), [(1.0, 10.0), (10.0, 1.0)])
def test_first_order_section_is_its_transfer_function(zero: float, pole: float) -> None:
    expected = (1.0 + S / (2.0 * np.pi * zero)) / (1.0 + S / (2.0 * np.pi * pole))
    np.testing.assert_allclose(_response(first_order_section(zero, pole)), expected, rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 7])
def test_roll_off_is_butterworths(order: int) -> None:
    expected = 1.0 / np.sqrt(1.0 + (HZ / 20.0) ** (2 * order))
    np.testing.assert_allclose(np.abs(_response(roll_off(20.0, order))), expected, rtol=1e-9)
    assert np.all(poles(roll_off(20.0, order)).real < 0.0)


def test_a_notch_leaves_the_rest_alone() -> None:
    dip = np.abs(_response(notch(9.0, 0.05, 0.1)))
    assert dip[0] == pytest.approx(1.0, abs=1e-6)
    assert dip[-1] == pytest.approx(1.0, abs=1e-5)


def test_shaping_multiplies_every_output() -> None:
    ports = (Port("a", "rad"), Port("b", "rad")), (Port("t", "N m"), Port("f", "N"))
    law = Compensator(gain_system(np.array([[1.0, 2.0], [3.0, 4.0]])), *ports)
    lead = second_order_section(8.0, 0.02, 10.0, 0.02)
    shaped = evaluate_compensator(shape_compensator(law, lead), HZ).H
    np.testing.assert_allclose(shaped, law.system.D * _response(lead)[:, None, None], rtol=1e-12)


def test_impossible_sections_are_refused() -> None:
    with pytest.raises(ConfigError, match="poles that decay"):
        second_order_section(8.0, 0.02, 10.0, 0.0)
    with pytest.raises(ConfigError, match="depth"):
        notch(9.0, 1.5, 0.1)
    with pytest.raises(ConfigError, match="positive"):
        first_order_section(0.0, 1.0)
    with pytest.raises(ConfigError, match="positive"):
        roll_off(10.0, 0)
    with pytest.raises(ConfigError, match="one of each"):
        shape_compensator(
            Compensator(gain_system(np.eye(1)), (Port("a", "rad"),), (Port("t", "N m"),)),
            gain_system(np.eye(2)),
        )


@pytest.mark.parametrize("order", [1, 2, 3])
def test_pd_with_roll_off_is_its_transfer_function(order: int) -> None:
    plant = mace_like.build("orbit")
    pd = mace_like.pd_loops()
    law = design_pd(plant, pd, 20.0, order=order)
    H = evaluate_compensator(law, HZ).H
    want = -(pd.kp + pd.kd * S[:, None]) * _response(roll_off(20.0, order))[:, None]
    # One product of a sum: rounding of a few terms, relative to the larger of them.
    np.testing.assert_allclose(np.einsum("lii->li", H), want, rtol=1e-11)
    assert np.count_nonzero(H[0]) == len(pd.names)
    assert np.any(law.system.D) == (order == 1)


def test_pd_with_roll_off_holds_the_rigid_modes_as_the_ideal_one_does() -> None:
    plant = mace_like.build("orbit")
    loop = close_loop(plant, design_pd(plant, mace_like.pd_loops(), 50.0))
    ideal = close_inner_loop(plant, mace_like.pd_loops()).system
    slow = [np.sort(np.abs(p[np.abs(p) < 1.0])) for p in (loop.poles, poles(ideal))]
    # 0.03 to 0.08 Hz below 50 Hz: the roll-off turns the phase by up to 2e-3.
    np.testing.assert_allclose(*slow, rtol=5e-3)
