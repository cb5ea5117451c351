"""What bad articles, environments and studies get: every error at once, with file, line, key and value."""

from __future__ import annotations

import copy
import dataclasses
import os
import re
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from middeck.errors import ConfigError
from middeck.files.articles.checks import article_findings
from middeck.files.articles.form import ArticleForm
from middeck.files.environments.checks import environment_findings
from middeck.files.environments.form import EnvironmentForm
from middeck.files.setups import (
    BUILT_IN,
    find_document,
    find_stated,
    load_environment,
    load_setup,
    load_structure,
)
from middeck.files.studies.documents import load_study, study_rules
from middeck.files.studies.form import StudyForm
from middeck.files.toml.faults import DocumentFault
from middeck.files.toml.lines import key_lines
from middeck.files.toml.source import check, read_source
from middeck.structure.model.article import JointState
from middeck.structure.model.environment import Environment
from repeats import LONG

ROOT = Path(__file__).parents[2]
DM = ROOT / "articles/mace-dm.toml"
LAB = ROOT / "environments/lab.toml"
STUDY = ROOT / "studies/mace-1993.toml"

BEAM = """\
schema = 1
name = "beam"

[section.bar]
EA_n = 1e6
GJ_nm2 = 10.0
EI_y_nm2 = 20.0
EI_z_nm2 = 30.0
rho_A_kg_per_m = 0.5

[[node]]
name = "a"
x_m = 0.0

[[node]]
name = "b"
x_m = 1.0

[[strut]]
section = "bar"
from = "a"
to = "b"
"""


def edited(tmp_path: Path, source: Path, *changes: tuple[str, str]) -> Path:
    """A copy of ``source`` with each first occurrence replaced; the old text must be there."""
    text = source.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return written(tmp_path, source.name, text)


def written(tmp_path: Path, name: str, text: str) -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(load: object, *arguments: object) -> tuple[DocumentFault, ...]:
    assert callable(load)
    with pytest.raises(ConfigError) as caught:
        load(*arguments)
    assert caught.value.exit_code == 2
    return caught.value.data["faults"]


def line_with(path: Path, text: str) -> int:
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(n for n, line in enumerate(lines, 1) if text in line)


# ---- one bad value in the article --------------------------------------------------------------------------

