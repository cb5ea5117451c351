"""Displacements of points from the ground, as of a laser: Newton, Euler, and an axis that stands still."""

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.structure.correlation.measured_modes import MeasurementNoise, measure_modes
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.model.article import Actuator, ActuatorKind, Damping, Sensor, SensorKind
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.sensors_and_actuators import output_rows
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.systems.state_space.modal_system import modal_response
from structure_builders import TUBE, body, member, node, structure

MASS, INERTIA = 2.0, (0.3, 0.2, 0.1)
AT, TO = np.array([0.1, -0.2, 0.3]), np.array([-0.3, 0.1, 0.2])


def laser(axis, offset=(0.0, 0.0, 0.0), frame="n"):
    return Sensor(
        name="laser", frame=frame, axis=np.array(axis), kind=SensorKind.DISPLACEMENT, offset=np.array(offset)
    )


def unit(seed):
    v = np.random.default_rng(seed).standard_normal(3)
    return v / np.linalg.norm(v)


@pytest.mark.parametrize("seed", range(3))
def test_a_free_body_moves_under_a_force_as_newton_and_euler_say(seed):
    """n . dx at a point = (n . e / m + (p x e)' J^-1 (q x n)) F / s^2, and its rate s times that."""
    e, n = unit([1, seed]), unit([2, seed])
    push = Actuator(name="push", frame="n", axis=e, kind=ActuatorKind.FORCE, offset=AT)
    box = structure(
        [node("n", (0, 0, 0), body(MASS, inertia=INERTIA))], actuators=[push], sensors=[laser(n, TO)]
    )
    modes = solve_modes(solve_equilibrium(box, Environment.orbit()))
    plant = build_plant(modes, inputs=["push"], outputs=["laser", "laser_rate"], damping=Damping())
    assert [port.unit for port in plant.outputs] == ["m", "m/s"]
    s = 2j * np.pi * np.array([0.3, 5.0])
    give = n @ e / MASS + np.cross(AT, e) @ (np.cross(TO, n) / np.array(INERTIA))
    want = give / s**2
    found = modal_response(plant.dynamics, s.imag)
    np.testing.assert_allclose(found[:, 0, 0], want, rtol=1e-10)
    np.testing.assert_allclose(found[:, 1, 0], want * s, rtol=1e-10)


def test_the_axis_stands_still_where_the_frame_has_turned():
    """A beam whose root is turned by 40 degrees: shifts along world x and y are those of the coordinates."""
    turn = np.array([0.2, -0.3, 0.6])
    beam = structure(
        [node("a", (0, 0, 0)), node("n", (1.0, 0, 0), body(1.0))],
        [member("a", "n", TUBE, 4)],
        sensors=[laser((0, 1.0, 0))],
    )
    held = Environment(title="turned", gravity=np.zeros(3), clamps=(Clamp(node="a", turn=turn),))
    rest = solve_equilibrium(beam, held)
    np.testing.assert_allclose(rest.config.R[1], rotation_exp(turn), atol=1e-9)
    row = output_rows(rest, ["laser"])
    want = np.zeros(rest.model.tree.size)
    want[6 + 1] = 1.0
    np.testing.assert_array_equal(row.position[0], want)
    assert not row.rate.any()
    assert not row.acceleration.any()


def test_its_place_and_axis_are_parameters():
    box = structure([node("n", (0, 0, 0), body(MASS, inertia=INERTIA))], sensors=[laser((1.0, 0, 0), TO)])
    names = [p.name for p in find_parameters(box, Environment.orbit(), ["sensor.*"])]
    assert {f"sensor.laser.{key}" for key in ("axis.x", "offset.z")} <= set(names), names


def test_what_it_is_not():
    for wrong, words in (
        ({"axis": None}, "needs an axis"),
        ({"axis_frame": "m"}, "stands still in the world"),
    ):
        with pytest.raises(ConfigError, match=words):
            dataclasses.replace(laser((1.0, 0, 0)), **wrong)


def test_its_metres_are_not_mixed_with_radians():
    """The noise of a test follows what translates, and what turns, each by its own rms."""
    beam = structure(
        [node("a", (0, 0, 0)), node("n", (1.0, 0, 0), body(1.0))],
        [member("a", "n", TUBE, 4)],
        sensors=[laser((0, 1.0, 0))],
    )
    held = Environment(title="held", gravity=np.zeros(3), clamps=(Clamp(node="a"),))
    modes = solve_modes(solve_equilibrium(beam, held))
    channels = [("laser", "sensor"), ("n", "z"), ("n", "rz")]
    noise, rng = MeasurementNoise(0.0, 0.01), np.random.default_rng(0)
    plain = measure_modes(modes, channels, chosen=[0, 1, 2]).shape
    std = measure_modes(modes, channels, chosen=[0, 1, 2], noise=noise, rng=rng).shape_std
    straight = 0.01 * np.sqrt(np.mean(plain[:2] ** 2, axis=0))
    np.testing.assert_allclose(std, [straight, straight, 0.01 * np.abs(plain[2])], rtol=1e-12)
