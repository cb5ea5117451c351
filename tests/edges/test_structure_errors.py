"""What cannot be answered is refused, with its name, its place and what to try."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, EquilibriumError, NumericalError, UnstableEquilibriumError
from middeck.files.setups import load_setup
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.model.article import (
    Actuator,
    AttachPoint,
    Sensor,
    Spring,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import node_rotations, solve_equilibrium
from structure_builders import (
    GRAVITY,
    TURNING_TUBE,
    body,
    joint,
    lab,
    member,
    node,
    on_cables,
    rigid_bar,
    springs_above,
    structure,
    tube_bus,
)

X, Z = np.eye(3)[0], np.eye(3)[2]


def bus(cg_y: float = -0.05, payload_y: float = -0.2) -> Structure:
    payload = body(3.0, (0, payload_y, 0), (0.02,) * 3)
    return tube_bus((5.0, 5.0), (0, cg_y, 0), (0.1, 0.1, 0.1), payload, angle=0.0)


def cables(held=("xyz", "yz"), **more) -> Environment:
    return on_cables(4.0, 0.25, held, **more)


def test_gravity_and_nothing_to_hang_from():
    with pytest.raises(EquilibriumError, match="nothing to hang from") as error:
        solve_equilibrium(bus(), Environment(title="bare", gravity=GRAVITY))
    assert "'bare'" in error.value.where
    assert "orbit" in error.value.hint


def test_suspension_without_gravity():
    with pytest.raises(EquilibriumError, match="needs gravity"):
        solve_equilibrium(bus(), cables(gravity=np.zeros(3)))


@pytest.mark.parametrize("held", [("x", "x"), ("xz", "z")])
def test_mechanism_that_the_weight_drives(held):
    with pytest.raises(EquilibriumError, match="mechanism") as error:
        solve_equilibrium(bus(), cables(held))
    assert error.value.where == "suspension.held"


def test_slack_cable_names_its_point_and_all_reactions():
    """Both attach points on one side of the centre of mass: the near one pulls double, the far one pushes."""
    parts = bus()
    inside = [AttachPoint("a", "a", np.array([0, 0.02, 0])), AttachPoint("b", "a", np.array([-0.2, 0.02, 0]))]
    with pytest.raises(EquilibriumError, match="cable at 'b' would be slack") as error:
        solve_equilibrium(dataclasses.replace(parts, attach_points=tuple(inside)), cables())
    reactions = error.value.data["reactions_n"]
    assert reactions["b"] < 0.0 < reactions["a"]
    assert sum(reactions.values()) == pytest.approx(parts.mass * 9.80665, rel=1e-6)


def test_payload_above_its_axes_grows():
    rest = solve_equilibrium(bus(payload_y=0.2), cables())
    assert rest.converged  # its axis is held: at rest there is nothing wrong
    with pytest.raises(UnstableEquilibriumError, match="payload pendulum p") as error:
        solve_modes(rest)
    # Faster than with a fixed carrier, which has m g d / (I + m d^2).
    fixed = np.sqrt(3.0 * 9.80665 * 0.2 / (0.02 + 3.0 * 0.2**2))
    assert error.value.data["growth"] > fixed
    assert error.value.data["mode"] == "payload pendulum p"


def test_an_article_above_its_attach_points_turns_over():
    """Pinned it balances; free it falls round its cables, and the payload then stands above its axis."""
    rest = solve_equilibrium(bus(cg_y=0.3, payload_y=-0.01), cables())
    assert rest.converged
    roll = np.linalg.norm(node_rotations(rest)["a"])
    assert roll == pytest.approx(np.pi, abs=0.01)  # the payload's moment bends it by a little
    with pytest.raises(UnstableEquilibriumError, match="payload pendulum p"):
        solve_modes(rest)


def test_no_linearisation_about_a_state_that_is_not_at_rest():
    rest = solve_equilibrium(bus(), cables())
    moving = dataclasses.replace(rest, residual=1e-3)
    assert not moving.converged
    with pytest.raises(EquilibriumError, match="not at rest") as error:
        solve_modes(moving)
    assert error.value.data["history"] == rest.history


def test_unknown_attach_point_is_a_fault_of_the_environment():
    with pytest.raises(ConfigError, match="no attach point 'c'") as error:
        solve_equilibrium(bus(), cables(attach=("a", "c")))
    assert "a, b" in error.value.hint
    with pytest.raises(ConfigError, match="no attach point 'd'"):
        solve_equilibrium(
            bus(),
            lab(AnchoredSpring(name="s", attach="d", anchor=np.zeros(3), stiffness=1.0, free_length=1.0)),
        )


def test_disconnected_part_is_named_whatever_the_environment():
    nodes = [node(n, (i, 0, 0), body(1, inertia=(0.1,) * 3)) for i, n in enumerate("abcde")]
    attach = [AttachPoint(n, n, np.array([0, 0.02, 0])) for n in "abcde"]
    parts = structure(nodes, [member(*ends, TURNING_TUBE, 2) for ends in ("ab", "bc", "de")], attach=attach)
    for environment in (Environment.orbit(), cables()):
        with pytest.raises(ConfigError, match="no member or spring joins node 'd', 'e' to the rest"):
            solve_equilibrium(parts, environment)
    whole = dataclasses.replace(
        parts, springs=(Spring(name="s", start="d", end="a", stiffness=10.0, free_length=1.0),)
    )
    assert solve_equilibrium(whole, Environment.orbit()).converged


def test_what_a_joint_carries_is_joined_by_a_spring_to_it():
    """A spring from a payload to another node: the chain of joints is followed to its node."""
    parts = bus()
    alone = node("c", (2, 0, 0), body(1, inertia=(0.1,) * 3))
    attach = (*parts.attach_points, AttachPoint("p", "p", np.zeros(3)), AttachPoint("c", "c", np.zeros(3)))
    broken = dataclasses.replace(parts, nodes=(*parts.nodes, alone), attach_points=attach)
    with pytest.raises(ConfigError, match="joins node 'c'"):
        mesh_structure(broken)
    mesh_structure(
        dataclasses.replace(
            broken, springs=(Spring(name="s", start="p", end="c", stiffness=10.0, free_length=1.0),)
        )
    )


def test_spring_whose_ends_coincide():
    bar = rigid_bar(2.0, 1.0, (0.1, 0.2, 0.3))
    with pytest.raises(EquilibriumError, match="ends of a spring coincide"):
        solve_equilibrium(
            bar,
            lab(
                AnchoredSpring(
                    name="s", attach="left", anchor=np.array([-0.5, 0, 0]), stiffness=10.0, free_length=1.0
                )
            ),
        )


def test_motion_without_mass_or_stiffness_is_named():
    """A free axis that carries nothing."""
    empty = joint("idle", "bar", X)
    parts = dataclasses.replace(rigid_bar(2.0, 1.0, (0.1, 0.2, 0.3)), joints=(empty,))
    with pytest.raises(NumericalError, match="neither mass nor stiffness") as error:
        solve_modes(solve_equilibrium(parts, Environment.orbit()))
    assert "'idle'" in error.value.where
    assert "clamp" in (error.value.hint or "")


def changed_member(**changes) -> Structure:
    parts = bus()
    return dataclasses.replace(parts, members=(dataclasses.replace(parts.members[0], **changes),))


def changed_joint(**changes) -> Structure:
    parts = bus()
    return dataclasses.replace(parts, joints=(dataclasses.replace(parts.joints[0], **changes),))


def with_ports(*ports) -> Structure:
    actuators = tuple(p for p in ports if isinstance(p, Actuator))
    sensors = tuple(p for p in ports if isinstance(p, Sensor))
    return dataclasses.replace(bus(), actuators=actuators, sensors=sensors)


BROKEN = {
    "member 'a-b' names node 'zz'": changed_member(end="zz"),
    "has its up vector along itself": changed_member(up=X),
    "has no length between": changed_member(end="a"),
    "has 0 elements": changed_member(elements=0),
    "joint 'p' hangs on 'q'": changed_joint(parent="q"),
    "which is no unit vector": changed_joint(axis=2 * X),
    "negative or not a number": changed_joint(body=body(-1.0)),
    "'p' carries a body": changed_joint(body=body(1.0, inertia=(-0.1, 0.1, 0.1))),
    "'p' carries": changed_joint(body=body(np.nan)),
    "port 't' names joint 'a'": with_ports(Actuator(name="t", frame="a", axis=None)),
    "port 'r' names frame 'zz'": with_ports(Sensor(name="r", frame="zz", axis=Z, axis_frame="a")),
    "sensor 'r' names frame 'zz'": with_ports(Sensor(name="r", frame="a", axis=Z, axis_frame="zz")),
    "actuator 't' is there twice": with_ports(
        Actuator(name="t", frame="a", axis=Z), Actuator(name="t", frame="a", axis=X)
    ),
    "spring 's' names attach point 'zz'": dataclasses.replace(
        bus(), springs=(Spring(name="s", start="a", end="zz", stiffness=1.0, free_length=1.0),)
    ),
    "frame 'a' is there twice": changed_joint(name="a"),
    "attach point 'c' names frame 'zz'": dataclasses.replace(
        bus(), attach_points=(AttachPoint("c", "zz", np.zeros(3)),)
    ),
}


@pytest.mark.parametrize("message", BROKEN)
def test_impossible_structures_are_refused_before_meshing(message: str):
    with pytest.raises(ConfigError) as error:
        mesh_structure(BROKEN[message])
    assert message in str(error.value)


def test_all_faults_come_at_once():
    both = dataclasses.replace(changed_joint(axis=2 * X), members=changed_member(end="zz").members)
    with pytest.raises(ConfigError, match=r"names node 'zz'.*no unit vector"):
        mesh_structure(both)


def test_slack_spring_to_ground_may_push():
    """A spring is no cable: under a light bar it stands shorter than free, and says so with its tension."""
    points = {"left": (-1.0, 0, 0), "right": (1.0, 0, 0)}
    rest = solve_equilibrium(
        rigid_bar(0.1, 2.0, (0.1, 0.2, 0.2)), lab(*springs_above(points, 3.0, 40.0, 2.9))
    )
    assert rest.converged
    assert rest.tension == pytest.approx(0.05 * 9.80665, rel=1e-6)


def test_an_article_that_turned_over_says_so():
    """Gravity upwards: the cables hang from below, and rest is half a turn away."""
    article, upside_down = load_setup(
        "articles/mace-dm.toml",
        "environments/lab.toml",
        ["constants.gravity_direction=[0,1,0]", "mesh.elements_per_strut=1"],
    )
    assert "turned by 180 deg" in solve_modes(solve_equilibrium(article, upside_down)).warnings[0]
