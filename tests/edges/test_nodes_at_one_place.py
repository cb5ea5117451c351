"""A numbered node of a test where several nodes of the article stand: a pinned end is not one of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.structure.correlation.placing import place_channels
from middeck.structure.model.links import Link
from structure_builders import TURNING_TUBE, body, member, node, structure

TIP = (1.0, 0.0, 0.0)
PIN = Link(name="pin", first="g402", second="bar7a", along="xyz", about="x")


def two_bars(*links: Link, apart: float = 0.0, end: str = "bar7a"):
    """A bar from g401 to g402, and one from there or ``apart`` of it, whose end is a node of its own."""
    nodes = [
        node("g401", (0.0, 0.0, 0.0), body(1.0)),
        node(end, (1.0 + apart, 0.0, 0.0)),
        node("g402", TIP, body(1.0)),
        node("g403", (2.0, 0.0, 0.0), body(1.0)),
    ]
    ends = ("g401", "g402"), (end, "g403"), ("g401", "g403")
    members = [member(a, b, TURNING_TUBE, 1) for a, b in ends]
    return mesh_structure(dataclasses.replace(structure(nodes, members), links=links))


def placed(model) -> MeasuredModes:
    """Of a survey whose nodes 1 and 11 stand at g401 and at g402."""
    test = MeasuredModes(
        frequency_hz=[3.0],
        damping=[0.01],
        node=("1", "11", "11"),
        direction=("y", "y", "z"),
        shape=np.array([[1.0], [0.5], [0.2]]),
        position_m=np.array([(0.0, 0.0, 0.0), TIP, TIP]),
    )
    return place_channels(model, test)


def test_a_pinned_end_does_not_stand_in_the_way_of_its_grid() -> None:
    found = placed(two_bars(PIN))
    assert found.channels == ("g401 y", "g402 y", "g402 z")
    assert found.warnings == ()


@pytest.mark.parametrize(
    "model",
    [
        two_bars(),  # nothing joins them
        two_bars(Link(name="slide", first="g402", second="bar7a", along="xy")),
        two_bars(Link(name="arm", first="g402", second="bar7a"), apart=0.01),  # within reach, but elsewhere
    ],
)
def test_nodes_that_may_move_apart_stay_a_question_with_an_answer(model) -> None:
    found = placed(model)
    assert found.channels == ("g401 y",)
    (warning, left) = found.warnings
    assert "node 11 of the test stands where bar7a and g402 do: which of them is it?" in warning
    assert "the number of that node in its name, or its name in a JSON survey" in warning
    assert "2 channels of nodes that are not in the model are left out: 11" in left


def test_the_number_decides_between_a_grid_and_what_is_pinned_to_it() -> None:
    """As between the grids of an RBE2 of shifts alone, which turn apart."""
    ball = Link(name="ball", first="g402", second="g11", along="xyz")
    found = placed(two_bars(ball, end="g11"))
    assert found.channels == ("g401 y", "g11 y", "g11 z")
    assert found.warnings == ()


def test_the_number_decides_between_nodes_that_may_move_apart() -> None:
    assert placed(two_bars(end="g11")).channels == ("g401 y", "g11 y", "g11 z")
