"""An arm on a link or a bushing: a spring turns it to the arm drawn there; a joint drawn anew is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, NumericalError
from middeck.structure.gimbals.family import sweep_gimbals
from middeck.structure.model.article import AttachPoint, Body, JointState, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment, GroundBushing
from middeck.structure.model.links import Link
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.residuals.surveys import set_up
from structure_builders import GRAVITY, TURNING_TUBE, body, joint, member, node, structure

ON_A_WALL = Environment(title="wall", gravity=GRAVITY, clamps=(Clamp(node="base"),))
HUB = body(0.3, inertia=(1e-3, 1e-3, 1e-3))
TURN, STIFF = np.radians(25.0), 1e7


def arm(drawn: float, inertia: tuple[float, ...] = (0.02,) * 3, **more) -> Structure:
    """A motor about z at the origin and a flexible arm on a rigid link, drawn at an angle from -y."""
    along = np.array([np.sin(drawn), -np.cos(drawn), 0.0])
    nodes = [
        node("base", (0, 0, 0), body(1.0, inertia=inertia)),
        node("root", 0.1 * along, body(0.2, inertia=(1e-3,) * 3)),
        node("tip", 0.9 * along, body(0.8, inertia=(0.01,) * 3)),
    ]
    motor = joint("motor", "base", (0, 0, 1), HUB, **more)
    whole = structure(nodes, [member("root", "tip", TURNING_TUBE, 6, up=(0, 0, 1))], joints=[motor])
    return dataclasses.replace(whole, links=(Link(name="flange", first="motor", second="root"),))


def test_a_spring_turns_all_that_is_linked_to_the_joint() -> None:
    turned = solve_equilibrium(arm(0.0, stiffness=STIFF, target=TURN), ON_A_WALL)
    drawn = solve_equilibrium(arm(TURN, stiffness=STIFF), ON_A_WALL)
    at = turned.model.frames.index("tip"), drawn.model.frames.index("tip")
    assert np.allclose(turned.config.x[at[0]], drawn.config.x[at[1]], atol=1e-7)
    f, g = (solve_modes(rest).frequency_hz[:8] for rest in (turned, drawn))
    assert np.allclose(f, g, rtol=1e-6)


def test_a_sweep_that_would_only_draw_the_link_anew_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"'motor' cannot go to another angle .*'flange'"):
        sweep_gimbals(arm(0.0), ON_A_WALL, {"motor": [0.0, TURN]}, count=4)


def test_a_command_away_from_the_drawing_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"'flange' would be drawn anew"):
        solve_equilibrium(arm(0.0, state=JointState.DRIVEN, target=TURN), ON_A_WALL)
    solve_equilibrium(arm(TURN, state=JointState.DRIVEN, angle=TURN, target=TURN), ON_A_WALL)


def test_a_survey_cannot_set_such_an_angle() -> None:
    with pytest.raises(ConfigError, match="would not turn with it"):
        set_up(arm(0.0), ON_A_WALL, [("joint.motor.angle", TURN)], [])
    set_up(arm(0.0), ON_A_WALL, [("joint.motor.angle", 0.0), ("joint.motor.mass", 0.4)], [])


def test_a_pattern_is_the_parameter_that_it_finds() -> None:
    with pytest.raises(ConfigError, match="would not turn with it"):
        set_up(arm(0.0, state=JointState.LOCKED), ON_A_WALL, [("joint.?otor.angle", TURN)], [])


def test_a_link_within_what_the_joint_carries_turns_with_it() -> None:
    whole = arm(0.0)
    wrist = joint("wrist", "motor", (0, 0, 1), HUB, offset=(0.0, -0.2, 0.0))
    tool = joint("tool", "motor", (1, 0, 0), HUB, offset=(0.0, -0.3, 0.0))
    within = dataclasses.replace(
        whole,
        nodes=whole.nodes[:1],
        members=(),
        joints=(*whole.joints, wrist, tool),
        links=(Link(name="rod", first="wrist", second="tool", along="", about="z"),),
    )
    family = sweep_gimbals(within, ON_A_WALL, {"motor": [0.0, TURN]}, count=2)
    assert abs(np.ptp(family.holding_torque)) > 0.1


ON_A_STAND = Environment(
    title="stand",
    gravity=np.zeros(3),
    bushings=(GroundBushing(name="stand", attach="foot", stiffness=np.diag([1e5] * 3 + [1e4] * 3)),),
)


def bus_on_its_payload(**more) -> Structure:
    """A floating bar with a payload beside it that is to stand on the ground."""
    nodes = [node("bus", (0, 0, 0), body(2.0)), node("end", (1, 0, 0), body(1.0))]
    payload = joint("motor", "bus", (0, 0, 1), body(1.0, (0, 0.1, 0)), offset=(0, 0.2, 0), **more)
    bar = member("bus", "end", TURNING_TUBE, 2, up=(0, 0, 1))
    foot = AttachPoint("foot", "motor", np.array([0, 0.1, 0]))
    return structure(nodes, [bar], joints=[payload], attach=[foot])


def test_a_bushing_to_the_ground_is_drawn_anew_as_a_link_is() -> None:
    """A spring turns the bus about the payload that stands; a command turned nothing, without any moment."""
    rest = solve_equilibrium(bus_on_its_payload(stiffness=STIFF, target=TURN), ON_A_STAND)
    c, s = np.cos(TURN), np.sin(TURN)  # the bus turns by -TURN about (0, 0.2)
    turned = [c * 1.0 - s * 0.2, 0.2 - s * 1.0 - c * 0.2, 0.0]
    assert np.allclose(rest.config.x[rest.model.frames.index("end")], turned, atol=1e-7)
    with pytest.raises(ConfigError, match=r"'motor' cannot go to another angle .*'stand'"):
        solve_equilibrium(bus_on_its_payload(state=JointState.DRIVEN, target=TURN), ON_A_STAND)
    with pytest.raises(ConfigError, match=r"'motor' cannot go to another angle .*'stand'"):
        sweep_gimbals(bus_on_its_payload(), ON_A_STAND, {"motor": [0.0, TURN]}, count=4)
    for state, key in ((JointState.DRIVEN, "target"), (JointState.LOCKED, "angle")):
        with pytest.raises(ConfigError, match=r"'motor' cannot go to another angle .*'stand'"):
            set_up(bus_on_its_payload(state=state), ON_A_STAND, [(f"joint.motor.{key}", TURN)], [])
    solve_equilibrium(bus_on_its_payload(state=JointState.DRIVEN), ON_A_STAND)


def two_links(**more) -> Structure:
    """A shoulder on the base, an elbow on the arm's tip, each with a flexible arm on a link."""
    whole = arm(0.0, **more)
    nodes = [
        node("fore", (0, -0.9, 0.05), body(0.2, inertia=(1e-3,) * 3)),
        node("tool", (0.5, -1.4, 0.05), body(0.6, inertia=(0.01,) * 3)),
    ]
    elbow = joint("elbow", "tip", (0, 0, 1), HUB, offset=(0.0, 0.0, 0.05))
    return dataclasses.replace(
        whole,
        nodes=(*whole.nodes, *nodes),
        members=(*whole.members, member("fore", "tool", TURNING_TUBE, 6, up=(0, 0, 1))),
        joints=(*whole.joints, elbow),
        links=(*whole.links, Link(name="second", first="elbow", second="fore")),
    )


