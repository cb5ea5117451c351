"""Modes about a rest state against closed forms of hanging, hinged and free bodies."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
from soft_and_stiff import draw

from middeck.structure.model.article import AttachPoint, JointState, Section, Spring
from middeck.structure.model.environment import AnchoredSpring, Environment, Suspension
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
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
    straight_beam,
    structure,
)

G = 9.80665
Z = np.array([0.0, 0.0, 1.0])


def modes_of(parts, environment=None) -> Modes:
    return solve_modes(solve_equilibrium(parts, environment or Environment.orbit()))


def named(modes: Modes) -> dict[str, float]:
    return dict(zip(modes.name, modes.omega, strict=True))


# Hanging rigid bodies


def two_spring_bar(h: float) -> tuple[Modes, dict[str, float]]:
    """Bar of half length a on springs of loaded length l, attached h above its centre of mass."""
    m, a, k, free, inertia = 6.0, 1.0, 40.0, 2.5, (0.3, 2.1, 2.0)
    points = {"left": (-a, h, 0), "right": (a, h, 0)}
    bar = rigid_bar(m, 2 * a, inertia, attach_y=h)
    modes = modes_of(bar, lab(*springs_above(points, 3.0, k, free)))
    length = free + m * G / (2 * k)
    return modes, {"m": m, "a": a, "k": k, "l": length, "Ix": inertia[0], "Iy": inertia[1], "Iz": inertia[2]}


def test_two_spring_bar():
    """Six closed forms; with h = 0 nothing couples and the roll about the bar is free."""
    modes, p = two_spring_bar(0.0)
    m, a, k, length = p["m"], p["a"], p["k"], p["l"]
    omega = named(modes)
    assert modes.kind.count("rigid") == 1
    assert modes.name[0] == "rotation x"
    assert omega["rotation x"] == 0.0
    assert omega["bounce"] == pytest.approx(np.sqrt(2 * k / m), rel=1e-8)
    assert omega["tilt z"] == pytest.approx(np.sqrt(2 * k * a**2 / p["Iz"]), rel=1e-8)
    assert omega["pendulum x"] == pytest.approx(np.sqrt(G / length), rel=1e-8)
    assert omega["pendulum z"] == pytest.approx(np.sqrt(G / length), rel=1e-8)
    assert omega["yaw"] == pytest.approx(np.sqrt(m * G * a**2 / (length * p["Iy"])), rel=1e-8)


@pytest.mark.parametrize("h", [0.02, 0.3])
def test_two_spring_bar_hung_above_its_centre(h: float):
    """With h > 0 roll and swing across couple, and so do tilt and swing along: two 2x2 problems."""
    modes, p = two_spring_bar(h)
    m, a, k, length = p["m"], p["a"], p["k"], p["l"]

    def coupled(inertia: float, springs: float) -> list[float]:
        """Potential: m g/l (s + h phi)^2 / 2 + (m g h + springs) phi^2 / 2."""
        t = m * G / length
        K = np.array([[t, t * h], [t * h, t * h**2 + m * G * h + springs]])
        return list(np.sqrt(sla.eigh(K, np.diag([m, inertia]), eigvals_only=True)))

    roll_and_across = coupled(p["Ix"], 0.0)
    tilt_and_along = coupled(p["Iz"], 2 * k * a**2)
    others = [np.sqrt(2 * k / m), np.sqrt(m * G * a**2 / (length * p["Iy"]))]
    expected = sorted([*roll_and_across, *tilt_and_along, *others])
    # The statics stop at 1e-9 of the weight.
    assert modes.omega == pytest.approx(expected, rel=1e-8)
    assert sorted(modes.name) == ["bounce", "pendulum x", "pendulum z", "tilt x", "tilt z", "yaw"]


@pytest.mark.parametrize("bounce_hz", [0.1, 0.25])
def test_a_suspension_tuned_to_its_load_bounces_at_its_frequency(bounce_hz: float):
    bar = rigid_bar(7.0, 2.0, (0.3, 2.0, 2.0), attach_y=0.1)
    suspension = Suspension(
        attach=("left", "right"), held=("xyz", "yz"), cable_length=4.0, bounce_hz=bounce_hz
    )
    omega = named(modes_of(bar, Environment(title="lab", gravity=GRAVITY, suspension=suspension)))
    assert omega["bounce"] == pytest.approx(2 * np.pi * bounce_hz, rel=1e-8)
    assert omega["yaw"] == pytest.approx(np.sqrt(7.0 * G / (4.0 * 2.0)), rel=1e-8)


def test_stiff_article_keeps_its_soft_suspension():
    """A gap of 1e9 between two omega^2 is no sign of rigid-body modes: these pendulums are real."""
    stiff = Section(EA=1e9, GJ=1e6, EI_y=1e6, EI_z=1e6, rho_A=1.0, rho_I_y=1e-3, rho_I_z=1e-3)
    nodes = [node(n, (x, 0, 0), body(1, (0, -0.1, 0), (1e-2,) * 3)) for n, x in (("a", 0.0), ("b", 0.5))]
    attach = [AttachPoint(n, n, np.array([0, 0.02, 0])) for n in "ab"]
    parts = structure(nodes, [member("a", "b", stiff, 2)], attach=attach)
    modes = modes_of(parts, on_cables(100.0, 0.25, ("xyz", "yz")))
    assert modes.kind[:6] == ("suspension",) * 6
    assert modes.kind[6] == "flexible"
    assert modes.omega[0] == pytest.approx(np.sqrt(G / 100.1), rel=5e-3)  # cg 0.12 m below a 100 m cable
    assert modes.omega[6] / modes.omega[0] > 4e4


# Joints


def two_discs(state: JointState, stiffness: float = 0.0, gap: float = 0.0):
    """Two coaxial discs, inertias 0.2 and 0.3 kg m^2 about z, hinged on their common axis."""
    hinge = joint("h", "a", Z, body(2.0, (0, gap, 0), (0.2, 0.2, 0.3)), state=state, stiffness=stiffness)
    return structure([node("a", (0.3, 0.2, 0.1), body(1.0, inertia=(0.1, 0.1, 0.2)))], joints=[hinge])


def test_sprung_hinge_between_free_discs():
    modes = modes_of(two_discs(JointState.SPRUNG, 5.0))
    assert modes.kind == ("rigid",) * 6 + ("flexible",)
    assert modes.omega[6] == pytest.approx(np.sqrt(5.0 * (1 / 0.2 + 1 / 0.3)), rel=1e-10)  # rounding
    assert modes.name[6] == "first joint"
    assert modes.strain_share[6] == pytest.approx(1.0)


@pytest.mark.parametrize("state", [JointState.LOCKED, JointState.DRIVEN])
def test_locked_or_driven_hinge_is_a_weld(state: JointState):
    nodes = [node("a", (0, 0, 0), body(1.0, (0, 0.1, 0), (0.1, 0.2, 0.3)))]
    end = node("b", (1, 0, 0), body(0.5, inertia=(0.01, 0.01, 0.01)))
    beam = member("a", "b", TURNING_TUBE, 4)
    arm = joint("h", "b", Z, body(2.0, (0, -0.3, 0), (0.1,) * 3), offset=(0.2, 0, 0), state=state)
    hinged = modes_of(structure([*nodes, end], [beam], [arm]))
    m, r = 2.5, np.array([0.2, -0.3, 0.0]) * 2.0 / 2.5
    inertia = 0.11 * np.eye(3)
    for mass, at in ((0.5, np.zeros(3)), (2.0, np.array([0.2, -0.3, 0.0]))):
        d = at - r
        inertia += mass * (d @ d * np.eye(3) - np.outer(d, d))
    welded_end = dataclasses.replace(end, body=dataclasses.replace(end.body, mass=m, cg=r, inertia=inertia))
    welded = modes_of(structure([*nodes, welded_end], [beam]))
    assert len(hinged.omega) == len(welded.omega)
    assert hinged.omega[:12] == pytest.approx(welded.omega[:12], rel=1e-10)  # rounding
    assert np.all(hinged.shapes[-1] == 0.0)


def test_free_gimbal_swings_under_its_constant_holding_torque():
    """On a heavy, stiffly held carrier: omega^2 = m g d cos(angle) / (I + m d^2)."""
    m, d, inertia, angle = 5.0, 0.08, 0.03, np.pi / 4
    payload = joint("p", "bar", Z, body(m, (0, -d, 0), (1, 1, inertia)), angle=angle)
    heavy = rigid_bar(1e7, 2.0, (1e7, 1e7, 1e7), attach_y=0.5)
    corners = [AttachPoint(f"c{i}", "bar", np.array([x, 0.5, z])) for i, (x, z) in enumerate(CORNERS)]
    parts = dataclasses.replace(heavy, joints=(payload,), attach_points=tuple(corners))
    springs = [
        AnchoredSpring(
            name=c.name,
            attach=c.name,
            anchor=c.offset + np.array([0, 2.0, 0]),
            stiffness=1e9,
            free_length=1.9,
        )
        for c in corners
    ]
    modes = modes_of(parts, lab(*springs))
    pendulum = modes.omega[modes.name.index("payload pendulum p")]
    # The carrier gives way by 1e-6 of the payload's motion; it also tilts by that under the torque.
    assert pendulum == pytest.approx(np.sqrt(m * G * d * np.cos(angle) / (inertia + m * d**2)), rel=1e-5)


CORNERS = ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0))


# Free bodies


def test_single_free_body_has_six_rigid_modes():
    """No flexible mode is there to compare with."""
    modes = modes_of(structure([node("a", (5, 4, 3), body(3.0, (0.1, 0, 0), (0.1, 0.2, 0.3)))]))
    assert modes.kind == ("rigid",) * 6
    assert np.all(modes.omega == 0.0)
    assert np.all(np.isfinite(modes.residual))


def test_free_flywheel_of_no_mass_keeps_its_inertia():
    wheel = joint("w", "a", np.eye(3)[0], body(0.0, inertia=(0.1, 0.05, 0.05)), state=JointState.FREE)
    parts = structure([node("a", (0, 0, 0), body(2.0, inertia=(0.1, 0.2, 0.3)))], joints=[wheel])
    assert modes_of(parts).kind == ("rigid",) * 7


def test_massless_torsion_is_left_out_not_called_unstable():
    """Without polar inertia the inner mesh nodes of a tube have torsions of infinite frequency."""
    bare = dataclasses.replace(TURNING_TUBE, rho_I_y=0.0, rho_I_z=0.0)
    nodes = [node(n, (x, 0, 0), body(1, inertia=(0.1,) * 3)) for n, x in (("a", 0.0), ("b", 1.0))]
    modes = modes_of(structure(nodes, [member("a", "b", bare, 4)]))
    assert len(modes.omega) == 30 - 3
    torsion = modes.omega[modes.name.index("first torsion")]
    assert torsion == pytest.approx(np.sqrt(2 * 80.0 / 0.1), rel=1e-10)


def test_massless_soft_members_beside_stiff_ones_leave_six_rigid_modes(campaign):
    """What has no mass rounds to a frequency without end, of either sign: it is none, and not rigid."""
    for seed in campaign(400):
        modes = modes_of(draw(np.random.default_rng([14, seed]), 1e-5))
        assert modes.kind.count("rigid") == 6
        assert modes.rigid_residual < 1e-6


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_pretensioned_free_body_keeps_six_rigid_modes(share: float):
    """A bow and its string balance each other: the preload must not hold or loosen the whole."""
    nodes = [
        node(n, x, body(1.0, (0.01, 0.02, 0.03), (0.02, 0.03, 0.04)))
        for n, x in (("a", (1, 2, 3)), ("b", (2, 2.1, 3)), ("c", (3, 2, 3.2)))
    ]
    attach = [AttachPoint(n, n, np.array([0.0, 0.1, 0.05])) for n in "ac"]
    apart = float(np.linalg.norm(np.array([2.0, 0.0, 0.2])))
    string = Spring(name="s", start="a", end="c", stiffness=200.0, free_length=share * apart)
    parts = structure(
        nodes, [member("a", "b", TURNING_TUBE, 3), member("b", "c", TURNING_TUBE, 3)], [], [string], attach
    )
    unstrung = dataclasses.replace(parts, springs=(dataclasses.replace(string, free_length=apart),))
    modes, slack = modes_of(parts), modes_of(unstrung)
    assert modes.kind[:7] == ("rigid",) * 6 + ("flexible",)
    assert modes.rigid_residual < 1e-9
    change = modes.omega[6] / slack.omega[6] - 1.0
    assert abs(change) > 1e-3  # the preload does act on the flexible modes


def test_strain_of_springs_counts():
    """Two bodies on a spring alone: all energy is in the spring, and the mode says so."""
    nodes = [node(n, (x, 0, 0), body(2.0, inertia=(0.1,) * 3)) for n, x in (("a", 0.0), ("b", 1.0))]
    attach = [AttachPoint(n, n, np.zeros(3)) for n in "ab"]
    parts = structure(
        nodes, attach=attach, springs=[Spring(name="s", start="a", end="b", stiffness=50.0, free_length=1.0)]
    )
    modes = modes_of(parts)
    assert modes.name[-1] == "first spring"
    assert modes.omega[-1] == pytest.approx(np.sqrt(50.0), rel=1e-10)
    assert modes.strain_share[-1] == pytest.approx(1.0)


# What every result promises


def hung_beam() -> Modes:
    parts = straight_beam(TURNING_TUBE, 2.0, 4)
    nodes = tuple(
        dataclasses.replace(n, body=body(2.0, (0, -0.05, 0.01), (0.1, 0.2, 0.3))) for n in parts.nodes
    )
    attach = tuple(AttachPoint(n.name, n.name, np.array([0, 0.02, 0])) for n in nodes)
    suspension = Suspension(attach=("a", "b"), held=("xyz", "yz"), cable_length=4.0, bounce_hz=0.25)
    parts = dataclasses.replace(parts, nodes=nodes, attach_points=attach)
    return modes_of(parts, Environment(title="lab", gravity=GRAVITY, suspension=suspension))


def test_shapes_are_mass_orthonormal_and_frequencies_ascend():
    for modes in (hung_beam(), modes_of(two_discs(JointState.FREE))):
        gram = modes.shapes.T @ (modes.mass @ modes.shapes)
        # Orthogonality of the two highest modes has lost omega^2/sigma = 1e11 of 1e-16.
        assert gram[:20, :20] == pytest.approx(np.eye(len(gram))[:20, :20], abs=1e-9)
        assert np.all(np.diff(modes.omega) >= 0.0)


def test_signs_do_not_hang_on_rounding():
    """In a symmetric beam two entries are equally large; the first of them is positive."""
    modes = hung_beam()
    kinetic = modes.shapes * (modes.mass @ modes.shapes)
    for m in range(12):
        large = np.flatnonzero(kinetic[:, m] > (1 - 1e-7) * kinetic[:, m].max())
        assert modes.shapes[large[0], m] > 0.0


def test_named_rigid_basis_splits_translations_from_the_rest():
    """Far from the world origin too: rotations are about the centre of mass."""
    far = structure([node("a", (1e4, 2e4, 0), body(3.0, (0.1, 0.2, 0), (0.1, 0.2, 0.3)))])
    modes = modes_of(far)
    assert modes.name == tuple(f"{w} {a}" for w in ("translation", "rotation") for a in "xyz")
    assert modes.shapes[3:, :3] == pytest.approx(np.zeros((3, 3)), abs=1e-10)
    # Cross moments of 3 kg at 2e4 m are 1e9 kg m^2: rounding leaves 1e-7 of 0.1 kg m^2.
    assert np.diag(modes.shapes[3:, 3:]) ** -2 == pytest.approx([0.1, 0.2, 0.3], rel=1e-3)


@pytest.mark.parametrize("state", [JointState.FREE, JointState.LOCKED, JointState.DRIVEN])
def test_the_one_rigid_mode_of_a_body_on_one_cable_is_its_yaw(state: JointState):
    """Skewed joints make rotation x partly rigid too; the name is that of the motion that is rigid whole."""
    axes = ((0.3, 0.0, 0.1), np.eye(3)[0]), ((-0.2, 0.0, 0.1), Z), ((0.0, 0.0, -0.3), np.eye(3)[0])
    inertia = (0.02, 0.03, 0.04)
    joints = [
        joint(f"p{i}", "a", axis, body(1.0 + i, (0.01, -0.2, 0.02), inertia), offset=at, state=state)
        for i, (at, axis) in enumerate(axes)
    ]
    carrier = node("a", (0.3, 0.2, 0.1), body(4.0, (0.02, -0.05, 0.03), (0.2, 0.3, 0.25)))
    parts = structure([carrier], joints=joints, attach=[AttachPoint("a", "a", np.array([0.05, 0.3, 0.02]))])
    modes = modes_of(parts, on_cables(3.0, 0.3, ("xyz",)))
    assert modes.kind.count("rigid") == 1
    assert modes.name[0] == "rotation y"
    turn = modes.shapes[3:6, 0] / np.abs(modes.shapes[3:6, 0]).max()
    assert turn == pytest.approx(
        np.array([0.0, 1.0, 0.0]), abs=1e-6
    )  # the statics stop at 1e-9 of the weight
    assert modes.strain_share[0] == 0.0


def test_rigid_modes_have_no_strain_to_share():
    """Their potential energy is rounding, of strain and of the whole alike."""
    modes = modes_of(straight_beam(dataclasses.replace(TURNING_TUBE, rho_I_y=1e-4), 2.0, 6))
    assert modes.kind[:6] == ("rigid",) * 6
    assert np.all(modes.strain_share[:6] == 0.0)
    assert modes.strain_share[6:9] == pytest.approx(1.0)
