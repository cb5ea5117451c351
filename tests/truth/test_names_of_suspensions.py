"""A suspension mode has the name of what brings it back: springs make it a sway, cables a pendulum."""

import dataclasses

import numpy as np
import pytest

from middeck.structure.correlation.effective_mass import measure_effective_mass
from middeck.structure.model.article import AttachPoint
from middeck.structure.model.environment import Device, Environment, GroundBushing
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import GRAVITY, body, joint, lab, node, rigid_bar, springs_above, structure

G = 9.80665
MASS, CABLE_M = 6.0, 3.0
TURNS = {"bounce", "yaw", "tilt x", "tilt z"}


def modes_of(parts, environment: Environment) -> Modes:
    return solve_modes(solve_equilibrium(parts, environment))


def bushing(name: str, point: str, shift: float, turn: float) -> GroundBushing:
    return GroundBushing(name=name, attach=point, stiffness=np.diag([shift] * 3 + [turn] * 3))


def bar():
    return rigid_bar(MASS, 2.0, (0.3, 2.1, 2.0), attach_y=0.0)


@pytest.mark.parametrize("stiffness", [1e3, 1e5])
def test_an_article_on_springs_sways(stiffness: float):
    mounts = tuple(bushing(name, name, stiffness, 10.0) for name in ("left", "right"))
    found = modes_of(bar(), Environment(title="isolators", gravity=GRAVITY, bushings=mounts))
    assert set(found.kind) == {"suspension"}
    assert set(found.name) == TURNS | {"sway x", "sway z"}


@pytest.mark.parametrize(("share", "motion"), [(0.0, "pendulum"), (0.8, "pendulum"), (1.25, "sway")])
def test_what_brings_it_back_most_names_it(share: float, motion: str):
    """A bar on two cables of one length, each beside a spring across: g/L against k/m."""
    points = {"left": (-1.0, 0.0, 0.0), "right": (1.0, 0.0, 0.0)}
    k = 40.0
    hung = lab(*springs_above(points, CABLE_M, k, CABLE_M - MASS * G / (2 * k)))
    across = np.diag([share * MASS * G / CABLE_M / 2, 0.0, share * MASS * G / CABLE_M / 2, 20.0, 0.0, 0.0])
    sides = tuple(GroundBushing(name=name, attach=name, stiffness=across) for name in points)
    found = modes_of(bar(), dataclasses.replace(hung, bushings=sides))
    named = dict(zip(found.name, found.omega, strict=True))
    assert set(named) == TURNS | {f"{motion} x", f"{motion} z"}
    assert named[f"{motion} x"] == pytest.approx(np.sqrt((1.0 + share) * G / CABLE_M), rel=1e-3)


@pytest.mark.parametrize(
    ("gravity", "k", "name"),
    [(GRAVITY, 0.0, "payload pendulum p"), (GRAVITY, 400.0, "gimbal p"), (0.0 * GRAVITY, 400.0, "gimbal p")],
)
def test_a_payload_is_a_pendulum_where_its_weight_brings_it_back(gravity: np.ndarray, k: float, name: str):
    """A payload of 1 kg hangs 0.2 m below its axis, and a spring to the ground may hold it there."""
    payload = body(1.0, cg=(0.0, -0.2, 0.0), inertia=(0.01, 0.01, 0.01))
    points = [AttachPoint("low", "p", np.array([0.0, -0.2, 0.0])), AttachPoint("bus", "bus", np.zeros(3))]
    bus = node("bus", (0, 0, 0), body(1e4, inertia=(1e3, 1e3, 1e3)))
    article = structure([bus], joints=[joint("p", "bus", (0, 0, 1), payload)], attach=points)
    mounts = (bushing("mount", "bus", 1e10, 1e9), bushing("side", "low", k, 0.0))
    found = modes_of(article, Environment(title="bench", gravity=gravity, bushings=mounts))
    restored = 0.04 * k + 0.2 * np.linalg.norm(gravity)
    assert found.name[0] == name
    assert found.omega[0] == pytest.approx(np.sqrt(restored / (0.01 + 0.04)), rel=1e-3)


@pytest.mark.parametrize("place", [0.0, 1000.0])
def test_mass_that_moves_with_a_cable_moves_no_centre(place: float):
    """A kilogram of device on each cable moves along y only; all of it may stand a kilometre off."""
    carried, off = 1.0, np.full(3, place)
    ends = {"left": np.array([-1.0, 0.5, 0.0]), "right": np.array([1.0, 0.5, 0.0])}
    hub = node("bar", off, body(MASS, inertia=(0.3, 2.1, 2.0)))
    article = structure([hub], attach=[AttachPoint(name, "bar", at) for name, at in ends.items()])
    cables = tuple(
        Device(
            name=name,
            attach=name,
            force=0.5 * MASS * G,
            stiffness=40.0,
            cable_length=CABLE_M,
            moving_mass=carried,
        )
        for name in ends
    )
    found = modes_of(article, Environment(title="cables", gravity=GRAVITY, devices=cables))
    assert set(found.name) == TURNS | {"pendulum x", "pendulum z"}
    about = measure_effective_mass(found).rigid
    assert about == pytest.approx([MASS, MASS + 2 * carried, MASS, 0.3, 2.1, 2.0 + 2 * carried], rel=1e-6)
