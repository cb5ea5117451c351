"""An undamped mode stays undamped in any unit of time: truth by scaling a loop of ordinary frequency."""

import numpy as np
import pytest

import middeck as md
from middeck.control.analysis.stability.stability import judge_roots
from middeck.systems.state_space.statespace import gain_system
from plant_builders import unit_weights


def _plant(seed: int, rate_hz: float, damping: float) -> md.Plant:
    """Two modes in mixed coordinates, the second of damping ratio ``damping``."""
    rng = np.random.default_rng([641, seed])
    first = 0.04 * np.pi * rate_hz
    second = first * rng.uniform(0.3, 3.0)
    A = np.zeros((4, 4))
    A[0, 1], A[1] = first, [-first, -0.1 * first, 0.0, 0.0]
    A[2, 3], A[3, 2:] = second, [-second, -2.0 * damping * second]
    B, C = np.array([[0.0], [first], [0.0], [second]]), np.array([[1.0, 0.0, 1.0, 0.0]])
    Q = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    groups = {"w": ["u1"], "u": ["u1"], "z": ["y1"], "y": ["y1"]}
    return md.make_plant(Q.T @ A @ Q, Q.T @ B, C @ Q, **groups)


@pytest.mark.parametrize(("damping", "decays"), [(0.0, False), (1e-6, True), (-1e-6, False)])
@pytest.mark.parametrize("rate_hz", [1e9, 1e2])
def test_a_mode_on_the_axis_is_not_stable_at_any_rate(campaign, rate_hz, damping, decays):
    for seed in campaign(40):
        plant = _plant(seed, rate_hz, damping)
        idle = md.Compensator(gain_system(np.zeros((1, 1))), plant.outputs, plant.inputs)
        weights = unit_weights(("u1",), 1e-6 / rate_hz, process=1e-4 / rate_hz)
        rows = md.qualify_compensator(idle, {"plant": plant}, weights, rates_hz=[rate_hz])
        assert [row.stable for row in rows] == [decays, decays]
        assert [bool(np.isfinite(row.rms)) for row in rows] == [decays, decays]


@pytest.mark.parametrize("delay_s", [0.0, 1e-3])
def test_an_undamped_mode_at_one_radian_a_second_has_its_rms_without_a_warning(delay_s):
    """x'' + x = w + u with u = -k x' (delayed): E[x'^2] = (S + k^2 N) / (2 k), N of the sensor."""
    plant = md.make_plant(
        [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[0.0, 1.0]],
        w=["u1"], u=["u1"], z=["y1"], y=["y1"], delay_s=delay_s,
    )  # fmt: skip
    k, process, sensor = 1e-3, 1e-4, 1e-6
    law = md.Compensator(gain_system(np.array([[-k]])), plant.outputs, plant.inputs)
    weights = unit_weights(("u1",), sensor, process=process)
    (row,) = md.qualify_compensator(law, {"plant": plant}, weights)
    # The delay's lead in stiffness k * delay changes it by 1e-6 at most.
    assert row.rms == pytest.approx(np.sqrt((process + k**2 * sensor) / (2.0 * k)), rel=1e-5)


def test_a_loop_whose_poles_are_all_at_the_origin_of_z_is_stable():
    """Deadbeat: no pole has a growth rate."""
    judged = judge_roots(np.full(2, complex(-np.inf)), 0.1)
    assert judged.stable
    assert judged.decays
    assert judged.growing == 0