ONE_FAULT = {
    "misspelt key": (
        ("mass_kg = 3.0", "mas_kg = 3.0"),
        "mas_kg",
        "node.0.mas_kg",
        "3.0",
        "unknown key",
        "'mass_kg'?",
    ),
    "misspelt table": (("[mesh]", "[mehs]"), "[mehs]", "mehs", "{", "unknown key", "'mesh'?"),
    "wrong unit": (
        ("x_m = 0.375", "x_mm = 375.0"),
        "x_mm",
        "node.1.x_mm",
        "375.0",
        "'x_m' is expected, in m",
        "m",
    ),
    "wrong unit of mass": (
        ("mass_kg = 9.0", "mass_g = 9000.0"),
        "mass_g",
        "node.2.mass_g",
        "9000.0",
        "'mass_kg' is expected, in kg",
        "convert to kg",
    ),
    "no unit": (("E_pa = 2.35e9", "E = 2.35e9"), "E = ", "material.lexan.E", "2350000000.0", "in Pa", "Pa"),
    "negative mass": (
        ("mass_kg = 3.0", "mass_kg = -3.0"),
        "-3.0",
        "node.0.mass_kg",
        "-3.0",
        "must be >= 0 kg",
        "",
    ),
    "negative inertia": (
        ("[0.06, 0.045, 0.07]", "[0.06, -0.045, 0.07]"),
        "-0.045",
        "node.0.inertia_kg_m2",
        "[0.06, -0.045, 0.07]",
        "not positive definite",
        "",
    ),
    "asymmetric inertia": (
        ("[0.06, 0.045, 0.07]", "[[0.06, 0.01, 0], [0, 0.045, 0], [0, 0, 0.07]]"),
        "0.01, 0]",
        "node.0.inertia_kg_m2",
        "[[0.06",
        "not symmetric",
        "",
    ),
    "no body has this inertia": (
        ("[0.06, 0.045, 0.07]", "[0.06, 0.045, 0.2]"),
        "0.2]",
        "node.0.inertia_kg_m2",
        "[0.06, 0.045, 0.2]",
        "0.045 + 0.06 < 0.2 kg m^2",
        "rotors_excluded",
    ),
    "NaN": (
        ("cg_m = [0.0, -0.03, 0.0]", "cg_m = [0.0, nan, 0.0]"),
        "nan",
        "node.0.cg_m.1",
        "nan",
        "finite",
        "",
    ),
    "infinite": (
        ("E_pa = 2.35e9", "E_pa = inf"),
        "inf",
        "material.lexan.E_pa",
        "inf",
        "finite number, in Pa",
        "",
    ),
    "text for a number": (
        ("x_m = 0.375", 'x_m = "0.375"'),
        '"0.375"',
        "node.1.x_m",
        '"0.375"',
        "a number, in m",
        "",
    ),
    "truth for a number": (
        ("x_m = 0.375", "x_m = true"),
        "= true",
        "node.1.x_m",
        "true",
        "a number, in m",
        "",
    ),
    "out of range": (
        ("nu = 0.37", "nu = 0.7"),
        "0.7",
        "material.lexan.nu",
        "0.7",
        "must be > -1 and <= 0.5",
        "",
    ),
    "two numbers for a vector": (
        ("stage_cg_m = [0.0, 0.0, 0.0]", "stage_cg_m = [0.0, 0.0]"),
        "stage_cg_m",
        "gimbal.0.stage_cg_m.2",
        "",
        "missing",
        "",
    ),
    "zero-length member": (
        ("x_m = 0.375", "x_m = 0.0"),
        'to = "n2"',
        "strut.0.to",
        "n1 to n2",
        "its ends are 0 m apart and take 0.05 m",
        "move the nodes apart",
    ),
    "member shorter than its nodes": (
        ("x_m = 0.375", "x_m = 0.04"),
        'to = "n2"',
        "strut.0.to",
        "n1 to n2",
        "its ends are 0.04 m apart and take 0.05 m",
        "size_m",
    ),
    "unknown node": (('to = "n2"', 'to = "n22"'), '"n22"', "strut.0.to", '"n22"', "no node", "'n2'?"),
    "unknown section": (
        ('section = "strut"', 'section = "stru"'),
        '"stru"',
        "strut.0.section",
        '"stru"',
        "no section",
        "'strut'?",
    ),
    "unknown material": (
        ('material = "lexan"', 'material = "lexn"'),
        '"lexn"',
        "section.strut.material",
        '"lexn"',
        "no material",
        "'lexan'?",
    ),
    "unknown wheel node": (
        ('wheel_node = "n3"', 'wheel_node = "n33"'),
        '"n33"',
        "wheel_node",
        '"n33"',
        "no node of this name",
        "'n3'?",
    ),
    "unknown gimbal frame": (
        ('node = "n1"', 'node = "k"'),
        '"k"',
        "gimbal.0.node",
        '"k"',
        "no frame",
        "one of n1",
    ),
    "unknown attach point": (
        ('nodes = ["n1"', 'nodes = ["q9"'),
        '"q9"',
        "suspension.nodes.0",
        '"q9"',
        "no frame",
        "one of n1",
    ),
    "bore wider than the tube": (
        ("inner_diameter_m = 0.0130", "inner_diameter_m = 0.03"),
        "0.03 ",
        "section.strut.inner_diameter_m",
        "0.03",
        "must be < outer_diameter_m = 0.0254 m",
        "",
    ),
    "unknown state": (
        ("angle_z_deg = 0.0", 'angle_z_deg = 0.0\nstate_z = "fre"'),
        '"fre"',
        "gimbal.0.state_z",
        '"fre"',
        "free",
        "",
    ),
    "sprung without a stiffness": (
        ("angle_z_deg = 0.0", 'angle_z_deg = 0.0\nstate_z = "sprung"'),
        "[[gimbal]]",
        "gimbal.0.stiffness_z_nm_per_rad",
        "",
        "missing",
        "",
    ),
    "driven angle of a free axis": (
        ("angle_z_deg = 0.0", "angle_z_deg = 0.0\ncommand_z_deg = 3.0"),
        "command_z_deg",
        "gimbal.0.command_z_deg",
        "3.0",
        "only a driven axis",
        'state_z = "driven"',
    ),
    "other schema": (("schema = 1", "schema = 2"), "schema = 2", "schema", "2", "1", ""),
}


@pytest.mark.parametrize("case", ONE_FAULT, ids=list(ONE_FAULT))
def test_one_fault_is_named_with_its_place(tmp_path: Path, case: str) -> None:
    change, marker, key, value, message, hint = ONE_FAULT[case]
    path = edited(tmp_path, DM, change)
    (fault,) = faults_of(load_structure, path)
    assert fault.file == str(path)
    assert fault.line == line_with(path, marker)
    assert fault.key == key
    assert fault.value.startswith(value)
    assert message in fault.message
    assert hint in fault.hint


