"""What a performance refuses."""

import numpy as np
import pytest

from middeck.control.loop.closed_loop import leave_open
from middeck.control.loop.performance import Performance, loop_metric
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import grouped_plant


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
