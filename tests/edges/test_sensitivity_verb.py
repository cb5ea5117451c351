"""``middeck sensitivity`` prints what the room computes, and names what it cannot differentiate."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from coarse_articles import coarse
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.structure.sensitivity.rest import differentiate_rest

DM = coarse("mace-dm")
LAB = ROOT / "environments/lab.toml"
NAMES = ["joint.pri_z.cg.x", "environment.bounce_hz"]


def test_json_is_the_library(capfd: pytest.CaptureFixture[str]) -> None:
    ended = middeck(capfd, "sensitivity", DM, "--parameter", ",".join(NAMES), "--count", 14, "--json")
    assert (ended.code, ended.err) == (0, "")
    found = json.loads(ended.out)
    article, lab = md.load_setup(DM, LAB)
    modes = md.solve_modes(md.solve_equilibrium(article, lab))
    parameters = find_parameters(article, lab, NAMES)
    by_modes = differentiate_frequencies(modes, parameters, 14)
    by_rest = differentiate_rest(modes.equilibrium, parameters)
    assert found["schema"] == "middeck.sensitivity/1"
    assert [p["name"] for p in found["parameters"]] == NAMES
    assert found["frequency_hz"] == modes.frequency_hz[:14].tolist()
    for i, p in enumerate(found["parameters"]):
        # Exact: the same computation in the same process rounds alike.
        assert p["d_lambda"] == by_modes.d_lambda[i].tolist()
        assert p["d_hz"] == by_modes.d_hz[i].tolist()
        assert list(p["d_reactions_n"].values()) == by_rest.reaction[:, i].tolist()
        assert list(p["d_holding_torque_nm"].values()) == by_rest.holding_torque[:, i].tolist()


def test_a_frequency_of_zero_has_no_slope(capfd: pytest.CaptureFixture[str]) -> None:
    ask = ("sensitivity", DM, "--environment", "orbit", "--parameter", "node.n3.mass", "--count", 10)
    found = json.loads(middeck(capfd, *ask, "--json").out)
    by_mass = found["parameters"][0]
    assert by_mass["d_hz"][:8] == [None] * 8
    assert np.all(np.isfinite(np.array(by_mass["d_hz"][8:], dtype=float)))
    assert found["groups"][0] == list(range(8))
    table = middeck(capfd, *ask)
    assert (table.code, table.err) == (0, "")
    # Two flexible modes; in orbit nothing pulls and nothing holds.
    assert table.out.count("node.n3.mass") == 2
    assert "rest state" not in table.out


def test_what_cannot_be_differentiated(capfd: pytest.CaptureFixture[str]) -> None:
    unknown = middeck(capfd, "sensitivity", DM, "--parameter", "node.n1.mas")
    assert unknown.code == 2
    assert "node.n1.mass" in unknown.err
    drives = middeck(
        capfd, "sensitivity", DM, "--environment", "orbit", "--parameter", "environment.gravity.y"
    )
    assert drives.code == 5
    assert "nothing holds" in drives.err


SLIDE = """
[[proof_mass]]
name = "pm"
node = "n3"
axis = [0.0, 1.0, 0.0]
mass_kg = 0.4
natural_hz = 10.0
"""


@pytest.fixture
def actuated(tmp_path: Path) -> Path:
    """The article with an upright proof mass."""
    file = tmp_path / "actuated.toml"
    file.write_text(DM.read_text(encoding="utf-8") + SLIDE, encoding="utf-8")
    return file


def test_a_parameter_of_zero_has_no_relative_derivative(capfd: pytest.CaptureFixture[str]) -> None:
    ask = ("sensitivity", DM, "--parameter", "node.n1.cg.x", "--count", 2)
    assert json.loads(middeck(capfd, *ask, "--json").out)["parameters"][0]["relative"] == [None, None]
    rows = [line for line in middeck(capfd, *ask).out.splitlines() if line.startswith("node.n1.cg.x  ")]
    assert [line.split()[-1] for line in rows[:2]] == ["-", "-"]


def test_slides_hold_forces_and_the_rest_state_is_printed(
    capfd: pytest.CaptureFixture[str], actuated: Path
) -> None:
    ask = ("sensitivity", actuated, "--environment", LAB, "--parameter", "joint.pm.mass", "--count", 1)
    found = json.loads(middeck(capfd, *ask, "--json").out)["parameters"][0]
    assert list(found["d_holding_torque_nm"]) == ["pri_x", "pri_z"]
    # Its spring carries its weight m g; the axis leans by half a degree, 1 - cos is 1e-4 at most.
    assert found["d_holding_force_n"] == {"pm": pytest.approx(9.80665, rel=1e-4)}
    lines = [" ".join(line.split()) for line in middeck(capfd, *ask).out.splitlines()]
    assert f"joint.pm.mass force at pm N {found['d_holding_force_n']['pm']:+.5e}" in lines
    assert f"joint.pm.mass tension of n3 N {found['d_tension_n']['n3']:+.5e}" in lines


def test_one_mode_with_its_largest_first(capfd: pytest.CaptureFixture[str]) -> None:
    names = "node.*.mass,node.n1.cg.*"
    ask = ("sensitivity", DM, "--parameter", names, "--count", 2)
    ended = middeck(capfd, *ask, "--mode", "first torsion", "--top", 4)
    assert (ended.code, ended.err) == (0, "")
    table = ended.out.split("derivatives of the frequency of mode ")[1].split("\n\n")[0].splitlines()
    assert table[0].endswith(", first torsion")
    rows = [line.split() for line in table[2:]]
    shares = [abs(float(row[-1])) for row in rows]
    assert len(rows) == 4
    assert shares == sorted(shares, reverse=True)
    assert {row[-4] for row in rows} == {table[0].split(",")[0]}
    every = middeck(capfd, *ask, "--mode", table[0].split(",")[0]).out
    last = every.split("\n\n")[1].splitlines()[-1].split()
    assert last[0].startswith("node.n1.cg.")  # of zero value, so last
    assert last[-1] == "-"
    found = json.loads(middeck(capfd, *ask, "--mode", "first torsion", "--json").out)
    assert found["name"][-1] == "first torsion"


@pytest.mark.parametrize(
    ("mode", "advice"), [("first torsoin", "did you mean 'first torsion'?"), ("999", "a number from 0 to ")]
)
def test_a_mode_that_is_not_there(capfd: pytest.CaptureFixture[str], mode: str, advice: str) -> None:
    ended = middeck(capfd, "sensitivity", DM, "--parameter", "node.n1.mass", "--mode", mode)
    assert ended.code == 2
    assert f"no mode {mode!r}" in ended.err
    assert advice in ended.err


def test_a_key_of_the_file_is_followed_to_what_it_became(
    capfd: pytest.CaptureFixture[str], actuated: Path
) -> None:
    ask = ("sensitivity", actuated, "--environment", LAB, "--parameter")
    for pattern, became in (
        ("proof_mass.pm.natural_hz", "natural_hz became joint.pm.stiffness (k = m"),
        ("material.lexan.E_pa", "E_pa became member.n1-n2.E, "),
    ):
        ended = middeck(capfd, *ask, pattern)
        assert ended.code == 2
        assert became in ended.err


def test_nothing_asked_and_nothing_to_say(capfd):
    """An empty name, a budget of nothing, and rigid modes alone are told, not shown as empty tables."""
    from middeck.cli.main import execute

    article = str(coarse("mace-simple"))
    for arguments, code, says in (
        (["sensitivity", article, "--parameter", ""], 2, "no parameter named"),
        (["budget", article, "--environment", "orbit"], 2, "nothing to budget"),
        (
            ["sensitivity", article, "--environment", "orbit", "--count", "8", "--parameter", "members.E"],
            0,
            "all modes shown are rigid",
        ),
    ):
        assert execute(arguments, lambda: False) == code
        out, err = capfd.readouterr()
        assert says in out + err


HINGED = """
schema = 1
name = "hinged"
[material.al]
E_pa = 7e10
nu = 0.33
rho_kg_m3 = 2700.0
[section.tube]
material = "al"
outer_diameter_m = 0.03
inner_diameter_m = 0.026
[mesh]
elements_per_strut = 3
[[node]]
name = "a"
x_m = 0.0
[[node]]
name = "m"
x_m = 1.0
[[node]]
name = "n"
x_m = 1.0
[[node]]
name = "z"
x_m = 2.0
mass_kg = 3.0
inertia_kg_m2 = [0.1, 0.2, 0.3]
[[strut]]
name = "one"
from = "a"
to = "m"
section = "tube"
[[strut]]
name = "two"
from = "n"
to = "z"
section = "tube"
[[attach]]
name = "pa"
frame = "a"
[[attach]]
name = "pm"
frame = "m"
[[attach]]
name = "pn"
frame = "n"
[[bushing]]
name = "hinge"
from = "pm"
to = "pn"
stiffness = [1e5, 2e5, 3e5, K4, 200.0, K6]
"""
FOOT = """
schema = 1
name = "foot"
[constants]
gravity_m_s2 = 9.81
[[bushing]]
name = "foot"
attach = "pa"
stiffness = [1e6, 1e6, 1e6, 1e3, 1e3, F6]
"""


@pytest.fixture
def hinged(tmp_path: Path):
    """Writes the article and what it stands on, with these stiffnesses, and gives both files."""

    def write(k4: float = 100.0, k6: float = 300.0, f6: float = 2000.0) -> tuple[Path, Path]:
        article, foot = tmp_path / "hinged.toml", tmp_path / "foot.toml"
        article.write_text(HINGED.replace("K4", repr(k4)).replace("K6", repr(k6)))
        foot.write_text(FOOT.replace("F6", repr(f6)))
        return article, foot

    return write


def test_a_pattern_gives_what_a_bushing_has(hinged, capfd: pytest.CaptureFixture[str]) -> None:
    """Its six stiffnesses, without the couplings that nobody gave; right by differences of the modes."""
    article, foot = hinged()
    ask = ("sensitivity", article, "--environment", foot, "--parameter", "*bushing.*", "--count", 4)
    found = {p["name"]: p for p in json.loads(middeck(capfd, *ask, "--json").out)["parameters"]}
    ends = [f"stiffness.{k}{k}" for k in range(1, 7)]
    assert list(found) == [
        f"{part}.{end}" for part in ("bushing.hinge", "environment.bushing.foot") for end in ends
    ]
    for key, value, name in (
        ("k4", 100.0, "bushing.hinge.stiffness.44"),
        ("k6", 300.0, "bushing.hinge.stiffness.66"),
        ("f6", 2000.0, "environment.bushing.foot.stiffness.66"),
    ):
        step = 1e-3 * value
        sides = []
        for changed in (value - step, value + step):
            setup = md.load_setup(*hinged(**{key: changed}))
            sides.append(md.solve_modes(md.solve_equilibrium(*setup)).frequency_hz[:4])
        slope = (sides[1] - sides[0]) / (2.0 * step)
        # The third derivative leaves 1e-6 of such a slope, rounding of a frequency 1e-9 Hz over the step.
        np.testing.assert_allclose(found[name]["d_hz"], slope, rtol=1e-5, atol=1e-9 / step)
    one = middeck(capfd, *ask[:4], "--parameter", "bushing.hinge.stiffness.12", "--json")
    assert json.loads(one.out)["parameters"][0]["name"] == "bushing.hinge.stiffness.12"


@pytest.mark.parametrize(
    ("pattern", "meant"),
    [
        ("bushing.foot.*", "environment.bushing.foot.stiffness.11"),
        ("foot.*", "environment.bushing.foot.stiffness.11"),
        ("bushing.hinge.stiffness", "bushing.hinge.stiffness.11"),
        ("bushing.hinge", "bushing.hinge.stiffness.11"),
    ],
)
def test_a_pattern_that_fits_nothing_names_what_was_meant(hinged, capfd, pattern, meant) -> None:
    article, foot = hinged()
    ended = middeck(capfd, "sensitivity", article, "--environment", foot, "--parameter", pattern)
    assert ended.code == 2
    assert f"did you mean {meant}" in ended.err


def test_what_changes_no_frequency_is_reported_and_small_shares_are_no_zeros(
    hinged, capfd: pytest.CaptureFixture[str]
) -> None:
    article, foot = hinged()
    ask = ("sensitivity", article, "--environment", foot, "--count", 2)
    shown = middeck(capfd, *ask, "--parameter", "bushing.hinge.*,damping.*").out
    assert "no frequency shown depends on 'damping.flexible', 'damping.suspension'" in shown
    assert "+0.0000" not in [
        line.split()[-1] for line in shown.splitlines() if line.startswith("bushing.hinge.stiffness.22")
    ]