def test_an_inertia_that_rounding_left_unsymmetric_is_read(tmp_path: Path) -> None:
    rounded = ("[0.06, 0.045, 0.07]", "[[0.06, 0.01, 0], [0.010000000000000002, 0.045, 0], [0, 0, 0.07]]")
    inertia = load_structure(edited(tmp_path, DM, rounded)).nodes[0].body.inertia
    np.testing.assert_array_equal(inertia, inertia.T)


def test_an_unconnected_node(tmp_path: Path) -> None:
    path = written(tmp_path, "beam.toml", BEAM + '\n[[node]]\nname = "c"\nx_m = 2.0\n')
    (fault,) = faults_of(load_structure, path)
    assert (fault.line, fault.key, fault.value) == (25, "node.2.name", '"c"')
    assert "unconnected node" in fault.message
    assert "[[strut]]" in fault.hint


def test_a_spring_connects_and_a_single_node_needs_nothing(tmp_path: Path) -> None:
    more = """
[[node]]
name = "c"
x_m = 2.0
[[attach]]
name = "p"
frame = "c"
[[attach]]
name = "q"
frame = "b"
[[spring]]
from = "p"
to = "q"
stiffness_n_per_m = 5.0
free_length_m = 1.0
"""
    assert len(load_structure(written(tmp_path, "s.toml", BEAM + more)).springs) == 1
    one = 'schema = 1\nname = "one"\n[[node]]\nname = "a"\nx_m = 0.0\nmass_kg = 1.0\n'
    assert load_structure(written(tmp_path, "one.toml", one)).mass == 1.0


@pytest.mark.parametrize(
    ("more", "key", "reported"),
    [
        ('[[node]]\nname = "a"\nx_m = 3.0', "node.2.name", "a second frame of this name"),
        ('[[strut]]\nsection = "bar"\nfrom = "a"\nto = "b"', "strut.1.from", "a second strut"),
        (
            '[[attach]]\nname = "p"\nframe = "a"\n[[attach]]\nname = "p"\nframe = "b"',
            "attach.1.name",
            "a second",
        ),
        (
            '[[sensor]]\nname = "s"\nframe = "a"',
            "sensor.0.frame",
            "is no joint, so that the sensor needs an axis",
        ),
        ('[[sensor]]\nname = "s"\nframe = "a"\naxis = [0, 0, 0]', "sensor.0.axis", "zero vector"),
        (
            '[[revolute]]\nname = "r"\nparent = "r"\naxis = [1, 0, 0]\nmass_kg = 1.0',
            "revolute.0.parent",
            "itself",
        ),
        (
            '[[strut]]\nname = "t"\nsection = "bar"\nfrom = "a"\nto = "b"\nup = [2.0, 0, 0]',
            "strut.1.up",
            "along the member",
        ),
        ("[section.half]\nEA_n = 1.0", "section.half.GJ_nm2", "missing in a section by its stiffnesses"),
        ("[section.none]", "section.none.material", "missing"),
        (
            '[suspension]\nnodes = ["a", "b"]\noffsets_m = [[0, 0, 0]]',
            "suspension.offsets_m",
            "1 offsets for 2",
        ),
    ],
)
def test_names_joints_and_sections(tmp_path: Path, more: str, key: str, reported: str) -> None:
    path = written(tmp_path, "beam.toml", f"{BEAM}\n{more}\n")
    faults = {f.key: f for f in faults_of(load_structure, path)}
    assert reported in faults[key].message
    assert faults[key].line > BEAM.count("\n")


def test_all_errors_of_both_files_come_at_once(tmp_path: Path) -> None:
    article = edited(
        tmp_path, DM, ("mass_kg = 3.0", "mas_kg = 3.0"), ("nu = 0.37", "nu = 3.7"), ('to = "n2"', 'to = "n9"')
    )
    environment = edited(tmp_path, LAB, ("bounce_hz = 0.25", "bounce_hz = -1.0"))
    with pytest.raises(ConfigError) as caught:
        load_setup(article, environment)
    keys = [f.key for f in caught.value.data["faults"]]
    assert {"material.lexan.nu", "node.0.mas_kg", "strut.0.to", "suspension.bounce_hz"} <= set(keys)
    text = str(caught.value)
    assert re.search(r"mace-dm\.toml:\d+: material\.lexan\.nu = 3\.7: must be > -1 and <= 0\.5", text)
    assert re.search(r"lab\.toml:\d+: suspension\.bounce_hz = -1\.0: must be > 0 Hz", text)
    assert "did you mean 'mass_kg'?" in text


