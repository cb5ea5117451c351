"""``--set`` reaches any value by the sheet's name, and says so when it cannot."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_sheet import SHEET_LEAVES, leaves, targets

from middeck.errors import ConfigError
from middeck.files.setups import load_setup
from middeck.files.studies.documents import load_study
from middeck.files.toml.overrides import apply_overrides, parse_override
from middeck.structure.model.article import JointState, Structure
from middeck.structure.model.environment import Environment

ROOT = Path(__file__).parents[2]
NUMBERS = [(p, v) for p, v in SHEET_LEAVES if isinstance(v, int | float)]


def case(*overrides: str, article: str = "dm", environment: str = "lab") -> tuple[Structure, Environment]:
    return load_setup(
        ROOT / f"articles/mace-{article}.toml", ROOT / f"environments/{environment}.toml", overrides
    )


def refused(*overrides: str, environment: str = "lab") -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        case(*overrides, environment=environment)
    return caught.value


@settings(deadline=None, max_examples=60)
@given(st.sampled_from(NUMBERS), st.floats(0.5, 2.0))
def test_an_override_lands_on_its_value_and_nowhere_else(leaf: tuple[Any, Any], factor: float) -> None:
    path, value = leaf
    new = value + 1 if isinstance(value, int) else float(value * factor + 0.125)
    documents = targets()
    before = [dict(leaves(copy.deepcopy(t.data))) for t in documents]
    after, _ = apply_overrides(documents, [f"{'.'.join(path)}={new!r}"])
    changed = [(p, v) for b, d in zip(before, after, strict=True) for p, v in leaves(d) if b[p] != v]
    assert changed
    assert all(v == new for _, v in changed)
    last = [part for part in path if not part.isdigit()][-1]
    # The key in the file begins with the sheet's; indices, where there are any, are the same.
    for place, _ in changed:
        assert [x for x in place if not x.isdigit()][-1].startswith(last)
        assert [x for x in place if x.isdigit()] == [x for x in path if x.isdigit()]
    assert all(dict(leaves(t.data)) == b for t, b in zip(documents, before, strict=True)), "input was changed"


def test_values_reach_the_structure_and_the_environment() -> None:
    structure, environment = case(
        "suspension.bounce_hz=0.2",
        "suspension.offsets.0.2=-0.01",
        "material.lexan.E=2.5e9",
        "node.n2.mass=0.5",
        "gimbal.0.angle_x_deg=30",
        "damping.flexible=0.02",
        "constants.gravity=1.62",
        "wheel_node=n2",
        "section.strut.outer_diameter=0.03",
    )
    assert environment.suspension is not None
    assert environment.suspension.bounce_hz == 0.2
    assert environment.gravity.tolist() == [0.0, -1.62, 0.0]
    assert structure.attach_points[0].offset.tolist() == [0.0, 0.02, -0.01]
    assert structure.nodes[1].body.mass == 0.5
    assert structure.joints[0].angle == np.deg2rad(30.0)
    assert structure.damping.flexible == 0.02
    assert structure.actuators[0].frame == "n2"
    area = np.pi * (0.03**2 - 0.013**2) / 4.0
    assert pytest.approx(2.5e9 * area, rel=1e-14) == structure.members[0].section.EA  # rounding


def test_an_optional_key_that_the_file_omits_can_be_set() -> None:
    structure, _ = case("gimbal.pri.state_x=sprung", "gimbal.pri.stiffness_x=3.5", "section.strut.shear=0.5")
    assert (structure.joints[0].state, structure.joints[0].stiffness) == (JointState.SPRUNG, 3.5)
    assert np.isfinite(structure.members[0].section.GA_y)
    assert case("node.0.y=0.1")[0].nodes[0].position.tolist() == [0.0, 0.1, 0.0]


def test_an_article_prefix_confines_a_value_wherever_it_lives() -> None:
    study = load_study(
        ROOT / "studies/mace-1993.toml",
        ["article.dm.suspension.cable_length=3.0", "article.simple.node.0.mass=3.5", "control.modes_kept=24"],
    )
    lengths = {
        c.article: c.surroundings.suspension.cable_length for c in study.cases if c.surroundings.suspension
    }
    assert lengths == {"dm": 3.0, "simple": 4.0}
    assert study.case("dm", "lab")[0].nodes[0].body.mass == 3.0
    assert study.case("simple", "orbit")[0].nodes[0].body.mass == 3.5
    assert study.control.modes_kept == 24
    with pytest.raises(ConfigError, match="no article 'dm' in an environment 'mars'") as caught:
        study.case("dm", "mars")
    assert caught.value.hint == "articles: dm, simple; environments: orbit, lab"


def test_a_suspension_value_has_no_effect_in_orbit() -> None:
    overrides = ("suspension.bounce_hz=0.2", "constants.gravity_direction=[0,0,-1]")
    with pytest.warns(UserWarning, match="has no effect: its table is not in .*orbit") as caught:
        changed = case(*overrides, environment="orbit")[1]
    assert changed == case(environment="orbit")[1]
    assert len(caught) == len(overrides)


@pytest.mark.parametrize("turned", [False, True])
def test_gravity_is_set_where_there_was_none(tmp_path: Path, turned: bool) -> None:
    path = tmp_path / "held.toml"
    path.write_text('schema = 1\nname = "held"\n[[clamp]]\nnode = "n1"\n')
    overrides = ("constants.gravity_direction=[0,0,-1]", "constants.gravity=1.62")
    found = load_setup(ROOT / "articles/mace-dm.toml", path, overrides[:: -1 if turned else 1])[1]
    assert found.gravity.tolist() == [0.0, 0.0, -1.62]


def test_gravity_is_refused_where_nothing_holds() -> None:
    assert "a missing suspension in gravity" in str(refused("constants.gravity=1.62", environment="orbit"))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("suspension.bounse_hz=1", "did you mean 'suspension.bounce_hz'?"),
        ("node.9.mass=1", "did you mean 'node."),
        ("control.modes_kept=24", "unknown key; not in"),  # a study's value; this verb reads no study
        ("article.simple.node.0.mass=1", "no article 'simple' is read here"),
        ("node.0.mass", "not of the form key=value"),
        ("node.0.mass=", "not of the form key=value"),
        ("node..mass=1", "not of the form key=value"),
        ("node.0.mass=[1", "is not TOML"),
        ("node.0.mass=1\nx = 2", "is not TOML"),
        ("node.0.mass=1.2.3", "is not TOML"),
        ("node.0.mass=..5", "is not TOML"),
        ("suspension.bounce=0.2", "did you mean 'suspension.bounce_hz'?"),  # the sheet writes its unit out
        ("gimbal.0.angle_x=30", "did you mean 'gimbal.0.angle_x_deg'?"),
    ],
)
def test_what_cannot_be_set_is_refused(override: str, message: str) -> None:
    error = refused(override)
    assert message in str(error)
    assert error.exit_code == 2
    assert error.data["faults"][0].file == "--set"


def test_a_value_out_of_range_is_reported_at_its_override() -> None:
    error = refused(
        "node.0.mass=-3", "gimbal.0.angle_x_deg=400", "suspension.bounce_hz=nan", "damping.flexible=yes"
    )
    faults = {f.file: f for f in error.data["faults"]}
    assert set(faults) == {
        f"--set {k}"
        for k in ("node.0.mass", "gimbal.0.angle_x_deg", "suspension.bounce_hz", "damping.flexible")
    }
    mass = faults["--set node.0.mass"]
    assert (mass.key, mass.value, mass.message) == ("node.0.mass_kg", "-3", "must be >= 0 kg")
    assert faults["--set gimbal.0.angle_x_deg"].message == "must be >= -180 and <= 180 deg"
    assert "finite" in faults["--set suspension.bounce_hz"].message


def test_all_unknown_overrides_are_reported_at_once() -> None:
    assert len(refused("a.b=1", "c=2").data["faults"]) == 2


def test_later_overrides_win() -> None:
    assert case("node.0.mass=4", "node.0.mass=5")[0].nodes[0].body.mass == 5.0


@pytest.mark.parametrize(
    ("written", "value"),
    [("0.2", 0.2), (".2", 0.2), ("1e-5", 1e-5), ("2.", 2.0), ("24", 24), ("[1.0, 2.0]", [1.0, 2.0]),
     ('"n3"', "n3"), ("n3", "n3"), ("true", True), ("../articles/x.toml", "../articles/x.toml"),
     ("./x.toml", "./x.toml"), ("../a b/x-1.toml", "../a b/x-1.toml"), ("über/x.toml", "über/x.toml")],
)  # fmt: skip
def test_values_are_toml_and_bare_words_and_paths(written: str, value: Any) -> None:
    assert parse_override(f"a.b={written}").value == value


WRITTEN_OUT = ("_hz", "_deg", "_s", "_nm")


@pytest.mark.parametrize("path", [p for p, _ in SHEET_LEAVES if p[-1].endswith(WRITTEN_OUT)], ids=".".join)
def test_a_unit_that_the_sheet_writes_out_is_not_left_out(path: tuple[str, ...]) -> None:
    stripped = path[-1].rpartition("_")[0]
    with pytest.raises(ConfigError, match="unknown key"):
        apply_overrides(targets(), [f"{'.'.join((*path[:-1], stripped))}=1"])


def test_a_missing_file_is_blamed_on_the_override_that_named_it() -> None:
    with pytest.raises(ConfigError) as caught:
        load_study(ROOT / "studies/mace-1993.toml", ["mirror.train=nofile.npz", "article.dm=../none.toml"])
    assert [(f.file, f.key, f.value) for f in caught.value.data["faults"]] == [
        ("--set article.dm", "article.dm", '"../none.toml"'),
        ("--set mirror.train", "mirror.train", '"nofile.npz"'),
    ]


def test_a_bare_path_replaces_a_document() -> None:
    study = load_study(ROOT / "studies/mace-1993.toml", ["article.simple=../articles/mace-simple.toml"])
    assert study.case("simple", "orbit")[0].title.startswith("Simple")


def test_a_value_wrong_in_two_documents_is_one_fault() -> None:
    (fault,) = refused("schema=2").data["faults"]
    assert (fault.file, fault.message) == ("--set schema", "must be 1")
