"""Damping, accelerometers and forces in the file of an article, and what is said of bad ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.setups import load_structure
from middeck.structure.model.article import (
    ActuatorKind,
    Damper,
    DamperPlace,
    DampingTable,
    SensorKind,
    Structure,
)
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.rest.equilibrium import solve_equilibrium

BEAM = """\
schema = 1
name = "beam"

[material.steel]
E_pa = 2e11
nu = 0.3
rho_kg_m3 = 7800.0

[section.tube]
material = "steel"
outer_diameter_m = 0.02
inner_diameter_m = 0.018

[section.bar]
EA_n = 1e6
GJ_nm2 = 10.0
EI_y_nm2 = 20.0
EI_z_nm2 = 30.0
rho_A_kg_per_m = 0.5
rho_I_y_kg_m = 1e-5
rho_I_z_kg_m = 1e-5

[[node]]
name = "a"
x_m = 0.0

[[node]]
name = "b"
x_m = 1.0

[[node]]
name = "c"
x_m = 2.0

[[strut]]
section = "tube"
from = "a"
to = "b"

[[strut]]
name = "far"
section = "bar"
from = "b"
to = "c"

[[revolute]]
name = "arm"
parent = "b"
axis = [1, 0, 0]
mass_kg = 0.5
inertia_kg_m2 = [0.01, 0.01, 0.01]

[[attach]]
name = "p"
frame = "a"

[[attach]]
name = "q"
frame = "c"

[[spring]]
from = "p"
to = "q"
stiffness_n_per_m = 10.0
free_length_m = 2.0
"""


def load(tmp_path: Path, more: str) -> Structure:
    path = tmp_path / "beam.toml"
    path.write_text(BEAM + more, encoding="utf-8")
    return load_structure(path)


def test_nothing_written_is_the_published_damping(tmp_path: Path):
    damping = load(tmp_path, "").damping
    assert (damping.flexible, damping.suspension, damping.rigid) == (0.01, 0.03, 0.0)
    assert (damping.table, damping.loss_factor, damping.dampers, damping.by_mode) == (None, (), (), ())


def test_loss_factors_go_by_section_else_by_material(tmp_path: Path):
    damping = load(tmp_path, "[damping.material]\nsteel = 0.004\n[damping.section]\nbar = 0.02\n").damping
    assert damping.loss_factor == (("a-b", 0.004), ("far", 0.02))
    assert (damping.flexible, damping.suspension) == (0.0, 0.03)  # the material says what flexible modes lose
    both = load(tmp_path, "[damping]\nflexible = 0.001\nmaterial = {steel = 0.004}\nsection = {tube = 0.1}\n")
    assert both.damping.loss_factor == (("a-b", 0.1),)
    assert both.damping.flexible == 0.001


def test_devices_add_to_the_base(tmp_path: Path):
    text = """
[[damping.device]]
joint = "arm"
c_joint_nms_per_rad = 0.1
[[damping.device]]
attach = "p"
c_ns_per_m = 2.0
[[damping.device]]
spring = "p-q"
c_ns_per_m = 3.0
"""
    damping = load(tmp_path, text).damping
    places = DamperPlace.JOINT, DamperPlace.DEVICE, DamperPlace.SPRING
    expected = tuple(Damper(*d) for d in zip(places, ("arm", "p", "p-q"), (0.1, 2.0, 3.0), strict=True))
    assert damping.dampers == expected
    assert damping.flexible == 0.01


def test_a_table_is_the_base(tmp_path: Path):
    text = '[damping.table]\nfrequency_hz = [0.1, 200]\nratio = [0.02, 0.005]\noutside = "hold"\n'
    damping = load(tmp_path, text.replace("200", "200.0")).damping
    assert damping.table == DampingTable(np.array([0.1, 200.0]), np.array([0.02, 0.005]), True)
    assert (damping.flexible, damping.suspension) == (0.0, 0.0)


def test_modes_of_their_own(tmp_path: Path):
    structure = load(tmp_path, '[damping.mode]\n"first bending x-y" = 0.004\n7 = 0.002\n')
    assert structure.damping.by_mode == (("first bending x-y", 0.004), (7, 0.002))
    modes = solve_modes(solve_equilibrium(structure, Environment.orbit()))
    zeta = estimate_damping(modes).zeta
    assert zeta[modes.name.index("first bending x-y")] == 0.004
    assert zeta[7] == 0.002


def test_an_accelerometer_and_a_force(tmp_path: Path):
    text = """