# ---- files that are none -----------------------------------------------------------------------------------


def test_broken_files_say_where(tmp_path: Path) -> None:
    good = DM.read_bytes()
    cases = {
        "empty.toml": (b"", 1, "the file is empty"),
        "blank.toml": (b" \n\n", 1, "the file is empty"),
        "cut.toml": (good[: good.index(b"-0.03, 0.0]")], None, "not valid TOML"),
        "syntax.toml": (b"schema = 1\nname = = 3\n", 2, "not valid TOML"),
        "twice.toml": (b"schema = 1\nschema = 1\n", 2, "not valid TOML"),
        "latin.toml": (b'schema = 1\ntitle = "\xe9"\n', 2, "not UTF-8"),
    }
    for name, (content, line, text) in cases.items():
        path = tmp_path / name
        path.write_bytes(content)
        (fault,) = faults_of(load_structure, path)
        assert text in fault.message, name
        assert fault.file == str(path)
        assert fault.hint
        cut_line = content.count(b"\n") + 1
        assert fault.line == (line if line is not None else cut_line), name


def test_a_truncated_file_never_passes_for_a_whole_one(tmp_path: Path) -> None:
    """Cut at any line the article is refused, or it is a valid one with less in it."""
    lines = DM.read_text(encoding="utf-8").splitlines(keepends=True)
    whole = load_structure(DM)
    refused = 0
    for n in range(len(lines)):
        path = written(tmp_path, "cut.toml", "".join(lines[:n]))
        try:
            assert load_structure(path) != whole
        except ConfigError:
            refused += 1
    assert refused > len(lines) // 2


def test_a_missing_file() -> None:
    (fault,) = faults_of(load_structure, "no/such/article.toml")
    assert (fault.file, fault.hint) == ("no/such/article.toml", "check the path")


def test_both_broken_files_are_reported(tmp_path: Path) -> None:
    faults = faults_of(load_setup, written(tmp_path, "a.toml", ""), tmp_path / "none.toml")
    assert [f.file for f in faults] == [str(tmp_path / "a.toml"), str(tmp_path / "none.toml")]


# ---- environments ------------------------------------------------------------------------------------------


def test_gravity_without_a_suspension(tmp_path: Path) -> None:
    text = 'schema = 1\nname = "lab"\n[constants]\ngravity_m_s2 = 9.81\n'
    (fault,) = faults_of(load_environment, written(tmp_path, "lab.toml", text))
    assert (fault.line, fault.key, fault.value) == (4, "constants.gravity_m_s2", "9.81")
    assert "a missing suspension" in fault.message
    assert "[suspension]" in fault.hint


def test_an_environment_names_only_attach_points_of_the_article(tmp_path: Path) -> None:
    path = edited(tmp_path, LAB, ('n5 = "yz"', 'n55 = "yz"'))
    (fault,) = faults_of(load_setup, DM, path)
    assert (fault.file, fault.line, fault.key) == (str(path), line_with(path, "n55"), "suspension.held.n55")
    assert "'dm' has no attach point 'n55'" in fault.message
    assert "'n5'?" in fault.hint


@pytest.mark.parametrize(
    ("old", "new", "key", "reported"),
    [
        ('n3 = "xyz"', 'n3 = "xyw"', "suspension.held.n3", 'must be x, y, z, in this order, as in "yz"'),
        ('n3 = "xyz"', 'n3 = "zx"', "suspension.held.n3", "in this order"),
        ('n3 = "xyz"', 'n3 = ""', "suspension.held.n3", "in this order"),
        ("gravity_m_s2 = 9.80665", "gravity_m_s2 = 0.0", "suspension", "nothing without gravity"),
        ("[0.0, -1.0, 0.0]", "[0.0, 0.0, 0.0]", "constants.gravity_direction", "zero vector"),
        ("cable_length_m = 4.0", "cable_length_mm = 4000.0", "suspension.cable_length_mm", "in m"),
    ],
)
def test_bad_environments(tmp_path: Path, old: str, new: str, key: str, reported: str) -> None:
    (fault,) = faults_of(load_environment, edited(tmp_path, LAB, (old, new)))
    assert fault.key == key
    assert reported in fault.message


def test_orbit_needs_no_file_in_python_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_setup(DM, "orbit")[1] == load_environment("orbit") == Environment.orbit()
    own = tmp_path / "orbit"  # a file of that name is what is meant
    own.write_text('schema = 1\nname = "mine"\n', encoding="utf-8")
    assert load_environment("orbit").title == "mine"


