"""The plant of a structure: reciprocity, statics, rigid inertia and ports that turn with their bodies."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.elements.frames import frame_poses, move
from middeck.structure.elements.rotations import rotation_log
from middeck.structure.model.article import Actuator, Damping, JointState, Sensor
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.systems.state_space.modal_system import modal_response
from structure_builders import body, joint, node, on_cables, structure, tube_bus

X, Y, Z = np.eye(3)
PORTS = ("wheel", "tilted", "motor")
ALL = 1000


def article(state: JointState = JointState.FREE, angle: float = 0.7):
    """A bus with a payload on an axis, torques on a node about two of its axes and at the joint."""
    slanted = np.array([0.6, 0.0, 0.8])
    actuators = [
        Actuator(name="wheel", frame="a", axis=Z),
        Actuator(name="tilted", frame="a", axis=slanted),
        Actuator(name="motor", frame="p", axis=None),
    ]
    sensors = [
        Sensor(name="wheel", frame="a", axis=Z, axis_frame="a"),
        Sensor(name="tilted", frame="a", axis=slanted, axis_frame="a"),
        Sensor(name="motor", frame="p", axis=None),
        Sensor(name="payload", frame="p", axis=Z, axis_frame="p"),
        Sensor(name="across", frame="p", axis=Z, axis_frame="b"),
    ]
    payload = body(2.0, (0, -0.2, 0), (0.1,) * 3)
    joint = {"parent": "b", "angle": angle, "state": state}
    ports = {"actuators": actuators, "sensors": sensors}
    return tube_bus((4.0, 4.0), (0, -0.05, 0.01), (0.1, 0.2, 0.3), payload, **joint, **ports)


def lab_modes(**kw) -> Modes:
    return solve_modes(solve_equilibrium(article(**kw), on_cables(4.0, 0.25, ("xyz", "yz"))))


def orbit_modes(**kw) -> Modes:
    return solve_modes(solve_equilibrium(article(**kw), Environment.orbit()))


@pytest.mark.parametrize("modes", [lab_modes(), orbit_modes()], ids=["lab", "orbit"])
def test_reciprocity(modes: Modes):
    """Torque and angle at one place and axis: the response matrix is symmetric (Betti, Rayleigh)."""
    plant = build_plant(modes, inputs=PORTS, outputs=PORTS)
    response = modal_response(plant.dynamics, 2 * np.pi * np.geomspace(0.05, 100.0, 50))
    assert response == pytest.approx(np.swapaxes(response, 1, 2), abs=1e-12 * np.abs(response).max())


def measured_angles(rest: Equilibrium, q: np.ndarray) -> np.ndarray:
    """What the five sensors read after a small move, from finite rotations alone."""
    model = rest.model
    config = move(model.tree, rest.config, q)
    before, after = frame_poses(model.tree, rest.config), frame_poses(model.tree, config)
    names = {n: i for i, n in enumerate(model.frames)}

    def read(sensor: Sensor) -> float:
        if sensor.axis is None:
            return config.angle[0] - rest.config.angle[0]
        turn = rotation_log(after.R[names[sensor.frame]] @ before.R[names[sensor.frame]].T)
        return turn @ (before.R[names[sensor.axis_frame]] @ sensor.axis)

    return np.array([read(s) for s in model.structure.sensors])


def test_static_gain_is_the_inverse_tangent():
    """All modes kept; loads and readings by virtual work from finite rotations."""
    modes = lab_modes()
    rest = modes.equilibrium
    outputs = [s.name for s in rest.model.structure.sensors]
    plant = build_plant(modes, inputs=PORTS, outputs=outputs, count=ALL)
    h = 1e-5
    n = rest.model.tree.size
    change = [measured_angles(rest, h * q) - measured_angles(rest, -h * q) for q in np.eye(n)]
    rows = np.array(change).T / (2 * h)
    # The work of a torque is torque times what the sensor beside it reads.
    active = dynamic_coordinates(rest.model)
    K = assemble(rest.model, rest.config, rest.loads).tangent[active][:, active].toarray()
    expected = rows[:, active] @ np.linalg.solve(K, rows[:3, active].T)
    gain = modal_response(plant.dynamics, np.array([0.0]))[0].real
    # Differences leave 1e-10, the highest modes 1e-4 of their own 1e-9 share.
    assert gain == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


def test_rigid_gain_is_the_inverse_inertia():
    """Payload locked, in orbit: the double integrator is 1/I of the whole about its centre of mass."""
    modes = orbit_modes(state=JointState.LOCKED)
    plant = build_plant(modes, inputs=["wheel", "tilted"], outputs=["wheel", "tilted"], count=6)
    parts, masses = [], []
    for position, cg, m in (((0, 0, 0), (0, -0.05, 0.01), 4.0), ((1, 0, 0), (0, -0.05, 0.01), 4.0)):
        parts.append(np.add(position, cg))
        masses.append(m)
    c, s = np.cos(0.7), np.sin(0.7)
    parts.append(np.array([1.0, -0.05 - 0.2 * c, -0.2 * s]))
    masses.append(2.0)
    rod = 0.5 * 0.95
    parts.append(np.array([0.5, 0.0, 0.0]))
    masses.append(rod)
    masses = np.array(masses)
    parts = np.array(parts) - masses @ np.array(parts) / masses.sum()
    inertia = 2 * np.diag([0.1, 0.2, 0.3]) + 0.1 * np.eye(3)
    inertia += np.diag([0, rod * 0.95**2 / 12, rod * 0.95**2 / 12]) + 0.95 * np.diag([2e-4, 1e-4, 1e-4])
    inertia += sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, parts, strict=True))
    axes = np.array([Z, [0.6, 0.0, 0.8]])
    expected = axes @ np.linalg.inv(inertia) @ axes.T
    assert plant.dynamics.phi @ plant.dynamics.psi == pytest.approx(expected, rel=1e-10)  # rounding
    assert np.all(plant.dynamics.omega == 0.0)


def test_rigid_gain_of_a_motor_between_free_bodies():
    """Two free bodies on a common principal axis: 1/I1 + 1/I2 at the joint angle."""
    payload = joint("p", "a", X, body(2.0, inertia=(0.3, 0.2, 0.2)), angle=0.3)
    base = node("a", (0, 0, 0), body(1.0, inertia=(0.2, 0.1, 0.1)))
    ports = (
        [Actuator(name="motor", frame="p", axis=None)],
        [Sensor(name="motor", frame="p", axis=None), Sensor(name="base", frame="a", axis=X, axis_frame="a")],
    )
    modes = solve_modes(
        solve_equilibrium(structure([base], (), [payload], (), (), *ports), Environment.orbit())
    )
    plant = build_plant(modes, inputs=["motor"], outputs=["motor", "base"])
    gains = (plant.dynamics.phi @ plant.dynamics.psi)[:, 0]
    assert gains == pytest.approx(
        [1 / 0.2 + 1 / 0.3, -1 / 0.2], rel=1e-10
    )  # rounding; the carrier turns back


def test_rates_are_derivatives_of_angles():
    plant = build_plant(lab_modes(), inputs=PORTS, outputs=["motor", "motor_rate", "across", "across_rate"])
    omega = 2 * np.pi * np.geomspace(0.05, 50.0, 20)
    response = modal_response(plant.dynamics, omega)
    for angle in (0, 2):
        rate = 1j * omega[:, None] * response[:, angle]
        assert response[:, angle + 1] == pytest.approx(rate, rel=1e-12)  # rounding
    assert [p.unit for p in plant.outputs] == ["rad", "rad/s", "rad", "rad/s"]


def test_damping_goes_by_rank_or_by_energy():
    """By energy a pendulum that bends its carrier a little has less than the suspension's ratio."""
    modes = lab_modes()
    ranked = Damping(flexible=0.01, suspension=0.03, by_rank=True)
    lab = build_plant(modes, inputs=PORTS, outputs=PORTS, count=12, damping=ranked)
    assert lab.dynamics.zeta == pytest.approx([0.03] * 7 + [0.01] * 5)
    strain = modes.strain_share[:12]
    weighed = build_plant(modes, inputs=PORTS, outputs=PORTS, count=12)
    assert weighed.dynamics.zeta == pytest.approx(0.01 * strain + 0.03 * (1.0 - strain))
    given = Damping(flexible=0.02, suspension=0.1, rigid=0.0)
    orbit = build_plant(orbit_modes(), inputs=PORTS, outputs=PORTS, count=9, damping=given)
    assert orbit.dynamics.zeta == pytest.approx([0.0] * 7 + [0.02] * 2)


