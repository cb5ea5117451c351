"""Delayed loops whose gain is just above one over decades: one root that is sure to grow decides.

L = g (s + a) / (s + b) exp(-s tau) has roots right of the axis wherever |L| > 1, by the hundred where g is
nearly one: (s + b) + g (s + a) exp(-s tau) = 0 is solved here by Newton's method from a grid.
"""

from __future__ import annotations

import numpy as np
import pytest

from cpu_limit import cpu_limit
from middeck.control.analysis.loop.feedback_loop import evaluate_halves, form_loop
from middeck.control.analysis.margins.disk import measure_disk_margin
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.delayed_roots import keep_certain
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.state_space.statespace import gain_system

CASES = [(0.9999, 3.0, 1.0, 2.0), (-0.9999, 3.0, 1.0, 2.0), (0.99995, 5.0, 2.0, 1.0)]


def lead(g: float, a: float, b: float, tau: float) -> tuple[Plant, Compensator]:
    plant = make_plant([[-b]], [[1.0]], [[a - b]], [[1.0]])
    return delay_plant(plant, tau), Compensator(gain_system(np.array([[-g]])), plant.outputs, plant.inputs)


def own_roots(g: float, a: float, b: float, tau: float) -> np.ndarray:
    """The roots right of the axis up to 20 rad/s."""
    s = (np.linspace(0.0, 0.6, 7)[:, None] + 1j * np.linspace(0.0, 20.0, 201)).ravel()
    for _ in range(60):
        turn = np.exp(-s * tau)
        slope = 1.0 + g * turn * (1.0 - tau * (s + a))
        step = (s + b + g * (s + a) * turn) / slope
        s = s - step / np.maximum(1.0, np.abs(step))
    with np.errstate(all="ignore"):
        held = np.abs(s + b + g * (s + a) * np.exp(-s * tau)) < 1e-11
    s = s[held & (s.real > 0.0) & (s.imag > -1e-12)]
    return s[np.unique(np.round(s, 8), return_index=True)[1]]


@pytest.mark.parametrize("case", CASES)
def test_a_root_that_is_sure_to_grow_decides(case: tuple[float, float, float, float]) -> None:
    plant, law = lead(*case)
    with cpu_limit(5.0):  # it takes half a second
        found = decide_stability(plant, law)
    roots = own_roots(*case)
    fastest = roots[np.argmax(roots.real)]
    assert not found.stable
    assert found.growing == -1  # more grow than were found
    assert found.pole == pytest.approx(fastest, rel=1e-8)
    assert measure_disk_margin(plant, law, at="inputs").alpha == 0.0


def test_margins_of_such_a_loop_are_zero() -> None:
    found = measure_margins(*lead(*CASES[0]))
    loop = found.loops[0]
    assert (loop.gain_limits, loop.phase_limit_rad, loop.delay_limit_s) == ((1.0, 1.0), 0.0, 0.0)
    assert str(found) == "unstable: a root at 0.2172 Hz grows by 0.318 1/s"


def test_what_only_looks_like_a_growing_root_is_left_out() -> None:
    """Of true roots, points beside them, and one near an open pole, the true ones stay."""
    case = CASES[0]
    halves, true = evaluate_halves(form_loop(*lead(*case))), own_roots(*case)
    true = true[true.imag > 0.0]
    false = np.array([true[0] + 0.31 + 0.1j, 0.05 + 0.7j, 2.0])
    kept = keep_certain(halves, np.concatenate([true, false]), np.array([-case[2] + 0.0j]))
    np.testing.assert_allclose(np.sort_complex(kept[kept.imag > 0.0]), np.sort_complex(true))
    assert len(kept) == 2 * len(true)