def test_gravity_may_point_anywhere_and_springs_may_carry(tmp_path: Path) -> None:
    text = """
schema = 1
name = "slope"
[constants]
gravity_m_s2 = 2.0
gravity_direction = [3.0, 0.0, -4.0]
[[spring]]
attach = "n1"
anchor_m = [0.0, 1.0, 0.0]
stiffness_n_per_m = 10.0
free_length_m = 0.5
"""
    environment = load_environment(written(tmp_path, "slope.toml", text))
    assert environment.gravity == pytest.approx(np.array([1.2, 0.0, -1.6]), abs=1e-15)  # rounding
    assert environment.springs[0].name == "spring_n1"
    assert environment.suspension is None


# ---- studies -----------------------------------------------------------------------------------------------


def study_copy(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    for folder in ("articles", "environments", "data"):
        link = tmp_path / folder
        link.symlink_to(ROOT / folder)
    (tmp_path / "studies").mkdir()
    return edited(tmp_path / "studies", STUDY, *changes)


@pytest.mark.parametrize(
    ("old", "new", "key", "reported", "hint"),
    [
        ("modes_kept = 26 ", "modes_kep = 26 ", "control.modes_kep", "unknown key", "'modes_kept'?"),
        ("levels = 25", "levels = 1", "control.levels", "must be 2 to", ""),
        (
            '"sec_rel_x", "sec_rel_z"]\n',
            '"sec_rel_x", "sec_rl_z"]\n',
            "control.disturbances.1",
            "no such port",
            "?",
        ),
        ("[1.0, 1.0, 0.5, 0.5, 0.5]", "[1.0, 1.0, 0.5]", "control.metric_weights", "3 values for the 5", ""),
        ("band_hz = [0.1, 60.0]", "band_hz = [60.0, 0.1]", "control.band_hz", "must ascend", ""),
        ("delay_s = 0.010", "delay_ms = 10.0", "rig.delay_ms", "'delay_s' is expected, in s", "convert to s"),
        ("mace-dm.toml", "mace-md.toml", "article.dm", "no such file", "study file's own folder"),
        ("mace-dm.toml", f"{300 * 'x'}.toml", "article.dm", "no such file", "study file's own folder"),
        (
            'article = "simple"',
            'article = "simpel"',
            "control.article",
            "no article of this name",
            "'simple'?",
        ),
        ("states = 10", "states = 11", "siso.states", "must be even", ""),
        ("states = 28\n", "states = 27\n", "sito.states", "must be even", ""),
        (
            'sensors = ["pri_rel_z", "bus_z"]',
            'sensors = ["pri_in_z", "bus_z"]',
            "sito.sensors",
            "two sensors",
            "",
        ),
        (
            'sensors = ["pri_rel_z", "bus_z"]',
            'sensors = ["pri_rel_z", "bus_y2"]',
            "sito.sensors.1",
            "no such port",
            "bus_y",
        ),
        (
            "log10_authority_last = 4.5",
            "log10_authority_last = -4.5",
            "control.log10_authority_last",
            "> log10",
            "",
        ),
    ],
)
def test_bad_studies(tmp_path: Path, old: str, new: str, key: str, reported: str, hint: str) -> None:
    path = study_copy(tmp_path, (old, new))
    faults = {f.key: f for f in faults_of(load_study, path)}
    assert reported in faults[key].message
    assert hint in faults[key].hint
    assert faults[key].file == str(path)
    assert faults[key].line == line_with(path, new.strip())


def test_a_study_reports_its_articles_errors_once(tmp_path: Path) -> None:
    """An environment serves two articles; its error is still one."""
    path = study_copy(tmp_path)
    (tmp_path / "environments").unlink()
    (tmp_path / "environments").mkdir()
    edited(tmp_path / "environments", LAB, ("bounce_hz = 0.25", "bounce_hz = -1.0"))
    edited(tmp_path / "environments", ROOT / "environments/orbit.toml", ("schema = 1", "schema = 3"))
    assert sorted(f.key for f in faults_of(load_study, path)) == ["schema", "suspension.bounce_hz"]


def test_the_study_is_whole_and_names_its_inputs() -> None:
    study = load_study(STUDY)
    assert {(c.article, c.environment) for c in study.cases} == {
        (a, e) for a in ("dm", "simple") for e in ("orbit", "lab")
    }
    assert dict(study.inputs).keys() >= {
        "mace-1993.toml",
        "../articles/mace-dm.toml",
        "../environments/lab.toml",
    }
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for _, digest in study.inputs)
    assert hash(study) == hash(load_study(STUDY))
    assert study == load_study(STUDY)


