"""Clamps, bushings, hinges and load cases in files and on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck
from middeck.errors import ConfigError
from middeck.files.setups import load_setup, load_structure
from middeck.structure.model.article import JointState

BOOM = """\
schema = 1
name = "boom"
node = [{name = "root", x_m = 0.0}, {name = "tip", x_m = 2.0}]
strut = [{section = "tube", from = "root", to = "tip", elements = 4}]
attach = [{name = "heel", frame = "root"}, {name = "end", frame = "tip"}]
bushing = [{from = "heel", to = "end", stiffness = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], y_axis = [1.0, 1.0, 0.0]}]
[section.tube]
EA_n = 1e6
GJ_nm2 = 80.0
EI_y_nm2 = 100.0
EI_z_nm2 = 100.0
rho_A_kg_per_m = 0.5
rho_I_y_kg_m = 1e-5
rho_I_z_kg_m = 1e-5
[[revolute]]
name = "arm"
parent = "tip"
axis = [0.0, 0.0, 1.0]
mass_kg = 0.1
cg_m = [0.1, 0.0, 0.0]
state = "hinged"
[[load_case]]
name = "pull"
load = [{frame = "tip", force_n = [0.0, -2.0, 0.0], offset_m = [0.0, 0.0, 0.1]}]
mass = [{frame = "tip", mass_kg = 1.5, cg_m = [0.0, 0.1, 0.0]}]
[[load_case]]
name = "settle"
prescribed = [{node = "tip", along = "y", about = "", shift_m = [0.0, 0.001, 0.0]}]
"""
WALL = """\
schema = 1
name = "wall"
clamp = [{node = "root", x_axis = [0.0, 2.0, 0.0], y_axis = [0.0, 1.0, 1.0]}]
bushing = [{attach = "end", stiffness = [0.0, 5.0, 0.0, 0.0, 0.0, 0.0]}]
[constants]
gravity_m_s2 = 9.80665
"""


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    boom, wall = tmp_path / "boom.toml", tmp_path / "wall.toml"
    boom.write_text(BOOM)
    wall.write_text(WALL)
    return boom, wall


def test_files_say_what_holds_and_loads_an_article(files: tuple[Path, Path]) -> None:
    parts, wall = load_setup(*files)
    (bushing,), (clamp,), (ground,) = parts.bushings, wall.clamps, wall.bushings
    assert (bushing.start, bushing.end, bushing.stiffness[4, 4]) == ("heel", "end", 5.0)
    np.testing.assert_allclose(bushing.axes, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(clamp.axes.T, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    assert (ground.name, ground.stiffness[1, 1]) == ("bushing_end", 5.0)
    pull, settle = parts.load_cases
    np.testing.assert_array_equal(pull.loads[0].offset, [0.0, 0.0, 0.1])
    assert pull.masses[0].body.mass == 1.5
    assert settle.prescribed[0].shift[1] == 0.001
    (arm,) = parts.joints
    assert (arm.state, arm.stiffness) == (JointState.SPRUNG, 0.0)


@pytest.mark.parametrize(("case", "weight"), [((), 1.1), (("--load-case", "pull"), 2.6)])
def test_modes_apply_a_load_case(
    case: tuple[str, ...], weight: float, files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]
) -> None:
    ended = middeck(capfd, "modes", files[0], "--environment", files[1], "--count", "3", "--json", *case)
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    up = sum(r["force_n"][1] for r in found["support_reactions"])
    assert up == pytest.approx(weight * 9.80665 + (2.0 if case else 0.0), rel=1e-8)
    assert "suspension" not in found["kind"]


@pytest.mark.parametrize("verb", ["compare", "sensitivity", "check", "path"])
def test_other_verbs_take_one_too(
    verb: str, files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]
) -> None:
    where = [files[1]] if verb == "check" else ["--environment", files[1]]
    more = {"sensitivity": ["--parameter", "mass.*.mass", "--count", "1"], "compare": ["--count", "8"]}
    more["path"] = ["--through", "earth,mars", "--count", "2"]
    ended = middeck(capfd, verb, files[0], *where, "--load-case", "pull", *more.get(verb, []))
    assert ended.code == 0, ended.err
    ended = middeck(capfd, verb, files[0], *where, "--load-case", "push", *more.get(verb, []))
    assert ended.code != 0
    assert "no load case 'push'" in ended.err
    assert "load cases are pull, settle" in ended.err


@pytest.mark.filterwarnings("ignore:.*the mesh is coarse")
@pytest.mark.filterwarnings("ignore:.*elements are bent by more")
def test_plants_are_those_of_the_load_case(
    files: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    coarse = BOOM.replace("elements = 4", "elements = 1")
    load = 'load = [{frame = "tip", force_n = [0.0, -2.0, 0.0], offset_m = [0.0, 0.0, 0.1]}]'
    files[0].write_text(coarse.replace(load, ""))
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(coarse.replace("x_m = 2.0", "x_m = 2.0, mass_kg = 1.5, cg_m = [0.0, 0.1, 0.0]"))
    ports = ("--environment", files[1], "--count", "4")
    asked = ("--input", "arm_rel", "--output", "arm_rel", "--at", "0.3,1", "--json")
    bolted, built, bare = (
        json.loads(middeck(capfd, "response", *where, *ports, *asked).out)["re"]
        for where in ((files[0], "--load-case", "pull"), (heavy,), (files[0],))
    )
    np.testing.assert_allclose(bolted, built, rtol=1e-9)
    assert np.abs(np.array(bare) / built - 1.0).max() > 1e-3
    law, control = tmp_path / "law.json", ("--control", "arm_rel", "--measure", "arm_rel", "--authority", "1")
    ended = middeck(capfd, "design", files[0], "--load-case", "pull", *ports, *control, "-o", law)
    assert ended.code == 0
    here, there = (
        json.loads(middeck(capfd, "qualify", law, *where, *ports, "--json").out)["rows"][0]["rms"]
        for where in ((files[0], "--load-case", "pull"), (heavy,))
    )
    assert here == pytest.approx(there, rel=1e-6)
    ended = middeck(capfd, "qualify", law, law, "--load-case", "pull")
    assert ended.code == 2
    assert "--load-case is for articles" in ended.err


@pytest.mark.parametrize("verb", ["level", "budget"])
def test_verbs_that_cannot_use_a_case_say_so(
    verb: str, files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]
) -> None:
    more = {"level": ["--free", "end.z", "--about", "x"]}.get(verb, [])
    ended = middeck(capfd, verb, files[0], "--environment", files[1], "--load-case", "pull", *more)
    assert ended.code != 0
    assert {"level": "nothing hangs", "budget": "applied loads shift the frequencies too"}[verb] in ended.err


WRONG = {
    'frame = "tip", force_n': ('frame = "top", force_n', "load_case.0.load.0.frame", "no frame of this name"),
    'node = "tip", along': ('node = "heel", along', "prescribed.0.node", "no node of this name"),
    'name = "settle"': ('name = "pull"', "load_case.1.name", "a second load case of this name"),
    "5.0, 6.0]": ("5.0]", "bushing.0.stiffness", "not six numbers"),
    'to = "end", stiff': ('to = "tip", stiff', "bushing.0.to", "no attach point of this name"),
    'along = "y"': ('along = "yx"', "prescribed.0.along", "x, y, z, in this order"),
    'along = "y", about': ('along = "", about', "28: load_case.1.prescribed.0", "holds nothing"),
    "[0.0, 0.001, 0.0]": ("[0.1, 0.001, 0.0]", "28: load_case.1.prescribed.0", "shifts along 'x'"),
    "5.0, 6.0": ("5.0, -6.0", "6: bushing.0.stiffness", "indefinite"),
    "mass_kg = 1.5": (
        "mass_kg = 1.5, inertia_kg_m2 = [1.0, 1.0, 9.0]",
        "25: load_case.0.mass.0.inertia_kg_m2",
        "triangle inequality",
    ),
}


@pytest.mark.parametrize("right", WRONG)
def test_mistakes_are_named_with_their_line(right: str, files: tuple[Path, Path]) -> None:
    wrong, key, message = WRONG[right]
    assert BOOM.count(right) == 1
    files[0].write_text(BOOM.replace(right, wrong))
    with pytest.raises(ConfigError) as error:
        load_structure(files[0])
    assert key in str(error.value)
    assert message in str(error.value)


def test_an_environment_names_nodes_of_the_article(files: tuple[Path, Path]) -> None:
    files[1].write_text(WALL.replace('"root"', '"rot"').replace('"end"', '"and"'))
    with pytest.raises(ConfigError) as error:
        load_setup(*files)
    assert "no node 'rot'" in str(error.value)
    assert "no attach point 'and'" in str(error.value)
    files[1].write_text(WALL.replace("[0.0, 1.0, 1.0]", "[0.0, 3.0, 0.0]"))
    with pytest.raises(ConfigError, match=r"toml:3: clamp.0: .*make no plane"):
        load_setup(*files)
    files[1].write_text(WALL.replace("clamp = [", 'clamp = [{node = "root"}, '))
    with pytest.raises(ConfigError, match=r"toml:3: clamp.1: a degree of freedom is fixed"):
        load_setup(*files)
    files[1].write_text(WALL.replace('node = "root"', 'node = ["root"]'))
    with pytest.raises(ConfigError, match=r"toml:3: clamp.0.node = \["):
        load_setup(*files)
    files[1].write_text(WALL.replace('"end", stiff', '"end", name = "root", stiff'))
    with pytest.raises(ConfigError, match=r"toml:4: bushing.0.name = \"root\": names a second support"):
        load_setup(*files)


@pytest.mark.parametrize("key", ["mass = [{frame =", "load = [{frame =", "parent ="])
def test_an_attach_point_in_place_of_a_frame_is_answered_with_its_frame(tmp_path: Path, key: str) -> None:
    """As of a converted deck, where a grid that rides rigidly is an attach point; a near name misled."""
    article = tmp_path / "boom.toml"
    article.write_text(BOOM.replace(f'{key} "tip"', f'{key} "end"', 1))
    with pytest.raises(ConfigError, match="no frame of this name") as caught:
        load_structure(article)
    assert (
        caught.value.hint == 'it is an attach point on "tip": name that, and its offset_m as the place there'
    )


def test_a_grid_of_a_component_at_an_attach_point_is_reported_with_its_offset(tmp_path: Path) -> None:
    """The offset of a grid has its own key: `offset_m` misled."""
    article = tmp_path / "boom.toml"
    article.write_text(BOOM + '[[component]]\nname = "c"\nfile = "c.npz"\nnodes = {7 = "end"}\n')
    with pytest.raises(ConfigError, match="no frame of this name") as caught:
        load_structure(article)
    expected = 'it is an attach point on "tip": name that, and its offset in offsets_m.7 as the place there'
    assert caught.value.hint == expected
