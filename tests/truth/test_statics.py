"""Rest states: supports, cables, springs and holding torques in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import updating_case

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.elements.frames import frame_poses, points_in_world
from middeck.structure.model.article import AttachPoint, JointState, Section
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.rest import pinned_reactions as pinning
from middeck.structure.rest.equilibrium import node_rotations, solve_equilibrium
from middeck.structure.rest.pinned_reactions import PinnedPoints, support_forces
from middeck.structure.rest.suspension_tuning import pinned_loads, pinned_points
from middeck.structure.sensitivity.parameters import scale_parameters
from repeats import repeats
from structure_builders import (
    GRAVITY,
    TURNING_TUBE,
    body,
    lab,
    member,
    node,
    on_cables,
    rigid_bar,
    springs_above,
    straight_beam,
    structure,
    tube_bus,
)

G = 9.80665


def hung_bus(payload_angle: float = 0.3, state: JointState = JointState.FREE, **joint):
    """Three bodies on a tube, a payload on an axis along the bus; attach points above the nodes."""
    payload = body(3.0, (0, -0.2, 0), (0.02, 0.01, 0.02))
    more = {"angle": payload_angle, "state": state, "elements": 4, **joint}
    return tube_bus((5.0, 10.0, 5.0), (0, -0.05, 0), (0.1, 0.1, 0.1), payload, **more)


def cables(held=("yz", "xyz", "yz")) -> Environment:
    return on_cables(4.0, 0.25, held)


def pinned_forces(model, points: PinnedPoints) -> np.ndarray:
    state = pinning.settle_pinned(model, dataclasses.replace(no_loads(), gravity=GRAVITY), points)
    return support_forces(state.supports, state.force, len(points.point))


def test_pinned_reactions_carry_the_weight_and_its_moments():
    parts = hung_bus()
    model = mesh_structure(parts)
    pinned = PinnedPoints(model.attach_point, ("yz", "xyz", "yz"))
    force = pinned_forces(model, pinned)
    assert force.sum(axis=0) == pytest.approx([0.0, parts.mass * G, 0.0], abs=1e-6)
    # Moment about z of the vertical reactions, x = 0, 1, 2, against the weights; sag moves arms by 1e-4.
    weights = 8.0 * 0.0 + 10.0 * 1.0 + 5.0 * 2.0 + 0.5 * (0.95 * 0.5 + 0.95 * 1.5)
    assert force[:, 1] @ [0.0, 1.0, 2.0] == pytest.approx(weights * G, rel=1e-3)
    assert force[[0, 2], 0] == pytest.approx(0.0)  # not held along the bus


@pytest.mark.parametrize("softer", repeats([3.0, 1.0, 10.0, 30.0]))
@pytest.mark.parametrize("turned", repeats([0.35, -1.0, 0.0]))
def test_an_article_pinned_at_once_rests_where_small_load_steps_lead(monkeypatch, softer, turned):
    """With its gimbal turned, Newton's second step is a quarter to a half of the first: still that branch."""
    drawn, place = updating_case.sheet()
    angles = [("joint.pri_x.angle", turned), ("joint.pri_z.angle", turned)]
    parts = scale_parameters(updating_case.placed(drawn, angles), {"members.E": 1.0 / softer})
    model = mesh_structure(parts)
    loads, points = pinned_loads(model, place), pinned_points(model, place)
    at_once = pinning.settle_pinned(model, loads, points)
    monkeypatch.setattr(pinning, "LONGEST_STEP", 0.0)  # nothing is taken at once
    monkeypatch.setattr(pinning, "LOAD_FACTORS", np.linspace(0.05, 0.95, 19))
    stepped = pinning.settle_pinned(model, loads, points)
    # Either ends at an imbalance of 1e-9 of the weight, and at rounding after a last quadratic step.
    weight = parts.mass * G
    assert at_once.force == pytest.approx(stepped.force, abs=1e-8 * weight)
    assert at_once.config.x == pytest.approx(stepped.config.x, abs=1e-8)
    assert at_once.config.angle == pytest.approx(stepped.config.angle, abs=1e-8)