def test_groups_and_names_pass_through():
    modes = lab_modes()
    plant = build_plant(
        modes, inputs=PORTS, outputs=PORTS, count=4, w=["motor"], u=["wheel"], z=["tilted"], y=["wheel"]
    )
    assert (plant.w, plant.u, plant.z, plant.y) == (("motor",), ("wheel",), ("tilted",), ("wheel",))
    assert plant.dynamics.names == modes.name[:4]


@pytest.mark.parametrize("state", [JointState.LOCKED, JointState.DRIVEN])
def test_no_torque_at_a_fixed_axis(state: JointState):
    modes = orbit_modes(state=state)
    with pytest.raises(ConfigError, match=f"'motor' turns axis 'p', which is {state.value}"):
        build_plant(modes, inputs=["motor"], outputs=["wheel"])
    still = build_plant(modes, inputs=["wheel"], outputs=["motor"])
    assert np.all(still.dynamics.phi == 0.0)


def test_unknown_ports_are_named():
    modes = orbit_modes()
    with pytest.raises(ConfigError, match="no actuator 'whel'") as actuator:
        build_plant(modes, inputs=["whel"], outputs=["wheel"])
    assert "wheel, tilted, motor" in actuator.value.hint
    with pytest.raises(ConfigError, match="no sensor 'gyro'") as sensor:
        build_plant(modes, inputs=["wheel"], outputs=["gyro_rate"])
    assert "payload_rate" in sensor.value.hint
    parts = dataclasses.replace(modes.equilibrium.model.structure, actuators=(), sensors=())
    bare = solve_modes(solve_equilibrium(parts, modes.equilibrium.environment))
    for inputs, outputs, table in ((["wheel"], [], "actuator"), ([], ["wheel"], "sensor")):
        with pytest.raises(ConfigError) as none:
            build_plant(bare, inputs=inputs, outputs=outputs)
        assert none.value.hint == f"add [[{table}]] to the article, which has none"


def test_a_plant_without_inputs_or_outputs_is_an_empty_one():
    plant = build_plant(orbit_modes(), inputs=[], outputs=["wheel"], count=8)
    assert plant.dynamics.psi.shape == (8, 0)
    blind = build_plant(orbit_modes(), inputs=["wheel"], outputs=[], count=8)
    assert blind.dynamics.phi.shape == (0, 8)


def test_a_sensor_named_with_rate_in_its_own_name():
    """A sensor called ``turn_rate`` is an angle sensor of that name; its rate is ``turn_rate_rate``."""
    parts = article()
    parts = dataclasses.replace(parts, sensors=(Sensor(name="turn_rate", frame="a", axis=Z, axis_frame="a"),))
    modes = solve_modes(solve_equilibrium(parts, Environment.orbit()))
    plant = build_plant(modes, inputs=["wheel"], outputs=["turn_rate", "turn_rate_rate"], count=8)
    assert np.any(plant.dynamics.phi[0] != 0.0)
    assert np.any(plant.dynamics.phi_rate[1] != 0.0)