# ---- what the forms describe -------------------------------------------------------------------------------


def test_the_development_model_as_described() -> None:
    dm, lab = load_setup(DM, LAB)
    assert dm.mass == pytest.approx(28.8, abs=0.05)  # the sheet's total, given to 0.1 kg
    assert [a.name for a in dm.actuators] == ["bus_x", "bus_y", "bus_z", "pri_rel_x", "pri_rel_z"]
    assert [s.name for s in dm.sensors] == [
        "bus_x", "bus_y", "bus_z", "pri_in_x", "pri_in_z", "pri_rel_x", "pri_rel_z"
    ]  # fmt: skip
    payload = next(s for s in dm.sensors if s.name == "pri_in_x")
    assert (payload.frame, payload.axis_frame) == ("pri_z", "pri_x")
    stage, inner = dm.joints
    assert (stage.name, stage.parent, inner.name, inner.parent) == ("pri_x", "n1", "pri_z", "pri_x")
    assert (stage.body.mass, inner.body.mass) == (1.5, 5.0)
    assert inner.offset.tolist() == [0.0, 0.0, 0.0]
    section = dm.members[0].section
    second_moment = np.pi * (0.0254**4 - 0.013**4) / 64.0
    assert section.EI_y == section.EI_z == pytest.approx(2.35e9 * second_moment, rel=1e-14)  # rounding
    assert pytest.approx(2.35e9 / 2.74 * 2.0 * second_moment, rel=1e-14) == section.GJ
    assert np.isinf([section.GA_y, section.GA_z]).all()
    assert lab.suspension is not None
    assert lab.suspension.held == ("yz", "xyz", "yz")


def test_what_else_the_form_holds(tmp_path: Path) -> None:
    more = """
[[revolute]]
name = "arm"
parent = "b"
axis = [0.0, 3.0, 4.0]
angle_deg = 90.0
mass_kg = 2.0
inertia_kg_m2 = [[0.2, 0.01, 0.0], [0.01, 0.2, 0.0], [0.0, 0.0, 0.3]]
state = "driven"
command_deg = 45.0
[[actuator]]
name = "push"
frame = "arm"
axis = [0.0, 0.0, 2.0]
[[sensor]]
name = "look"
frame = "arm"
axis = [1.0, 0.0, 0.0]
axis_frame = "a"
"""
    arm = load_structure(written(tmp_path, "arm.toml", BEAM + more))
    (joint,) = arm.joints
    assert joint.axis == pytest.approx(np.array([0.0, 0.6, 0.8]), abs=1e-15)  # rounding
    assert (joint.state, joint.angle, joint.target) == (JointState.DRIVEN, np.pi / 2, np.pi / 4)
    assert joint.body.inertia[0, 1] == 0.01
    assert [a.name for a in arm.actuators] == ["arm_rel", "push"]
    assert arm.actuators[1].axis is not None
    assert arm.actuators[1].axis.tolist() == [0.0, 0.0, 1.0]
    assert arm.sensors[1].axis_frame == "a"
    assert arm.members[0].section.EI_z == 30.0


def test_an_upright_member_gets_a_direction_of_its_own(tmp_path: Path) -> None:
    tower = BEAM.replace('name = "b"\nx_m = 1.0', 'name = "b"\nx_m = 0.0\ny_m = 1.0')
    assert load_structure(written(tmp_path, "t.toml", tower)).members[0].up.tolist() == [1.0, 0.0, 0.0]


def test_documents_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert find_document("lab", "environment") == Path("environments/lab.toml")
    assert find_document("articles/mace-dm.toml", "article") == Path("articles/mace-dm.toml")
    monkeypatch.chdir(tmp_path)
    assert find_document("orbit", "environment", beside=DM) == ROOT / "environments/orbit.toml"
    with pytest.raises(ConfigError, match="did you mean 'orbit'"):
        find_document("orbt", "environment", beside=DM)
    with pytest.raises(ConfigError, match="give the path of an article file"):
        find_document("none", "article")