def test_three_moment_equation_of_the_pinned_bus():
    """A continuous beam on three level supports under its own weight: the middle carries 5/4 w L."""
    nodes = [node(n, (x, 0, 0)) for n, x in (("a", 0.0), ("b", 1.0), ("c", 2.0))]
    attach = [AttachPoint(n, n, np.zeros(3)) for n in "abc"]
    stiff = dataclasses.replace(TURNING_TUBE, EI_y=1e4, EI_z=1e4, EA=1e8, GJ=1e4)
    parts = structure(nodes, [member("a", "b", stiff, 2), member("b", "c", stiff, 2)], attach=attach)
    model = mesh_structure(parts)
    force = pinned_forces(model, PinnedPoints(model.attach_point, ("yz", "xyz", "yz")))
    # Sag is 1e-6 of the span: second-order terms 1e-12, the support's axial give 1e-8.
    assert force[:, 1] == pytest.approx(0.5 * G * np.array([0.375, 1.25, 0.375]), rel=1e-6)


def test_hung_article_carries_its_weight_and_balances_moments():
    parts = hung_bus()
    rest = solve_equilibrium(parts, cables())
    assert rest.converged
    world = points_in_world(rest.model.points, frame_poses(rest.model.tree, rest.config))
    span = rest.loads.anchor - world[rest.loads.attach_point]
    pull = rest.tension[:, None] * span / np.linalg.norm(span, axis=1)[:, None]
    # The residual is below 1e-9 of the weight at each of some fifty coordinates.
    assert pull.sum(axis=0) == pytest.approx([0.0, parts.mass * G, 0.0], abs=1e-6)
    model = rest.model
    weight = np.cross(world[model.body_point], model.body_mass[:, None] * GRAVITY).sum(axis=0)
    ends = world[model.element_ends]
    members = np.cross(ends.mean(axis=1), (model.beams.rho_A * model.beams.length)[:, None] * GRAVITY)
    moment = np.cross(world[rest.loads.attach_point], pull).sum(axis=0) + weight + members.sum(axis=0)
    # The weight of a member acts on its cubic centre line, off the chord by L^2 kappa / 12 = 1e-6 m.
    assert moment == pytest.approx(np.zeros(3), abs=1e-4)


@pytest.mark.parametrize("angle", [-0.8, 0.3, np.pi / 4])
def test_holding_torque(angle: float):
    """m g d sin(angle + roll), positive on the payload."""
    rest = solve_equilibrium(hung_bus(angle), cables())
    roll = node_rotations(rest)["a"][0]
    assert rest.holding_torque[0] == pytest.approx(3.0 * G * 0.2 * np.sin(angle + roll), rel=1e-6)


def test_driven_axis_stands_at_its_command_and_locked_at_its_nominal_angle():
    at_command = solve_equilibrium(hung_bus(0.0, JointState.DRIVEN, target=0.5), cables())
    free = solve_equilibrium(hung_bus(0.5), cables())
    locked = solve_equilibrium(hung_bus(0.5, JointState.LOCKED, target=0.1), cables())
    for rest in (at_command, locked):
        assert rest.config.angle[0] == 0.5
        assert rest.holding_torque == pytest.approx(free.holding_torque, rel=1e-9)
        assert rest.tension == pytest.approx(free.tension, rel=1e-9)


def test_sprung_axis_sinks_until_its_spring_holds():
    k, target = 20.0, 0.6
    rest = solve_equilibrium(hung_bus(0.0, JointState.SPRUNG, stiffness=k, target=target), cables())
    angle, roll = rest.config.angle[0], node_rotations(rest)["a"][0]
    assert k * (target - angle) == pytest.approx(3.0 * G * 0.2 * np.sin(angle + roll), rel=1e-6)
    assert rest.holding_torque[0] == pytest.approx(k * (target - angle), rel=1e-6)


def test_bar_on_two_springs_sinks_by_its_weight():
    m, k = 6.0, 40.0
    points = {"left": (-1.0, 0, 0), "right": (1.0, 0, 0)}
    rest = solve_equilibrium(rigid_bar(m, 2.0, (0.1, 2, 2)), lab(*springs_above(points, 3.0, k, 2.5)))
    assert rest.converged
    # Length 2.5 + mg/2k below anchors at 3 m.
    assert rest.config.x[0] == pytest.approx([0.0, 3.0 - 2.5 - m * G / (2 * k), 0.0], abs=1e-8)
    assert rest.tension == pytest.approx(0.5 * m * G, rel=1e-9)


