"""Articles that are wrong in what they weigh, hold or measure: named, located, and found before solving."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import ROOT, middeck
from coarse_articles import coarse
from middeck.errors import ConfigError, EquilibriumError
from middeck.files.setups import load_structure
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Device, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest import damped_descent, forces_as_unknowns, settle
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import GRAVITY, TURNING_TUBE, body, member, node, on_cables, structure, tube_bus

SIMPLE = coarse("mace-simple")
Capture = pytest.CaptureFixture[str]


def bus(payload_y: float = -0.2, **joint) -> Structure:
    payload = body(3.0, (0, payload_y, 0), (0.02,) * 3)
    more = {"name": "pay", "angle": 0.0, **joint}
    return tube_bus((5.0, 5.0), (0, -0.05, 0), (0.1, 0.1, 0.1), payload, **more)


LAB = on_cables(4.0, 0.25, ("xyz", "yz"))


def test_a_pivot_through_the_centre_of_mass_is_named_as_neutral():
    modes = solve_modes(solve_equilibrium(bus(payload_y=0.0), LAB))
    assert modes.name[0] == "gimbal pay"
    assert modes.omega[0] == 0.0
    assert modes.warnings[0].startswith("nothing holds 'gimbal pay' in 'lab': a mechanism in neutral balance")
    assert "centre of mass on the axis" in modes.warnings[0]


def test_what_gravity_holds_and_what_orbit_leaves_free_are_no_findings():
    for payload_y, environment in ((-0.2, LAB), (0.0, Environment.orbit())):
        assert solve_modes(solve_equilibrium(bus(payload_y), environment)).stated_warnings == ()


def weak(stiffness: float) -> Environment:
    """Two devices of 40 N each under an article of 132 N: it falls until their springs carry the rest."""
    devices = (
        Device(name=f"at {n}", attach=n, force=40.0, stiffness=stiffness, cable_length=4.0) for n in "ab"
    )
    return Environment(title="weak", gravity=GRAVITY, devices=tuple(devices))


def test_a_load_path_that_diverges_says_where_and_at_which_load():
    """After 2e7 m positions are rounded to 4e-9 m: no strut of 1e6 N/m comes to rest there."""
    parts, k = bus(), 1e-6
    rest = solve_equilibrium(parts, weak(k))
    assert not rest.converged
    with pytest.raises(EquilibriumError, match="not at rest") as error:
        solve_modes(rest)
    data = error.value.data
    assert data["history"] == rest.history
    assert f"lost at {data['load_factor']:.0%} of the load" in error.value.what
    # Down to where the springs would carry it; what is left is 1e-5 of the weight.
    assert data["moved"] == pytest.approx((parts.mass * 9.80665 - 80.0) / (2.0 * k), rel=1e-4)
    assert f"moved by up to {data['moved']:.3g} m" in error.value.what
    assert error.value.where == f"frame {data['frame']!r}"
    assert data["frame"] in rest.model.frames


def test_the_load_at_which_the_way_was_lost_is_the_first_that_did_not_settle(
    monkeypatch: pytest.MonkeyPatch,
):
    """Two iterations are too few at any load, with displacements and with forces as unknowns."""
    monkeypatch.setattr(damped_descent, "MAX_ITERATIONS", 2)
    monkeypatch.setattr(forces_as_unknowns, "MIXED_ITERATIONS", 2)
    with pytest.raises(EquilibriumError, match="not at rest") as error:
        solve_modes(solve_equilibrium(bus(), LAB))
    assert error.value.data["load_factor"] == settle.LOAD_FACTORS[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"travel": (0.2, 1.0)}, "joint 'pay' begins at 0 rad, out of its travel 0.2 to 1"),
        ({"travel": (1.0, -1.0)}, "joint 'pay' has a travel that does not rise"),
    ],
)
def test_a_travel_that_the_angle_violates(changes, message: str):
    with pytest.raises(ConfigError, match=message):
        mesh_structure(bus(**changes))


def test_the_one_name_in_two_thousand_that_is_there_twice():
    nodes = [node(f"n{i}", (i, 0, 0), body(1.0, inertia=(0.1,) * 3)) for i in range(2_000)]
    members = [member(f"n{i}", f"n{i + 1}", TURNING_TUBE, 1) for i in range(1_999)]
    parts = structure(nodes, members)
    mesh_structure(parts)
    with pytest.raises(ConfigError, match="frame 'n7' is there twice"):
        mesh_structure(dataclasses.replace(parts, nodes=(*nodes, nodes[7])))


def changed(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    text = SIMPLE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    file = tmp_path / "bad.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_file_with_a_disconnected_part_names_its_nodes_and_the_line(tmp_path: Path):
    """Without the strut from n3 to n4, n4 and n5 are an article of their own."""
    strut = '[[strut]]\nsection = "strut"\nfrom = "n3"\nto = "n4"\n'
    file = changed(tmp_path, (strut, ""))
    with pytest.raises(ConfigError) as error:
        load_structure(file)
    (fault,) = error.value.data["faults"]
    assert "no strut, spring or link joins 'n4', 'n5' to the rest" in fault.message
    assert file.read_text().splitlines()[fault.line - 1] == 'name = "n4"'
    attach = (
        '\n[[attach]]\nname = "p"\nframe = "pri_z"\n\n[[attach]]\nname = "q"\nframe = "n4"\n'
        '\n[[spring]]\nfrom = "p"\nto = "q"\nstiffness_n_per_m = 9.0\nfree_length_m = 1.0\n'
    )
    file.write_text(file.read_text() + attach)
    assert load_structure(file).springs  # a spring from the payload of n1 joins them


def test_a_file_whose_angle_is_outside_of_its_travel(tmp_path: Path):
    file = changed(tmp_path, ("angle_x_deg = 45.0 ", "travel_x_deg = [-30.0, 30.0]\nangle_x_deg = 45.0 "))
    with pytest.raises(ConfigError) as error:
        load_structure(file)
    (fault,) = error.value.data["faults"]
    assert fault.key == "gimbal.0.angle_x_deg"
    assert "outside of travel_x_deg = [-30.0, 30.0]" in fault.message
    assert "45.0" in file.read_text().splitlines()[fault.line - 1]


def test_check_shows_the_summary_first_and_finds_nothing(capfd: Capture):
    ended = middeck(capfd, "check", SIMPLE, "lab", "--require")
    assert (ended.code, ended.err) == (0, "")
    lines = ended.out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["mass", "centre", "inertia"]
    assert lines[-1] == "nothing found"
    parts = load_structure(SIMPLE)
    assert lines[0] == f"mass         {parts.mass:.6g} kg"


def test_check_finds_units_in_a_file_and_says_no_only_if_asked(capfd: Capture, tmp_path: Path):
    file = changed(tmp_path, ("E_pa = 2.35e9", "E_pa = 2.35"))
    for flags, code in (((), 0), (("--require",), 1)):
        ended = middeck(capfd, "check", file, *flags)
        assert (ended.code, ended.err) == (code, "")
        assert "sound would travel at" in ended.out
        assert ended.out.index("mass  ") < ended.out.index("sound")
    found = json.loads(middeck(capfd, "check", file, "--json").out)
    assert not found["sound"]
    assert {f["grade"] for f in found["findings"]} == {"doubt"}
    # The sum in another order: rounding.
    assert found["mass_kg"] == pytest.approx(load_structure(file).mass, rel=1e-14)


@pytest.mark.parametrize(
    ("override", "grade", "words"),
    [
        ("gimbal.pri.payload_cg=[0,0.1,0]", "fault", "payload pendulum pri z' grows"),
        ("gimbal.pri.payload_cg=[0,0,0]", "doubt", "nothing holds 'gimbal pri"),
        ("material.lexan.rho=2.0", "doubt", "material of 2 kg/m^3"),
        ("suspension.offsets_m=[[0,0.02,0],[-0.75,0.02,0],[-0.95,0.02,0]]", "fault", "still a mechanism"),
    ],
)
def test_check_in_an_environment_finds_what_solving_would(
    capfd: Capture, override: str, grade: str, words: str
):
    ended = middeck(capfd, "check", SIMPLE, "lab", "--set", override, "--json")
    assert ended.code == 0
    findings = json.loads(ended.out)["findings"]
    assert any(f["grade"] == grade and words in f["what"] for f in findings), findings


def test_check_of_a_broken_file_is_a_configuration_error(capfd: Capture, tmp_path: Path):
    ended = middeck(capfd, "check", changed(tmp_path, ('name = "n2"', 'name = "n1"')), "lab")
    assert ended.code == 2
    assert ended.out == ""
    assert "a second frame of this name" in ended.err


def test_modes_shows_the_masses_even_where_there_is_no_rest(capfd: Capture):
    ended = middeck(capfd, "modes", SIMPLE, "--set", "gimbal.pri.payload_cg=[0,0.1,0]")
    assert ended.code == 5
    assert [line.split()[0] for line in ended.out.splitlines()[:3]] == ["mass", "centre", "inertia"]
    assert "grows at" in ended.err


UPRIGHT = """
[[proof_mass]]
name = "pm"
node = "n3"
axis = [0.0, 1.0, 0.0]
mass_kg = 0.4
natural_hz = {hz}
travel_m = [-0.005, 0.005]
"""


def test_an_upright_proof_mass_sinks_onto_its_spring_or_is_refused(capfd: Capture, tmp_path: Path):
    file = tmp_path / "actuated.toml"
    text = (ROOT / "articles/mace-dm.toml").read_text(encoding="utf-8")
    file.write_text(text + UPRIGHT.format(hz=10.0), encoding="utf-8")
    lab = ROOT / "environments/lab.toml"
    ended = middeck(capfd, "modes", file, "--environment", lab, "--json")
    found = json.loads(ended.out)
    # The bus leans by half a degree: 1 - cos is 1e-4 at most.
    assert found["holding_force_n"]["pm"] == pytest.approx(0.4 * 9.80665, rel=1e-4)
    assert "pm" not in found["holding_torque_nm"]
    assert "first slide" in found["name"]
    # m g/k = g/(2 pi 10 Hz)^2 down, to the same lean.
    assert found["slide_travel_m"]["pm"] == pytest.approx(-9.80665 / (20.0 * np.pi) ** 2, rel=1e-4)
    assert (found["held_by"]["pm"], found["held_by"]["pri_x"]) == ("spring", "motor")
    shown = middeck(capfd, "modes", file, "--environment", lab).out
    lines = [" ".join(row.split()) for row in shown.splitlines()]
    force, travel = found["holding_force_n"]["pm"], 1e3 * found["slide_travel_m"]["pm"]
    assert lines[lines.index("holding force") + 1] == "slide N travel mm held by"
    assert f"pm {force:.5f} {travel:.4f} its spring" in lines
    # 2.5 mm at 10 Hz, a quarter of a metre at 1 Hz.
    file.write_text(text + UPRIGHT.format(hz=1.0), encoding="utf-8")
    ended = middeck(capfd, "modes", file, "--environment", lab)
    assert ended.code == 5
    assert "joint 'pm' would rest at -0.248" in ended.err
    assert "beyond its travel -0.005 to 0.005" in ended.err
    assert str(file) in ended.err


def test_a_key_of_the_file_below_a_table_is_advised_to_stand_above(tmp_path: Path, capfd: Capture):
    file = tmp_path / "late.toml"
    text = '[section.tube]\nEA_n = 1.0\nnode = [{name = "a", x_m = 0.0}]\n'
    file.write_text(f'schema = 1\nname = "late"\n{text}')
    message = middeck(capfd, "check", file).err
    assert "section.tube.node" in message
    assert "a key of the file: write it above the first [table], here it belongs to section.tube" in message