def test_what_a_document_names_is_the_same_from_every_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A path from its own folder, or a name that the folders next to it have; then those of the reader."""
    (tmp_path / "tests").mkdir()
    (tmp_path / "environments").mkdir()
    document = tmp_path / "tests/refine.toml"
    near, folder = tmp_path / "tests/e.toml", tmp_path / "environments/lab.toml"
    for file in (near, folder):
        file.write_text(LAB.read_text())
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "environments").mkdir(parents=True)
    for name in ("e.toml", "environments/lab.toml", "environments/far.toml"):
        (elsewhere / name).write_text(LAB.read_text())
    for here in (elsewhere, tmp_path, tmp_path / "tests"):
        monkeypatch.chdir(here)
        assert find_stated("e.toml", document).samefile(near)
        assert find_stated("e", document).samefile(near)
        assert find_stated("lab", document).samefile(folder)
        assert find_stated(str(folder), document).samefile(folder)
        assert find_stated("orbit", document) == BUILT_IN["orbit"]
    monkeypatch.chdir(elsewhere)
    assert find_stated("environments/far.toml", document) == Path("environments/far.toml")
    assert find_stated("far", document) == Path("environments/far.toml")


def test_what_the_current_folder_holds_hides_nothing_by_the_document(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files and folders there of the same names, without .toml too; one of another project is never taken."""
    for folder in ("proj/refinements", "proj/environments", "other/environments", "third/lab", "third/hall"):
        (tmp_path / folder).mkdir(parents=True)
    for file in ("proj/environments/lab.toml", "proj/environments/hall.toml", "other/environments/lab.toml"):
        (tmp_path / file).write_text(LAB.read_text())
    (tmp_path / "other/hall").write_text(LAB.read_text())
    (tmp_path / "other/environments/orbit.toml").write_text(LAB.read_text())
    document = tmp_path / "proj/refinements/doc.toml"
    folders = tmp_path / "proj/environments"
    for here in ("proj", "proj/refinements", "other", "third"):
        monkeypatch.chdir(tmp_path / here)
        for stated in (document, Path(os.path.relpath(document))):
            for name, file in (
                ("hall", "hall.toml"),
                ("lab", "lab.toml"),
                ("environments/lab.toml", "lab.toml"),
            ):
                assert find_stated(name, stated).samefile(folders / file)
            assert find_stated("orbit", stated) == BUILT_IN["orbit"]
    assert find_document("lab", "environment", beside=document).samefile(folders / "lab.toml")
    with pytest.raises(ConfigError, match="hall is a folder"):
        find_document("hall", "environment")


@pytest.mark.parametrize("name", ["dm", "simple"])
def test_the_laboratory_without_a_file_is_that_of_the_file(name: str) -> None:
    article = load_structure(ROOT / f"articles/mace-{name}.toml")
    assert Environment.lab(article) == load_environment(LAB)
    low = Environment.lab(article, cable_length=3.0, bounce_hz=0.2, gravity=1.62)
    assert low == load_environment(
        LAB, ["suspension.cable_length=3", "suspension.bounce_hz=0.2", "constants.gravity=1.62"]
    )
    with pytest.raises(ConfigError, match="no attach point"):
        Environment.lab(dataclasses.replace(article, attach_points=()))


def test_orbit_needs_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    article = written(tmp_path, "beam.toml", BEAM)
    own = find_document("orbit", "environment", beside=article)
    assert load_environment(own) == Environment.orbit() == load_environment(ROOT / "environments/orbit.toml")
    (tmp_path / "environments").mkdir()
    written(tmp_path, "environments/orbit.toml", "")
    assert find_document("orbit", "environment") == Path("environments/orbit.toml")


def test_lines_are_those_of_the_file() -> None:
    text = """# comment
a = 1
b.c = [
  1, # [not a table]
  2,
]
[t]
s = '''
x = 3
'''
[[n]]
x = 1
[n.sub]
y = 2
[[n]]
"quoted key" = { z = 5 }
"""
    lines = key_lines(text)
    assert {k: lines[k] for k in [("a",), ("b", "c"), ("b", "c", 1), ("t", "s")]} == {
        ("a",): 2, ("b", "c"): 3, ("b", "c", 1): 5, ("t", "s"): 8
    }  # fmt: skip
    assert ("t", "x") not in lines
    assert lines["n", 0, "sub", "y"] == 14
    assert (lines["n", 1], lines["n", 1, "quoted key", "z"]) == (15, 16)


def test_lines_of_a_long_array_are_found_at_once() -> None:
    """In any layout of commas, comments and nested arrays."""
    five = ["[1, 2],", "[3,", "  4] # of two", ", [5]", "# none", ", [6], [7],"]
    lines = key_lines("\n".join(["x = [", *five * 60, "]"]))
    for k in (0, 30, 59):
        found = [lines["x", 5 * k + i] - 6 * k for i in range(5)]
        assert found == [2, 4, 5, 7, 7]
    bodies = "".join(f"{{x = {i}}},\n" for i in range(2000))
    assert key_lines(f"node = [\n{bodies}]")["node", 1999, "x"] == 2001
    assert key_lines("a = { b = [\n1,\n] } # of\nc = 1")["c",] == 4