def test_swings_of_a_clamped_arm_are_named_after_the_joints_that_turn() -> None:
    """What the clamp holds has no bounce; the slower swing turns the shoulder most, the faster the elbow."""
    modes = solve_modes(solve_equilibrium(two_links(), ON_A_WALL))
    assert modes.kind[:2] == ("pendulum", "pendulum")
    assert modes.name[:2] == ("payload pendulum motor", "payload pendulum elbow")
    at = [modes.equilibrium.model.tree.size - 2, modes.equilibrium.model.tree.size - 1]
    turns = np.abs(modes.shapes[at, :2])
    assert turns[1, 1] / turns[0, 1] > turns[1, 0] / turns[0, 0]


def test_free_joints_of_linked_arms_have_their_names_without_gravity() -> None:
    held = solve_modes(solve_equilibrium(two_links(), dataclasses.replace(ON_A_WALL, gravity=np.zeros(3))))
    assert held.name[:2] == ("gimbal motor", "gimbal elbow")
    free = solve_modes(solve_equilibrium(two_links(), Environment.orbit()))
    assert free.kind.count("rigid") == 8
    assert free.name[6:8] == ("gimbal motor", "gimbal elbow")


POINT = (0.0,) * 3


def test_a_motor_on_a_linked_point_mass_that_floats_is_refused_on_every_processor() -> None:
    """Base and motor turn against each other without any mass: rounding of the link was taken for it."""
    with pytest.raises(NumericalError, match="neither mass nor stiffness"):
        solve_modes(solve_equilibrium(two_links(inertia=POINT), Environment.orbit()))


@pytest.mark.parametrize("moments", [(0.3, 0.2, 0.11), (1e-3, 2e-3, 3e-3), (5.0, 4.0, 2.0)])
def test_a_motor_on_a_floating_point_mass_is_refused_on_every_processor(moments: tuple[float, ...]) -> None:
    """About an axis of any direction: the mass that cancels was none, or a mode at zero, as it rounded."""
    axes, _ = np.linalg.qr(np.random.default_rng(7).standard_normal((3, 3)))
    inertia = axes @ np.diag(moments) @ axes.T
    carried = Body(0.5, np.zeros(3), 0.5 * (inertia + inertia.T))
    alone = structure(
        [node("base", (0, 0, 0), body(1.0))], joints=[joint("motor", "base", axes[:, 0], carried)]
    )
    with pytest.raises(NumericalError, match="neither mass nor stiffness"):
        solve_modes(solve_equilibrium(alone, Environment.orbit()))