[[sensor]]
name = "feel"
kind = "accelerometer"
frame = "arm"
axis = [0, 2, 0]
offset_m = [0.1, 0.0, 0.0]
[[actuator]]
name = "push"
kind = "force"
frame = "a"
axis = [0, 0, 3]
offset_m = [0.0, 0.2, 0.0]
[[sensor]]
name = "turn"
frame = "a"
axis = [1, 0, 0]
[[sensor]]
name = "laser"
kind = "displacement"
frame = "arm"
axis = [0, 0, 2]
offset_m = [0.1, 0.0, 0.0]
"""
    structure = load(tmp_path, text)
    feel, turn, laser = structure.sensors[-3:]
    kinds = (SensorKind.ACCELEROMETER, SensorKind.ANGLE, SensorKind.DISPLACEMENT)
    assert (feel.kind, turn.kind, laser.kind) == kinds
    assert (laser.axis.tolist(), laser.offset.tolist(), laser.axis_frame) == ([0, 0, 1], [0.1, 0, 0], "")
    assert feel.axis is not None
    assert (feel.axis.tolist(), feel.offset.tolist()) == ([0, 1, 0], [0.1, 0, 0])
    push = structure.actuators[-1]
    assert push.kind is ActuatorKind.FORCE
    assert push.offset.tolist() == [0, 0.2, 0]


@pytest.mark.parametrize(
    ("more", "key", "reported", "line"),
    [
        ("[damping.material]\nsteal = 0.1", "damping.material.steal", "no material of this name", 2),
        ("[damping.section]\nrod = 0.1", "damping.section.rod", "no section of this name", 2),
        ("[damping.section]\nbar = -0.1", "damping.section.bar", "must be >= 0", 2),
        ("[damping.mode]\nbounce = 1.0", "damping.mode.bounce", "must be >= 0 and < 1", 2),
        ("[[damping.device]]\nc_ns_per_m = 1.0", "damping.device.0", "names 0 places", 1),
        (
            '[[damping.device]]\njoint = "arm"\nattach = "p"\nc_ns_per_m = 1.0',
            "damping.device.0",
            "names 2 places",
            1,
        ),
        (
            '[[damping.device]]\njoint = "arn"\nc_joint_nms_per_rad = 1.0',
            "damping.device.0.joint",
            "no joint of this name",
            2,
        ),
        (
            '[[damping.device]]\nattach = "r"\nc_ns_per_m = 1.0',
            "damping.device.0.attach",
            "no attach point of this name",
            2,
        ),
        ('[[damping.device]]\nspring = "s"\nc_ns_per_m = 1.0', "damping.device.0.spring", "no spring", 2),
        (
            '[[damping.device]]\njoint = "arm"\nc_ns_per_m = 1.0',
            "damping.device.0.c_ns_per_m",
            "has c_joint_nms_per_rad instead",
            3,
        ),
        ('[[damping.device]]\nspring = "p-q"', "damping.device.0.c_ns_per_m", "missing", 1),
        (
            "[damping]\nflexible = 0.1\n[damping.table]\nfrequency_hz = [1.0]\nratio = [0.1]",
            "damping.flexible",
            "beside a table",
            2,
        ),
        (
            "[damping.table]\nfrequency_hz = [1.0, 1.0]\nratio = [0.1, 0.1]",
            "damping.table.frequency_hz",
            "must ascend",
            2,
        ),
        (
            "[damping.table]\nfrequency_hz = [1.0, 2.0]\nratio = [0.1]",
            "damping.table.ratio",
            "1 ratios for 2 frequencies",
            3,
        ),
        ('[[sensor]]\nname = "s"\nkind = "accelerometer"\nframe = "a"', "sensor.0.axis", "needs one", 1),
        ('[[actuator]]\nname = "s"\nkind = "force"\nframe = "a"', "actuator.0.axis", "needs one", 1),
        (
            '[[sensor]]\nname = "s"\nframe = "a"\naxis = [1, 0, 0]\noffset_m = [1.0, 0, 0]',
            "sensor.0.offset_m",
            "it has no offset",
            5,
        ),
        (
            '[[sensor]]\nname = "s"\nkind = "accelerometer"\nframe = "a"\naxis = [1, 0, 0]\naxis_frame = "b"',
            "sensor.0.axis_frame",
            "fixed to its own frame",
            6,
        ),
        (
            '[[sensor]]\nname = "s"\nkind = "displacement"\nframe = "a"\naxis = [1, 0, 0]\naxis_frame = "a"',
            "sensor.0.axis_frame",
            "an axis of the world",
            6,
        ),
        (
            '[[sensor]]\nname = "s"\nkind = "gyro"\nframe = "a"\naxis = [1, 0, 0]',
            "sensor.0.kind",
            "must be",
            3,
        ),
    ],
)
def test_bad_ones_are_named_with_their_line(tmp_path: Path, more: str, key: str, reported: str, line: int):
    with pytest.raises(ConfigError) as error:
        load(tmp_path, more)
    (fault,) = error.value.data["faults"]
    assert fault.key == key
    assert reported in fault.message
    assert fault.line == BEAM.count("\n") + line


def test_an_override_reaches_a_loss_factor(tmp_path: Path):
    path = tmp_path / "beam.toml"
    path.write_text(BEAM + "[damping.material]\nsteel = 0.004\n", encoding="utf-8")
    structure = load_structure(path, overrides=["damping.material.steel=0.02"])
    assert structure.damping.loss_factor == (("a-b", 0.02),)
