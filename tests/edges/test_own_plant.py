"""A plant of one's own matrices: what is taken, and what is refused by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

GOOD: dict[str, Any] = {"A": [[0, 1], [-4, -0.1]], "B": [[0], [1]], "C": [[1, 0]]}


def test_ports_units_groups_and_delays() -> None:
    plant = make_plant(
        **GOOD,
        inputs=["torque [N m]"],
        outputs=[Port("angle", "rad")],
        u=["torque"],
        y=["angle"],
        delay_s=0.01,
    )
    assert plant.inputs == (Port("torque", "N m"),)
    assert (plant.u, plant.y, plant.delay_s.tolist()) == (("torque",), ("angle",), [[0.01]])
    assert [p.name for p in make_plant(**GOOD).outputs] == ["y1"]
    assert make_plant(**GOOD, period_s=0.1).period_s == 0.1


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"A": [[0, 1], [1]]}, "A is not of finite real numbers"),
        ({"A": [[0, np.nan], [1, 1]]}, "A is not of finite"),
        ({"B": [0, 1]}, "B has 1 dimensions"),
        ({"B": [[0], [1], [2]]}, "StateSpace.B: shape"),
        ({"C": np.ma.masked_array([[1.0, 0.0]], [[1, 0]])}, "C is not of finite"),
        ({"delay_s": [0.1, 0.2]}, "delay_s has shape"),
        ({"delay_s": np.zeros((3, 3))}, "delay_s has shape"),
        ({"delay_s": "0.1"}, "delay_s is not of finite"),
        ({"delay_s": 1j}, "delay_s is not of finite"),
        ({"delay_s": -1.0}, "one is negative"),
        ({"inputs": "torque [N m]"}, "inputs is not a list"),
        ({"inputs": [3]}, "3 is no port"),
        ({"inputs": ["t N]"]}, "is no port"),
        ({"outputs": ["a", "a"]}, "two outputs named a"),
        ({"w": "torque"}, "w is not a list"),
        ({"state_names": [1, 2]}, "state_names is not a list"),
        ({"period_s": True}, "period_s is not one number"),
        ({"period_s": "0.1"}, "period_s is not one number"),
        ({"period_s": 0.0}, "a sampling period of 0.0 s"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        make_plant(**GOOD | wrong)
    assert says in str(refused.value)
    assert refused.value.hint


def test_a_loop_has_one_time() -> None:
    one, other = (SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], period_s=T) for T in (0.1, 0.2))
    with pytest.raises(ConfigError, match=r"systems of periods 0\.1 and 0\.2 s"):
        feedback(one, other, [0], [0])
    with pytest.raises(ConfigError, match=r"systems of periods 0 and 0\.1 s"):
        feedback(StateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]]), one, [0], [0])
