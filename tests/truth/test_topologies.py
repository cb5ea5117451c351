"""Sensors and actuators compared on one plant: each row is what designing for it alone gives."""

import dataclasses

import mace_like
import numpy as np
import pytest

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import close_inner_loop
from middeck.control.loop.closed_loop import close_loop, leave_open
from middeck.control.loop.performance import Performance, commands_rms, loop_metric
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.topologies import compare_topologies, select_weights
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import StateSpace, gain_system
from plant_builders import grouped_plant

INTENSITY = 2e-6
LEVELS = (1.0, 100.0)


@pytest.fixture(scope="module")
def orbit():
    return close_inner_loop(mace_like.build("orbit"), mace_like.pd_loops())


def test_topologies_are_the_designs_alone(orbit):
    performance = Performance(mace_like.METRIC_WEIGHTS, INTENSITY * np.eye(2), mace_like.BAND_HZ)
    weights = mace_like.weights(INTENSITY)
    chosen = {
        "SISO": (("pri_rel_z",), ("pri_in_z",)),
        "SITO": (("pri_rel_z",), ("bus_z", "pri_rel_z")),
        "MIMO": (orbit.u, orbit.y),
    }
    table = compare_topologies(orbit, weights, chosen, LEVELS, performance)
    assert table.names == ("SISO", "SITO", "MIMO")
    assert table.order.tolist() == 3 * [len(orbit.system.A)]
    assert table.stable.all()
    part = dataclasses.replace(orbit, u=chosen["SITO"][0], y=chosen["SITO"][1])
    law = design_lqg(part, select_weights(orbit, weights, part), 100.0)
    metric = loop_metric(close_loop(part, law), performance)
    expected = 20.0 * np.log10(metric / loop_metric(leave_open(orbit), performance))
    assert table.db[1, 1] == pytest.approx(expected, rel=1e-12)
    # Five inputs and fourteen sensors do more than one and one, at each authority.
    assert np.all(table.db[2] < table.db[0])
    assert np.all(table.control_rms[:, 1] > table.control_rms[:, 0])


@pytest.mark.parametrize("disturbed", ["w", "u"])
def test_control_rms_of_a_scalar(disturbed):
    # x' = -x + u + w under u = -k x: u is k times a lag of corner 1 + k; a disturbance at u is not of it.
    ports = (Port("w", "N"), Port("u", "N")), (Port("x", "m"),)
    system = StateSpace([[-1.0]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]])
    plant = grouped_plant(system, ports[0], ports[1], w=(disturbed,), u=("u",))
    law = Compensator(gain_system([[-3.0]]), (Port("x", "m"),), (Port("u", "N"),))
    found = commands_rms(plant, law, Performance(np.ones(1), np.eye(1), (0.0, 1.0)))
    expected = 3.0 * np.sqrt(np.arctan(2.0 * np.pi / 4.0) / 4.0 / np.pi)
    assert found[0] == pytest.approx(expected, rel=1e-12)


def test_ports_outside_the_groups_are_refused(orbit):
    performance = Performance(mace_like.METRIC_WEIGHTS, INTENSITY * np.eye(2), mace_like.BAND_HZ)
    for u, y in ((("sec_rel_x",), orbit.y), (orbit.u, ("nothing",)), (orbit.u, ())):
        with pytest.raises(ConfigError, match=r"one or more of|no output named"):
            compare_topologies(orbit, mace_like.weights(INTENSITY), {"bad": (u, y)}, LEVELS, performance)


@pytest.mark.parametrize(
    ("weights", "intensity", "says"),
    [
        ([1.0, 1.0], np.eye(1), r"2 weights for 1 ports \(x\)"),
        ([np.nan], np.eye(1), "a weight is not a finite number"),
        ([1.0], np.eye(2), r"2 intensities for 1 ports \(w\)"),
        ([1.0], -np.eye(1), "not symmetric and positive semidefinite"),
        ([1.0], [[1.0, 0.5], [0.0, 1.0]], "not symmetric and positive semidefinite"),
        ([1.0], [[1.0, 5.0], [5.0, 1.0]], "not symmetric and positive semidefinite"),
        ([1.0], [[np.inf]], "not finite"),
    ],
)
def test_a_performance_that_does_not_fit_is_refused(weights, intensity, says):
    system = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    loop = leave_open(grouped_plant(system, (Port("w", "N"),), (Port("x", "m"),), u=(), y=()))
    with pytest.raises(ConfigError, match=says):
        loop_metric(loop, Performance(weights, intensity, (0.0, 1.0)))
