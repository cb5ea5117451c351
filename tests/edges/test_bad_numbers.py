"""Numbers that are none, given through the library: named, and never an endless search for a rest state."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.structure.model.article import AttachPoint, Spring
from middeck.structure.model.environment import AnchoredSpring, Device, Environment
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import GRAVITY, TUBE, body, joint, member, node, structure

Z = np.array([0.0, 0.0, 1.0])
NAN = float("nan")


def bus(section=TUBE, **more):
    nodes = [node(n, (x, 0, 0), body(1.0, inertia=(0.01,) * 3)) for n, x in (("a", 0.0), ("b", 1.0))]
    attach = [AttachPoint("a", "a", np.zeros(3)), AttachPoint("b", "b", np.zeros(3))]
    return structure(nodes, [member("a", "b", section, 2)], **({"attach": attach} | more))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("EA", NAN),
        ("EA", -1.0),
        ("EI_y", np.inf),
        ("GJ", NAN),
        ("rho_A", -0.5),
        ("GA_y", -5e4),
        ("GA_z", NAN),
    ],
)
def test_sections(field: str, value: float):
    with pytest.raises(ConfigError, match="member 'a-b'"):
        solve_equilibrium(bus(dataclasses.replace(TUBE, **{field: value})), Environment.orbit())


@pytest.mark.parametrize("stiffness", [NAN, -50.0, np.inf])
def test_springs_and_joints(stiffness: float):
    hinge = joint("h", "b", Z, body(1.0, inertia=(0.1,) * 3), stiffness=stiffness)
    for parts, name in (
        (
            bus(springs=[Spring(name="tie", start="a", end="b", stiffness=stiffness, free_length=0.2)]),
            "spring 'tie'",
        ),
        (bus(joints=[hinge]), "joint 'h'"),
    ):
        with pytest.raises(ConfigError, match=name):
            solve_equilibrium(parts, Environment.orbit())
    tied = Environment(
        title="tied",
        gravity=np.zeros(3),
        suspension=None,
        springs=(AnchoredSpring(name="k", attach="a", anchor=Z, stiffness=stiffness, free_length=0.5),),
    )
    with pytest.raises(ConfigError, match="spring 'k'"):
        solve_equilibrium(bus(), tied)


def test_places():
    lost = [AttachPoint("a", "a", np.array([NAN, 0.0, 0.0])), AttachPoint("b", "b", np.zeros(3))]
    with pytest.raises(ConfigError, match="attach point 'a'"):
        solve_equilibrium(bus(attach=lost), Environment.orbit())
    up = np.array([0.0, NAN, 0.0])
    hung = Environment(
        title="hung",
        gravity=GRAVITY,
        suspension=None,
        springs=(),
        devices=(Device(name="d", attach="a", force=10.0, stiffness=5.0, anchor=up),),
    )
    with pytest.raises(ConfigError, match="device 'd'"):
        solve_equilibrium(bus(), hung)
    with pytest.raises(ConfigError, match="gravity"):
        solve_equilibrium(bus(), Environment(title="odd", gravity=np.array([0.0, NAN, 0.0])))


def test_directions_that_are_held():
    lab = Environment.lab(bus())
    assert lab.suspension is not None
    wrong = dataclasses.replace(lab, suspension=dataclasses.replace(lab.suspension, held=("w", "xyz")))
    with pytest.raises(ConfigError, match="of x, y and z only"):
        solve_equilibrium(bus(), wrong)
    with pytest.raises(ConfigError, match="2 attach points and 1 sets"):
        dataclasses.replace(lab.suspension, held=("yz",))
