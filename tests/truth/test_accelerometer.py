"""What an accelerometer reads: acceleration, and under gravity the tilt of its own axis."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.structure.elements.frames import frame_poses, move
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.model.article import (
    Actuator,
    ActuatorKind,
    AttachPoint,
    Damping,
    Sensor,
    SensorKind,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.sensors_and_actuators import output_rows as coordinate_rows
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.state_space.modal_system import modal_response, output_rows
from structure_builders import GRAVITY, body, lab, node, on_cables, structure, tube_bus

X, Y, Z = np.eye(3)
G = 9.80665
UNDAMPED = Damping()
ALL = 10**6


def accelerometer(name: str, frame: str, axis: np.ndarray, offset=(0.0, 0.0, 0.0)) -> Sensor:
    return Sensor(
        name=name,
        frame=frame,
        axis=axis,
        axis_frame="",
        kind=SensorKind.ACCELEROMETER,
        offset=np.array(offset, dtype=float),
    )


def response(modes: Modes, hz: np.ndarray, outputs, inputs, **kw) -> np.ndarray:
    plant = build_plant(modes, inputs=inputs, outputs=outputs, damping=UNDAMPED, **kw)
    return modal_response(plant.dynamics, 2.0 * np.pi * np.asarray(hz))


# A free rigid body


def free_body() -> Structure:
    m, inertia = 2.0, (0.3, 0.2, 0.1)
    push = Actuator(name="push", frame="a", axis=X, kind=ActuatorKind.FORCE, offset=np.array([0.0, 0.5, 0.0]))
    sensors = accelerometer("x", "a", X, (0.0, 0.5, 0.0)), accelerometer("y", "a", Y, (0.4, 0.0, 0.0))
    parts = node("a", (1, 2, 3), body(m, inertia=inertia))
    return structure([parts], (), (), (), (), [push, Actuator(name="turn", frame="a", axis=Z)], sensors)


def test_a_free_body_answers_at_once_and_alike_at_all_frequencies():
    # Newton and Euler: 1/m along the push, and the arm times the angular acceleration F arm / I.
    modes = solve_modes(solve_equilibrium(free_body(), Environment.orbit()))
    H = response(modes, [1e-3, 1.0, 1e3], ["x", "y"], ["push", "turn"])
    expected = [[1 / 2.0 + 0.5**2 / 0.1, -0.5 / 0.1], [-0.5 * 0.4 / 0.1, 0.4 / 0.1]]
    for line in H:
        np.testing.assert_allclose(line, expected, rtol=1e-12)  # rounding of mass-normalised shapes
    plant = build_plant(modes, inputs=["push", "turn"], outputs=["x", "y"])
    np.testing.assert_allclose(plant.system.D, expected, rtol=1e-12)
    assert not plant.system.C.any()  # nothing of the state: no gravity, nothing that holds it
    assert [p.unit for p in (*plant.inputs, *plant.outputs)] == ["N", "N m", "m/s^2", "m/s^2"]


# A rigid pendulum on a pivot that is held by springs


M, ARM, INERTIA, RISE = 3.0, 0.8, 0.25, 2.0
REST = M * G / 500.0  # stretch of the upright spring


def pendulum(k: float, r: float) -> tuple[Structure, Environment]:
    """Weight at ``ARM`` below the pivot, accelerometers along x and y at ``r`` below it."""
    springs = [("up", RISE * Y, 500.0, RISE - REST), ("x", X, k, 1.0), ("z", Z, k, 1.0)]
    anchors = tuple(
        AnchoredSpring(name=n, attach="pivot", anchor=p, stiffness=stiff, free_length=free)
        for n, p, stiff, free in springs
    )
    bob = node("bob", (0, 0, 0), body(M, (0.0, -ARM, 0.0), (0.3, 0.1, INERTIA)))
    sensors = [accelerometer("across", "bob", X, (0, -r, 0)), accelerometer("along", "bob", Y, (0, -r, 0))]
    sensors.append(Sensor(name="angle", frame="bob", axis=Z, axis_frame="bob"))
    attach = [AttachPoint("pivot", "bob", np.zeros(3))]
    parts = structure([bob], (), (), (), attach, [Actuator(name="turn", frame="bob", axis=Z)], sensors)
    return parts, lab(*anchors)


def test_a_rigid_pendulum_in_closed_form():
    """With s the pivot's shift and theta the swing: M s'' + k s + M l theta'' = 0, and

    M l s'' + (I + M l^2) theta'' + M g l theta = u;  the reading is s'' + r theta'' + g theta.
    The string's own lateral stiffness M g / RISE is part of k.
    """
    k, r = 4e3, 0.3
    modes = solve_modes(solve_equilibrium(*pendulum(k, r)))
    hz = np.array([1e-4, 0.01, 0.3, 1.0, 7.0, 50.0])
    H = response(modes, hz, ["across", "along"], ["turn"])[:, :, 0]
    stiffness = np.array([[k + M * G / RISE, 0.0], [0.0, M * G * ARM]])
    mass = np.array([[M, M * ARM], [M * ARM, INERTIA + M * ARM**2]])
    for w, reading in zip(2.0 * np.pi * hz, H, strict=True):
        s, theta = np.linalg.solve(stiffness - w**2 * mass, [0.0, 1.0])
        # The springs' horizontal ends have sunk by nothing: the rest state is the undeformed one, to 1e-9.
        expected = -(w**2) * (s + r * theta) + G * theta
        np.testing.assert_allclose(reading[0], expected, rtol=1e-7, atol=1e-9 / M)
        # Along the string nothing moves to first order, whatever the frequency.
        assert abs(reading[1]) < 1e-9 * abs(expected) + 1e-12


def test_nothing_is_felt_at_the_centre_of_oscillation():
    """Swinging freely, g theta = -r theta'' where r = g / omega^2 = (I + M l^2) / (M l) (Huygens 1673)."""
    k = 1e9
    r = (INERTIA + M * ARM**2) / (M * ARM)
    felt = []
    for place in (r, 0.5 * r):
        modes = solve_modes(solve_equilibrium(*pendulum(k, place)))
        plant = build_plant(modes, inputs=["turn"], outputs=["across", "angle"], damping=UNDAMPED)
        swing = int(np.argmin(np.abs(plant.dynamics.omega - np.sqrt(G / r))))
        rows = output_rows(plant.dynamics)
        felt.append(rows.position[0, swing] / rows.position[1, swing])
    # The pivot gives way by M g / k = 3e-8 of the arm.
    assert felt[0] == pytest.approx(0.0, abs=1e-6)
    assert felt[1] == pytest.approx(0.5 * G, rel=1e-6)


# A bus that hangs, with a payload on an axis, tilted and unsymmetrical


def bus(gravity=GRAVITY) -> tuple[Structure, Environment]:
    slanted, place = np.array([0.48, 0.6, 0.64]), np.array([0.1, -0.05, 0.2])
    sensors = [
        accelerometer("bus", "a", slanted, place),
        accelerometer("payload", "p", slanted, place),
        *(
            Sensor(name=f"a{n}", frame="a", axis=e, axis_frame="a")
            for n, e in zip("xyz", np.eye(3), strict=True)
        ),
        *(
            Sensor(name=f"p{n}", frame="p", axis=e, axis_frame="p")
            for n, e in zip("xyz", np.eye(3), strict=True)
        ),
    ]
    actuators = [Actuator(name="wheel", frame="a", axis=Z), Actuator(name="motor", frame="p", axis=None)]
    actuators.append(Actuator(name="shake", frame="a", axis=slanted, kind=ActuatorKind.FORCE, offset=place))
    payload = body(2.0, (0, -0.2, 0), (0.1,) * 3)
    more = {"parent": "b", "angle": 0.7, "actuators": actuators, "sensors": sensors}
    parts = tube_bus((4.0, 4.0), (0, -0.05, 0.01), (0.1, 0.2, 0.3), payload, **more)
    return parts, on_cables(4.0, 0.25, ("xyz", "yz"), gravity=gravity)


ACTUATORS = ["wheel", "motor", "shake"]


@pytest.fixture(scope="module")
def hanging() -> Modes:
    return solve_modes(solve_equilibrium(*bus()))


@pytest.mark.parametrize("frame", ["a", "p"])
def test_at_very_low_frequency_it_is_a_tiltmeter(hanging: Modes, frame: str):
    """-theta . (n x g) with theta from the three angles of the same frame, in its axes."""
    rest = hanging.equilibrium
    name = {"a": "bus", "p": "payload"}[frame]
    outputs = [name, *(f"{frame}{e}" for e in "xyz")]
    R = frame_poses(rest.model.tree, rest.config).R[rest.model.frames.index(frame)]
    n = next(s.axis for s in rest.model.structure.sensors if s.name == name)
    assert n is not None
    H = response(hanging, [0.0, 1e-5], outputs, ACTUATORS, count=ALL)
    tilt = -np.einsum("e,lei->li", np.cross(n, R.T @ rest.environment.gravity), H[:, 1:])
    assert np.abs(tilt).max() > 1e-2  # m/s^2 per N m
    np.testing.assert_allclose(H[0, 0], tilt[0], rtol=1e-12)  # the same rows
    # What the acceleration adds is (1e-5 Hz / 0.2 Hz)^2 of it.
    np.testing.assert_allclose(H[1, 0], tilt[1], rtol=1e-6)


def test_rows_against_finite_motions(hanging: Modes):
    """Specific force of the point and axis carried along by finite rotations, differentiated."""
    rest = hanging.equilibrium
    model, g = rest.model, rest.environment.gravity
    rows = coordinate_rows(rest, ["bus", "payload"])
    sensors = [s for s in model.structure.sensors if s.kind is SensorKind.ACCELEROMETER]

    def reading(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses = frame_poses(model.tree, move(model.tree, rest.config, q))
        at = [model.frames.index(s.frame) for s in sensors]
        axes = [poses.R[i] @ s.axis for i, s in zip(at, sensors, strict=True)]
        places = [poses.p[i] + poses.R[i] @ s.offset for i, s in zip(at, sensors, strict=True)]
        return np.array([-n @ g for n in axes]), np.array(places)

    still, h = np.array([s.axis for s in sensors]), 1e-5
    poses = frame_poses(model.tree, rest.config)
    axes = [poses.R[model.frames.index(s.frame)] @ n for s, n in zip(sensors, still, strict=True)]
    for j, q in enumerate(np.eye(model.tree.size)):
        after, before = reading(h * q), reading(-h * q)
        slope, moved = (after[0] - before[0]) / (2 * h), (after[1] - before[1]) / (2 * h)
        # Central differences: h^2 of truncation, 1e-11 of rounding.
        np.testing.assert_allclose(rows.position[:, j], slope, atol=1e-8)
        np.testing.assert_allclose(rows.acceleration[:, j], np.einsum("si,si->s", axes, moved), atol=1e-8)


def test_zero_g_leaves_acceleration_alone():
    modes = solve_modes(solve_equilibrium(bus()[0], Environment.orbit()))
    plant = build_plant(modes, inputs=ACTUATORS, outputs=["bus", "payload"], damping=UNDAMPED)
    assert not plant.dynamics.phi.any()
    assert not plant.dynamics.phi_rate.any()


def test_the_reading_is_reciprocal_to_a_force(hanging: Modes):
    """In 0-g acceleration over force at one place and axis is -omega^2 times a symmetric receptance."""
    modes = solve_modes(solve_equilibrium(bus()[0], Environment.orbit()))
    hz = np.geomspace(0.1, 100.0, 20)
    push = response(modes, hz, ["az"], ["shake"])[:, 0, 0]
    feel = response(modes, hz, ["bus"], ["wheel"])[:, 0, 0]
    np.testing.assert_allclose(feel, -((2.0 * np.pi * hz) ** 2) * push, rtol=1e-9)  # sums cancel by 1e3


def test_the_direct_term_is_that_of_the_kept_modes(hanging: Modes):
    for static in (False, True):
        plant = build_plant(hanging, inputs=ACTUATORS, outputs=["bus"], count=9, static=static)
        modal = plant.dynamics
        expected = modal.phi_acceleration @ modal.psi + (modal.direct if static else 0.0)
        np.testing.assert_allclose(plant.system.D, expected, rtol=1e-12)
    # With the residual the tilt is whole at rest, and the acceleration still that of the kept modes.
    full = response(hanging, [0.0], ["bus"], ACTUATORS, count=ALL)
    some = response(hanging, [0.0], ["bus"], ACTUATORS, count=9, static=True)
    np.testing.assert_allclose(some, full, atol=1e-9 * np.abs(full).max())  # rounding of K^-1


def rotated(parts: Structure, environment: Environment, R: np.ndarray) -> tuple[Structure, Environment]:
    def turn(part, *keys):
        return dataclasses.replace(
            part, **{k: R @ getattr(part, k) for k in keys if getattr(part, k) is not None}
        )

    def carry(part, *keys):
        b = part.body
        inertia = R @ b.inertia @ R.T
        moved = dataclasses.replace(b, cg=R @ b.cg, inertia=0.5 * (inertia + inertia.T))
        return dataclasses.replace(turn(part, *keys), body=moved)

    turned = dataclasses.replace(
        parts,
        nodes=tuple(carry(n, "position") for n in parts.nodes),
        joints=tuple(carry(j, "offset", "axis") for j in parts.joints),
        members=tuple(turn(m, "up") for m in parts.members),
        attach_points=tuple(turn(a, "offset") for a in parts.attach_points),
        actuators=tuple(turn(a, "axis", "offset") for a in parts.actuators),
        sensors=tuple(turn(s, "axis", "offset") for s in parts.sensors),
    )
    return turned, turn(environment, "gravity")


def test_rotating_article_and_gravity_together_changes_nothing():
    parts = bus()[0]
    springs = tuple(
        AnchoredSpring(
            name=f"s{n}", attach=n, anchor=p + np.array([0.1, 4.0, 0.2]), stiffness=60.0, free_length=2.0
        )
        for n, p in (("a", 0 * X), ("b", X))
    )
    upright = Environment(title="springs", gravity=GRAVITY, suspension=None, springs=springs)
    R = rotation_exp(np.array([0.7, -1.1, 0.4]))
    turned, down = rotated(parts, upright, R)
    moved = tuple(dataclasses.replace(s, anchor=R @ s.anchor) for s in springs)
    hz = np.geomspace(0.01, 50.0, 12)
    H = [
        response(solve_modes(solve_equilibrium(*case)), hz, ["bus", "payload"], ACTUATORS)
        for case in ((parts, upright), (turned, dataclasses.replace(down, springs=moved)))
    ]
    # Two rest states to 1e-9 of the weight, two eigensolutions.
    np.testing.assert_allclose(H[1], H[0], atol=1e-9 * np.abs(H[0]).max())


def test_bad_ports_are_refused():
    with pytest.raises(ConfigError, match="needs an axis"):
        Sensor(name="s", frame="a", axis=None, axis_frame="", kind=SensorKind.ACCELEROMETER)
    with pytest.raises(ConfigError, match="needs an axis"):
        Actuator(name="f", frame="a", axis=None, kind=ActuatorKind.FORCE)
    with pytest.raises(ConfigError, match="fixed to its own frame 'a'"):
        Sensor(name="s", frame="a", axis=X, axis_frame="b", kind=SensorKind.ACCELEROMETER)
    with pytest.raises(ConfigError, match="has no offset"):
        Sensor(name="s", frame="a", axis=X, axis_frame="a", offset=np.array([0.0, 1.0, 0.0]))
    with pytest.raises(ConfigError, match="has no offset"):
        Actuator(name="t", frame="a", axis=X, offset=np.array([0.0, 1.0, 0.0]))
    modes = solve_modes(solve_equilibrium(free_body(), Environment.orbit()))
    with pytest.raises(ConfigError, match="'x' has no rate"):
        build_plant(modes, inputs=["push"], outputs=["x_rate"])
