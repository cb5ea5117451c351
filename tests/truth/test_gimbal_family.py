"""Families over gimbal angles: holding torques and pendulums in closed form, also past the horizontal."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, UnstableEquilibriumError
from middeck.files.setups import load_setup
from middeck.plot.gimbal_family import draw_gimbal_family
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gimbals.family import GimbalFamily, sweep_gimbals
from middeck.structure.model.article import (
    Actuator,
    AttachPoint,
    JointState,
    Sensor,
    Structure,
)
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.state_space.modal_system import modal_response
from structure_builders import GRAVITY, body, joint, node, on_cables, structure

G = 9.80665
M, D, INERTIA = 5.0, 0.08, np.array([0.03, 0.01, 0.02])
X, Z = np.eye(3)[0], np.eye(3)[2]
# A foundation that hardly gives: 4e8 N m/rad turn by 1e-8 rad under the payload's 4 N m, and 6e8 N/m let the
# carrier follow the swinging payload by (M D omega)^2 / (I K) = 3e-7 of omega^2.
CARRIER, STIFF, ARM = 1.0, 1e8, 1.0


def payload(state: JointState = JointState.FREE, **more) -> Structure:
    """One axis along x in a carrier that is as good as fixed, its payload hanging a distance D below."""
    arm = joint("p", "base", X, body(M, (0, -D, 0), INERTIA), state=state, **more)
    points = {
        f"{sign}{axis}": ARM * s * np.eye(3)[i]
        for i, axis in enumerate("xyz")
        for s, sign in ((1.0, "up_"), (-1.0, "down_"))
    }
    return structure(
        [node("base", (0, 0, 0), body(CARRIER, inertia=(CARRIER,) * 3))],
        joints=[arm],
        attach=[AttachPoint(name, "base", at) for name, at in points.items()],
        actuators=[Actuator(name="motor", frame="p", axis=None)],
        sensors=[Sensor(name="angle", frame="p", axis=None)],
    )


def held(gravity: np.ndarray = GRAVITY) -> Environment:
    """The carrier on six springs of no free length, alike in all directions, above it by their sag."""
    parts = payload()
    rise = -(CARRIER + M) * gravity / (6.0 * STIFF)
    return Environment(
        title="foundation",
        gravity=gravity,
        springs=tuple(
            AnchoredSpring(
                name=p.name, attach=p.name, anchor=p.offset + rise, stiffness=STIFF, free_length=0.0
            )
            for p in parts.attach_points
        ),
    )


ANGLES = np.radians([-60.0, -30.0, 0.0, 20.0, 45.0, 75.0])


@pytest.fixture(scope="module")
def family() -> GimbalFamily:
    return sweep_gimbals(
        payload(torque_limit=3.0), held(), {"p": ANGLES}, inputs=["motor"], outputs=["angle"]
    )


def branch(found: GimbalFamily, name: str) -> np.ndarray:
    return found.omega2[:, found.name.index(name)]


def test_holding_torque_is_m_g_d_sine(family: GimbalFamily):
    # The carrier turns by 1e-8 rad.
    assert family.holding_torque[:, 0] == pytest.approx(M * G * D * np.sin(ANGLES), rel=1e-7, abs=1e-7)


def test_pendulum_frequency_follows_the_cosine(family: GimbalFamily):
    about = INERTIA[0] + M * D**2
    expected = np.sqrt(M * G * D * np.cos(ANGLES) / about) / (2 * np.pi)
    pendulum = np.sqrt(branch(family, "payload pendulum p")) / (2 * np.pi)
    # The carrier follows, see above.
    assert pendulum == pytest.approx(expected, rel=1e-6)
    assert family.frequency_hz[:, family.name.index("payload pendulum p")] == pytest.approx(pendulum)
    assert family.stable == (True,) * len(ANGLES)
    assert family.limits == ()
    assert family.doubtful == ()


def test_the_motor_limit_is_held_against_the_holding_torque(family: GimbalFamily):
    over = [p for p, a in enumerate(ANGLES) if M * G * D * abs(np.sin(a)) > 3.0]
    beyond = np.abs(family.holding_torque[:, 0]) > family.torque_limit[0]
    assert np.flatnonzero(beyond).tolist() == over
    assert len(over) == 2


def test_each_plant_is_that_of_the_article_with_its_axis_there(family: GimbalFamily):
    for p in (0, 3):
        there = payload()
        there = dataclasses.replace(there, joints=(dataclasses.replace(there.joints[0], angle=ANGLES[p]),))
        modes = solve_modes(solve_equilibrium(there, held()))
        plant = build_plant(modes, inputs=["motor"], outputs=["angle"])
        omega = np.array([1.0, 5.0, 20.0])
        # The same computation.
        assert modal_response(family.plants[p].dynamics, omega) == pytest.approx(
            modal_response(plant.dynamics, omega), rel=1e-12
        )


def test_past_the_horizontal_is_a_value_and_the_angle_of_loss_is_found():
    angles = np.radians([0.0, 40.0, 80.0, 100.0, 140.0])
    found = sweep_gimbals(payload(), held(), {"p": angles}, inputs=["motor"], outputs=["angle"])
    about = INERTIA[0] + M * D**2
    assert branch(found, "payload pendulum p") == pytest.approx(M * G * D * np.cos(angles) / about, rel=1e-6)
    assert found.stable == (True, True, True, False, False)
    assert [plant is None for plant in found.plants] == [False, False, False, True, True]
    assert all("mode 'payload pendulum p' grows" in text for text in found.diagnosis[3:])
    (limit,) = found.limits
    assert not limit.jumps
    assert limit.name == "payload pendulum p"
    assert limit.joint == "p"
    # The carrier leans by 1e-8 rad; the angle is sought to 1e-9.
    assert limit.angle == pytest.approx(np.pi / 2, abs=1e-7)
    assert limit.unstable == 3
    assert limit.sentence == "'payload pendulum p' loses stability at p = 90 deg"
    # The torque at 140 degrees holds as at 40, though not still.
    assert found.holding_torque[4, 0] == pytest.approx(found.holding_torque[1, 0], rel=1e-7)
    assert np.all(found.frequency_hz[3:, found.name.index("payload pendulum p")] < 0.0)


def test_the_hung_article_is_stable_up_to_the_limit_and_not_beyond():
    """The limit is met by independent solutions on either side of it."""
    coarse = ["mesh.elements_per_strut=1"]
    parts, lab = load_setup("articles/mace-dm.toml", "environments/lab.toml", coarse)
    found = sweep_gimbals(parts, lab, {"pri_z": np.radians([80.0, 90.0])}, count=10)
    (limit,) = found.limits
    assert not limit.jumps
    assert limit.name.startswith("payload pendulum pri")
    at = [j.name for j in parts.joints].index("pri_z")

    def turned(angle: float) -> Structure:
        joints = list(parts.joints)
        joints[at] = dataclasses.replace(joints[at], angle=angle)
        return dataclasses.replace(parts, joints=tuple(joints))

    for beyond in (-1e-5, 1e-5):
        rest = solve_equilibrium(turned(limit.angle + beyond), lab)
        if beyond < 0.0:
            assert solve_modes(rest).omega[0] > 0.0
        else:
            with pytest.raises(UnstableEquilibriumError, match="payload pendulum pri"):
                solve_modes(rest)


def test_neighbours_that_were_reached_by_different_ways_are_one_family():
    """Four corners: at the far one a mode grows, and branches have other numbers by way of either axis."""
    coarse = ["mesh.elements_per_strut=1"]
    parts, lab = load_setup("articles/mace-simple.toml", "environments/lab.toml", coarse)
    angles = np.radians([0.0, 60.0])
    found = sweep_gimbals(parts, lab, {"pri_z": angles, "pri_x": angles}, count=10)
    assert found.stable == (True, True, True, False)
    assert [(x.joint, x.unstable) for x in found.limits] == [("pri_z", 3), ("pri_x", 3)]
    for limit in found.limits:
        assert f"mode {limit.name!r} grows" in found.diagnosis[3]
    # The one along pri_z is met by independent solutions on either side of it.
    where = {x.joint: x for x in found.limits}["pri_z"].at
    number = [[j.name for j in parts.joints].index(n) for n in ("pri_z", "pri_x")]
    for beyond in (-1e-5, 1e-5):
        joints = list(parts.joints)
        for i, angle in zip(number, (where[0] + beyond, where[1]), strict=True):
            joints[i] = dataclasses.replace(joints[i], angle=angle)
        rest = solve_equilibrium(dataclasses.replace(parts, joints=tuple(joints)), lab)
        if beyond < 0.0:
            assert solve_modes(rest).omega[0] > 0.0
        else:
            with pytest.raises(UnstableEquilibriumError):
                solve_modes(rest)


def two_axes() -> Structure:
    parts = payload()
    stage = joint("x", "base", X)
    inner = joint("z", "x", Z, body(M, (0, -D, 0), INERTIA))
    return dataclasses.replace(parts, joints=(stage, inner), actuators=(), sensors=())


def test_two_axes_at_forty_five_degrees_and_elsewhere():
    """Height of the centre of mass -d cos(a) cos(b): torques are its slopes, stiffnesses its curvatures."""
    outer, inner = np.radians([0.0, 45.0]), np.radians([-20.0, 0.0, 30.0])
    found = sweep_gimbals(two_axes(), held(), {"x": outer, "z": inner}, count=8)
    assert found.shape == (2, 3)
    a, b = found.angle.T
    weight = M * G * D
    assert found.holding_torque[:, 0] == pytest.approx(weight * np.sin(a) * np.cos(b), rel=1e-7, abs=1e-7)
    assert found.holding_torque[:, 1] == pytest.approx(weight * np.cos(a) * np.sin(b), rel=1e-7, abs=1e-7)
    curve = [
        weight
        * np.array(
            [[np.cos(p) * np.cos(q), -np.sin(p) * np.sin(q)], [-np.sin(p) * np.sin(q), np.cos(p) * np.cos(q)]]
        )
        for p, q in zip(a, b, strict=True)
    ]
    for point, K in enumerate(curve):
        # About the outer axis the payload's inertia at the inner angle, about the inner its own.
        q = b[point]
        lever = INERTIA + M * D**2 * np.array([1.0, 0.0, 1.0])
        mass = np.diag([lever[0] * np.cos(q) ** 2 + lever[1] * np.sin(q) ** 2, lever[2]])
        expected = np.sort(np.linalg.eigvals(np.linalg.solve(mass, K)).real)
        pair = [found.name.index(f"payload pendulum {n}") for n in "xz"]
        assert np.sort(found.omega2[point, pair]) == pytest.approx(expected, rel=1e-6)  # as above


def test_a_driven_axis_goes_to_its_command():
    found = sweep_gimbals(payload(JointState.DRIVEN), held(), {"p": [0.1, 0.4]})
    assert [rest.config.angle[0] for rest in found.rests] == [0.1, 0.4]
    assert found.holding_torque[:, 0] == pytest.approx(M * G * D * np.sin([0.1, 0.4]), rel=1e-7)
    assert found.plants == (None, None)  # no ports were asked for


def test_in_orbit_nothing_is_held_and_all_stays_free():
    found = sweep_gimbals(payload(), Environment.orbit(), {"p": [0.0, 1.0, 2.0]})
    assert np.array_equal(found.holding_torque, np.zeros((3, 1)))
    assert np.array_equal(found.omega2, np.zeros((3, 7)))
    assert found.stable == (True,) * 3


def test_a_point_without_a_rest_state_does_not_lose_the_others():
    """A light carrier on one cable, its second unloaded as the payload swings over to the other side."""
    arm = joint("arm", "base", Z, body(6.0, (0, -1.0, 0), (0.3, 0.3, 0.3)))
    parts = structure(
        [node("base", (0, 0, 0), body(2.0, inertia=(0.2,) * 3))],
        joints=[arm],
        attach=[AttachPoint(n, "base", np.array([x, 0.1, 0.0])) for n, x in (("l", -0.4), ("r", 0.4))],
    )
    lab = dataclasses.replace(Environment.lab(parts), title="lab")
    found = sweep_gimbals(parts, lab, {"arm": np.radians([-10.0, 0.0, 60.0])})
    assert found.stable == (True, True, False)
    assert "slack" in found.diagnosis[2]
    assert found.rests[2] is None
    assert np.all(np.isnan(found.omega2[2]))
    assert np.all(np.isfinite(found.omega2[:2]))
    assert np.isnan(found.holding_torque[2, 0])


def test_a_rest_state_that_ends_between_two_points_is_a_limit(monkeypatch: pytest.MonkeyPatch):
    """The centre of mass leaves the span of the cables, by lever arms; beyond, the payload is on top.

    A trial in between had no rest state, and the limit was left out.
    """
    arm = joint("arm", "base", Z, body(3.0, (0, -0.5, 0), (0.02,) * 3))
    parts = structure(
        [node("base", (0, 0, 0), body(1.0, inertia=(0.01,) * 3))],
        joints=[arm],
        attach=[AttachPoint(n, "base", np.array([x, 0.3, 0.0])) for n, x in (("l", -0.15), ("r", 0.15))],
    )
    lab = on_cables(3.0, 0.5, ("yz", "xyz"), attach="lr")
    monkeypatch.setattr("middeck.structure.gimbals.family.FINEST", 1e-6)  # each bit is a rest state
    found = sweep_gimbals(parts, lab, {"arm": [0.0, np.pi]})
    assert [rest is not None for rest in found.rests] == [True, True]
    (limit,) = found.limits
    assert limit.angle == pytest.approx(np.arcsin(0.15 * 4.0 / (0.5 * 3.0)), abs=2e-6)
    assert "cable at 'l' would be slack" in limit.no_rest
    assert limit.sentence.startswith("no rest state beyond arm = 23.578")
    assert not limit.jumps


def test_the_figure_shows_frequencies_and_torques_of_one_cut(family: GimbalFamily):
    figure = draw_gimbal_family(family)
    top, bottom = figure.axes
    drawn = {line.get_label(): line.get_ydata() for line in top.lines}
    column = family.name.index("payload pendulum p")
    assert np.array_equal(drawn["payload pendulum p"], family.frequency_hz[:, column])
    assert np.array_equal(bottom.lines[0].get_ydata(), family.holding_torque[:, 0])
    assert [line.get_ydata()[0] for line in bottom.lines[1:]] == [-3.0, 3.0]  # the motor's limit
    grid = sweep_gimbals(two_axes(), held(), {"x": [0.0, 0.5], "z": [-0.3, 0.0, 0.4]}, count=8)
    # Nothing grows: no room below zero, and the title names the case.
    assert top.get_ylim()[0] > 0.0
    assert top.get_ylabel() == "frequency [Hz]"
    assert top.get_title(loc="left").endswith("; foundation")
    assert bottom.get_legend_handles_labels()[1] == ["p", "limit of p"]
    text = " ".join(t.get_text().replace("\n", " ") for t in top.texts)
    assert all(name in text or name in drawn for name in family.name)  # none is left without its name
    looks = [
        (x.get_color(), x.get_linestyle(), x.get_marker()) for x in top.lines if x.get_marker() != "None"
    ]
    assert len(set(looks)) == len(looks)
    cut = draw_gimbal_family(grid, "z", others=[0.5])
    assert np.array_equal(cut.axes[1].lines[0].get_ydata(), grid.holding_torque[3:, 0])
    for arguments in (("y", None), ("z", [0.25]), ("z", [0.0, 0.5])):
        with pytest.raises(ConfigError):
            draw_gimbal_family(grid, arguments[0], others=arguments[1])


@pytest.mark.parametrize(
    ("angles", "parts", "message"),
    [
        ({}, payload(), "no joint to turn"),
        ({"q": [0.0]}, payload(), "joint 'q' there is not"),
        (
            {"p": [0.0]},
            payload(JointState.SPRUNG, stiffness=3.0),
            "rests where its spring and its load put it",
        ),
        ({"p": [0.2, 0.1]}, payload(), "do not ascend"),
        ({"p": []}, payload(), "do not ascend"),
        ({"p": [np.nan]}, payload(), "do not ascend"),
        ({"p": np.radians([0.0, 95.0])}, payload(travel=(-np.pi / 2, np.pi / 2)), "'p' cannot go to 95 deg"),
    ],
)
def test_what_cannot_be_swept_is_refused(angles, parts: Structure, message: str):
    with pytest.raises(ConfigError, match=message) as error:
        sweep_gimbals(parts, held(), angles)
    assert error.value.where == "angles"


def test_a_grid_without_any_stable_point_says_so():
    with pytest.raises(UnstableEquilibriumError, match=r"no point of the grid .* 'payload pendulum p' grows"):
        sweep_gimbals(payload(), held(), {"p": np.radians([120.0, 150.0])})


def test_a_rest_state_that_jumps_is_no_mode_that_loses_stability(monkeypatch: pytest.MonkeyPatch):
    """A sprung axis softer than its payload's weight has several rest angles; by their own energy."""
    axes, g = np.array([[0.0, -0.32, -0.95], [-0.74, -0.52, -0.44]]), np.array([0.52, -0.83, 0.2])
    axes, g = axes / np.linalg.norm(axes, axis=1)[:, None], G * g / np.linalg.norm(g)
    cg, offset = np.array([[-0.03, 0.03, -0.06], [-0.27, -0.18, 0.21]]), np.array([0.2, 0.07, 0.02])
    masses, stiffness, free = (0.46, 2.52), 1.6, 0.98
    payload = joint(
        "b",
        "a",
        axes[1].tolist(),
        body(masses[1], cg[1].tolist(), (0.05,) * 3),
        offset=offset.tolist(),
        stiffness=stiffness,
        angle=free,
        target=free,
    )
    carried = joint("a", "base", axes[0].tolist(), body(masses[0], cg[0].tolist(), (0.01,) * 3))
    parts = structure([node("base", (0, 0, 0), body(1.0, inertia=(1.0,) * 3))], joints=[carried, payload])
    place = Environment(title="bench", gravity=g, clamps=(Clamp(node="base"),))

    def energy(q: np.ndarray) -> float:
        first, last = (rotation_exp(q[i] * axes[i]) for i in (0, 1))
        fall = masses[0] * first @ cg[0] + masses[1] * first @ (offset + last @ cg[1])
        return float(0.5 * stiffness * (q[1] - free) ** 2 - g @ fall)

    def curvature(q: np.ndarray, h: float = 1e-3) -> np.ndarray:
        e = h * np.eye(2)
        rise = [[energy(q + a + b) - energy(q + a - b) for b in e] for a in (*e, *-e)]
        return (np.array(rise[:2]) - rise[2:]) / (4.0 * h * h)

    monkeypatch.setattr(
        "middeck.structure.gimbals.family.FINEST", 1e-5
    )  # of a jump each digit is a rest state
    (limit,) = sweep_gimbals(parts, place, {"a": [0.984, 0.986]}).limits
    assert limit.jumps
    assert "jumps" in limit.sentence
    sides = []
    for step in (-2e-5, 2e-5):
        there = dataclasses.replace(carried, angle=limit.angle + step)
        turned = dataclasses.replace(parts, joints=(there, payload))
        sides.append(solve_equilibrium(turned, place).config.angle)
    assert abs(sides[1][1] - sides[0][1]) > 1.0
    least = [np.linalg.eigvalsh(curvature(q))[0] for q in sides]
    assert least[0] > 0.05
    assert least[1] < -0.05