def test_cable_under_an_off_centre_load_leans_through_the_centre_of_mass():
    """One cable: the centre of mass comes to rest below the anchor, however far it has to turn."""
    bar = structure(
        [node("bar", (0, 0, 0), body(2.0, (0.3, -0.1, 0.2), (0.1, 0.2, 0.3)))],
        attach=[AttachPoint("hook", "bar", np.array([0.0, 0.1, 0.0]))],
    )
    spring = AnchoredSpring(
        name="s", attach="hook", anchor=np.array([0.0, 2.1, 0.0]), stiffness=100.0, free_length=1.8
    )
    rest = solve_equilibrium(bar, lab(spring))
    cg = rest.config.x[0] + rest.config.R[0] @ [0.3, -0.1, 0.2]
    assert rest.converged
    assert cg[[0, 2]] == pytest.approx(np.zeros(2), abs=1e-8)
    assert rest.tension[0] == pytest.approx(2.0 * G, rel=1e-9)


def test_spring_of_no_free_length_is_linear_at_zero_length():
    """Its two ends may coincide; it sinks by mg/2k."""
    k, m = 400.0, 2.0
    springs = [
        AnchoredSpring(name=n, attach=n, anchor=np.array([x, 0, 0]), stiffness=k, free_length=0.0)
        for n, x in (("left", -0.5), ("right", 0.5))
    ]
    rest = solve_equilibrium(rigid_bar(m, 1.0, (0.1, 0.2, 0.3)), lab(*springs))
    assert rest.converged
    assert rest.config.x[0, 1] == pytest.approx(-m * G / (2 * k), rel=1e-9)


def test_hanging_heavy_beam_stretches_by_half_its_weight():
    """Upright beam on one spring: elongation w L^2 / 2 EA and a tension that is its weight at the top."""
    L = 2.0
    soft = dataclasses.replace(TURNING_TUBE, EA=1e4)
    nodes = [node("a", (0, 0, 0)), node("b", (0, -L, 0))]
    attach = [AttachPoint("a", "a", np.zeros(3))]
    parts = structure(nodes, [member("a", "b", soft, 8, up=(1, 0, 0))], attach=attach)
    spring = AnchoredSpring(
        name="s", attach="a", anchor=np.array([0.0, 1.0, 0.0]), stiffness=100.0, free_length=0.9
    )
    rest = solve_equilibrium(parts, lab(spring))
    stretch = rest.config.x[0, 1] - rest.config.x[1, 1] - L
    assert rest.tension[0] == pytest.approx(0.5 * L * G, rel=1e-9)
    assert stretch == pytest.approx(0.5 * G * L**2 / (2 * 1e4), rel=1e-6)


def test_pinning_lets_undriven_motions_be():
    """Not held along x: nothing drives the bus there, the reactions are those of a bus held in x."""
    free, fixed = (solve_equilibrium(hung_bus(), cables(held=h)) for h in (("yz",) * 3, ("yz", "xyz", "yz")))
    assert free.suspension.reaction == pytest.approx(fixed.suspension.reaction, rel=1e-8)


def test_supports_that_hold_one_motion_twice_share_it():
    """Both ends of a rigid bar held in x, and three directions at each: statics decides the vertical ones."""
    bar = rigid_bar(6.0, 2.0, (0.1, 2, 2), attach_y=0.1)
    model = mesh_structure(bar)
    force = pinned_forces(model, PinnedPoints(model.attach_point, ("xyz", "xyz")))
    assert force == pytest.approx(np.array([[0, 3.0 * G, 0], [0, 3.0 * G, 0]]), abs=1e-6)


def test_light_stiff_article_far_from_the_origin_settles():
    """Rounding of positions in a steel strut is 1e-7 of this weight; it must count as rest."""
    steel = Section(EA=2e7, GJ=160.0, EI_y=200.0, EI_z=200.0, rho_A=0.78, rho_I_y=8e-6, rho_I_z=8e-6)
    nodes = [node(n, x, body(0.1, inertia=(1e-4,) * 3)) for n, x in (("a", (10, 0, 0)), ("b", (11, 0.3, 0)))]
    rest = solve_equilibrium(structure(nodes, [member("a", "b", steel, 40)]), Environment.orbit())
    assert rest.converged


def test_residual_is_the_largest_unbalanced_force_over_the_weight():
    parts = hung_bus()
    rest = solve_equilibrium(parts, cables())
    gradient = assemble(rest.model, rest.config, rest.loads).gradient[: 6 * rest.model.tree.roots]
    assert rest.residual == pytest.approx(np.abs(gradient).max() / (parts.mass * G), rel=1e-6)
    assert rest.history[-1] == (1.0, rest.residual, 0.0)  # the last step was a pure Newton step


def test_orbit_is_the_undeformed_structure():
    rest = solve_equilibrium(straight_beam(TURNING_TUBE, 2.0, 4), Environment.orbit())
    assert rest.config == rest.model.rest
    assert rest.suspension.attach == ()