def test_reading_documents_is_light() -> None:
    code = (
        "import sys, middeck.files.studies.documents, middeck.files.records\n"
        "heavy = {'scipy', 'matplotlib', 'click'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


JUNK = st.one_of(
    st.none().map(lambda _: {}),
    st.booleans(),
    st.integers(-3, 3),
    st.floats(),
    st.text(max_size=3),
    st.lists(st.one_of(st.floats(), st.text(max_size=2), st.lists(st.floats(), max_size=3)), max_size=4),
    st.dictionaries(st.sampled_from(["name", "x_m", "mass_kg"]), st.integers(), max_size=2),
)
DOCUMENTS = [
    (DM, ArticleForm, article_findings),
    (LAB, EnvironmentForm, environment_findings),
    (STUDY, StudyForm, study_rules),
]


@settings(max_examples=600 if LONG else 30)
@given(st.data())
def test_no_junk_breaks_the_checks(data: st.DataObject) -> None:
    """Whatever stands at one or two places, the checks end with faults that have words, or with none."""
    path, form, more = data.draw(st.sampled_from(DOCUMENTS))
    source = read_source(path)
    tables = copy.deepcopy(source.data)
    for _ in range(data.draw(st.integers(1, 2))):
        place = tables
        for _ in range(data.draw(st.integers(0, 3))):
            children = list(place.values() if isinstance(place, dict) else place)
            branches = [c for c in children if isinstance(c, dict | list) and c]
            place = data.draw(st.sampled_from(branches)) if branches else place
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        place[data.draw(st.sampled_from(keys))] = data.draw(JUNK)
    checked = check(source, tables, {}, form, more)
    assert checked.faults or checked.form is not None
    assert all(f.key and f.message and f.line > 0 for f in checked.faults)


# ---- what a study asks of its articles and its rig ---------------------------------------------------------

IMPOSSIBLE = {
    "a metric that is no output": (
        'control.metric=["sec_in_z", "bus_x", "bus_y", "bus_z", "pri_in_x"]',
        "control.metric.0",
        "neither among angles nor among pd_loops",
    ),
    "a loop that is no input": (
        'control.disturbances=["sec_rel_x"]',
        "control.pd_loops.6",
        "neither among inputs nor among disturbances",
    ),
    "no states for the delay": ("siso.pade_order=0", "siso.pade_order", "must be 1 to 12"),
    "a rig that answers at once": ("rig.delay_s=0", "rig.delay_s", "must be >= 0.001 s"),
    "a period of broken samples": ("siso.period_s=1.0001", "siso.period_s", "must be a whole number"),
    "a band beyond half the rate": ("rig.sample_hz=100", "siso.band_hz.1", "below half of rig.sample_hz"),
    "a locked axis to drive": ("gimbal.sec.state_x=locked", "gimbal.1.state_x", "drives 'sec_rel_x'"),
    "a driven axis to drive": (
        "article.dm.gimbal.0.state_z=driven",
        "gimbal.0.state_z",
        "drives 'pri_rel_z'",
    ),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_what_no_study_can_do_is_found_on_loading(case: str) -> None:
    override, key, text = IMPOSSIBLE[case]
    (fault,) = faults_of(load_study, STUDY, [override])
    assert fault.key == key
    assert text in fault.message
    setter = override.partition("=")[0]
    # The blame is on the override, or on the line of what does not go with it.
    line = STUDY.read_text(encoding="utf-8").splitlines()[fault.line - 1]
    assert fault.file == f"--set {setter}" or line.startswith(key.split(".")[1])


def test_half_a_sample_of_delay_is_enough() -> None:
    assert load_study(STUDY, ["rig.delay_s=0.001"]).rig.delay_s == 0.001


def test_settings_of_a_study_are_locked_and_typed(paper_study):
    with pytest.raises(ValidationError, match="frozen"):
        paper_study.control.band_hz = (1.0, 2.0)
    hints = typing.get_type_hints(type(paper_study).control.fget)
    assert "band_hz" in hints["return"].model_fields


@pytest.mark.parametrize(("read", "table"), [("siso", "siso"), ("loop_test", "siso"), ("rig", "rig")])
def test_a_table_that_lacks_has_the_name_that_the_file_gives_it(paper_study, read, table):
    without = dataclasses.replace(paper_study, form=paper_study.form.model_copy(update={table: None}))
    with pytest.raises(ConfigError, match=rf"no table \[{table}\]"):
        getattr(without, read)
