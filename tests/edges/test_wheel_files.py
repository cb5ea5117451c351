"""Wheels in files and on the command line: what is read, shown and refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck
from middeck.errors import ConfigError
from middeck.files.setups import load_setup

SPINNER = """\
schema = 1
name = "spinner"
node = [
  {name = "bus", x_m = 0.0, mass_kg = 20.0, inertia_kg_m2 = [1.2, 0.9, 0.8]},
  {name = "disc", x_m = 0.6, mass_kg = 4.0, inertia_kg_m2 = [0.05, 0.03, 0.03]},
]
strut = [{section = "shaft", from = "bus", to = "disc", elements = 1}]
wheel = [{name = "rotor", frame = "disc", axis = [2.0, 0.0, 0.0], rotor_inertia_kg_m2 = 0.05}]
[section.shaft]
EA_n = 1.0e7
GJ_nm2 = 500.0
EI_y_nm2 = 800.0
EI_z_nm2 = 800.0
rho_A_kg_per_m = 0.0
"""
BENCH = """\
schema = 1
name = "bench"
clamp = [{node = "bus"}]
[wheel_speed_rpm]
rotor = 3000
"""


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    article, bench = tmp_path / "spinner.toml", tmp_path / "bench.toml"
    article.write_text(SPINNER)
    bench.write_text(BENCH)
    return article, bench


def test_wheels_and_speeds_are_read(files: tuple[Path, Path]):
    parts, bench = load_setup(*files)
    (rotor,) = parts.wheels
    assert (rotor.name, rotor.frame, rotor.axis.tolist(), rotor.inertia) == ("rotor", "disc", [1, 0, 0], 0.05)
    assert bench.wheel_speeds == (("rotor", pytest.approx(3000.0 * 2.0 * np.pi / 60.0)),)
    assert [port.name for port in parts.actuators] == [port.name for port in parts.sensors] == ["rotor"]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('frame = "disc"', 'frame = "disk"', r"wheel.0.frame.*no frame of this name.*'disc'"),
        ("axis = [2.0, 0.0, 0.0]", "axis = [0.0, 0.0, 0.0]", r"wheel.0.axis.*zero vector"),
        ("rotor_inertia_kg_m2 = 0.05", "rotor_inertia_kg_m2 = 0.07", r"has 0.03 kg m\^2"),
        ("rotor_inertia_kg_m2 = 0.05", "rotor_inertia_kg_m2 = 0.0", r"must be > 0"),
        ('name = "rotor", frame = "disc"', 'name = "rotor", frame = "bus"', None),
    ],
)
def test_mistakes_in_a_wheel(files: tuple[Path, Path], old: str, new: str, text: str | None):
    files[0].write_text(SPINNER.replace(old, new))
    if text is None:
        assert load_setup(*files)[0].wheels[0].frame == "bus"
        return
    with pytest.raises(ConfigError, match=rf"(?s){text}"):
        load_setup(*files)


def test_a_speed_needs_its_wheel(files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]):
    files[1].write_text(BENCH.replace("rotor =", "roter ="))
    ended = middeck(capfd, "modes", files[0], "--environment", files[1])
    assert ended.code == 2
    assert "bench.toml:5: wheel_speed_rpm.roter: article 'spinner' has no wheel 'roter'" in ended.err
    assert "did you mean 'rotor'?" in ended.err


def test_modes_at_speed(files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]):
    run = ("modes", files[0], "--environment", files[1])
    shown = middeck(capfd, *run).out
    assert "modes with the wheels at their speeds, in rpm: rotor 3000" in shown
    found, still = (
        json.loads(middeck(capfd, *run, "--json", *more).out)
        for more in ((), ("--set", "wheel_speed_rpm.rotor=0"))
    )
    assert found["sense"][:2] == ["backward", "forward"]
    assert found["wheel_speed_rpm"] == {"rotor": pytest.approx(3000.0)}
    assert "standstill" not in still
    assert "sense" not in still
    for key, value in found["standstill"].items():
        assert value == still[key]
    assert found["frequency_hz"][0] < still["frequency_hz"][0] < found["frequency_hz"][1]
    assert found["warnings"] == still["warnings"]


def test_a_speed_is_set_where_no_file_has_one(files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]):
    run = ("modes", files[0], "--environment", "orbit", "--json", "--set", "wheel_speed_rpm.rotor=600")
    found = json.loads(middeck(capfd, *run).out)
    assert found["kind"][:6] == ["rigid"] * 5 + ["gyroscopic"]
    assert found["name"][4].startswith("attitude: ")


def test_modes_at_speed_without_ratios(files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]):
    files[0].write_text(SPINNER + "[damping.table]\nfrequency_hz = [1.0, 2.0]\nratio = [0.01, 0.02]\n")
    ended = middeck(capfd, "modes", files[0], "--environment", files[1], "--json")
    found = json.loads(ended.out)
    assert found["damping"] == [None] * len(found["frequency_hz"])
    assert any("no damping ratios" in text for text in found["warnings"])


@pytest.mark.parametrize(
    "arguments",
    [
        ("compare",),
        ("sensitivity", "--parameter", "node.*"),
        ("path", "--through", "earth,orbit", "--set", "constants.gravity_m_s2=9.8"),
        ("budget", "--set", "constants.gravity_m_s2=9.8"),
    ],
)
def test_verbs_for_real_modes_refuse(
    files: tuple[Path, Path], capfd: pytest.CaptureFixture[str], arguments: tuple[str, ...]
):
    files[1].write_text(BENCH + "[constants]\ngravity_m_s2 = 1.0\n")
    ended = middeck(capfd, arguments[0], files[0], "--environment", files[1], *arguments[1:])
    assert ended.code == 2
    assert "wheels spin (rotor)" in ended.err
    assert f"{arguments[0]}, " in ended.err  # by name


def test_response_and_check_take_the_momentum(files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]):
    article, bench = files
    run = (
        "response",
        article,
        "--environment",
        bench,
        "--input",
        "rotor",
        "--output",
        "rotor_rate",
        "--at",
        "5",
    )
    assert middeck(capfd, *run).code == 0
    refused = middeck(capfd, *run, "--static")
    assert refused.code == 2
    assert "momentum the comparison of static gains leaves out" in refused.err
    assert "nothing found" in middeck(capfd, "check", article, bench).out


def test_pictures_show_both_parts(files: tuple[Path, Path], capfd: pytest.CaptureFixture[str]):
    """The disc circles: real and imaginary part are equally long, one a quarter of a turn from the other."""
    article, bench = files
    page, grid = article.with_suffix(".html"), article.with_suffix(".vtu")
    for file in (page, grid):
        assert middeck(capfd, "modes", article, "--environment", bench, "--figure", file).code == 0
    data = json.loads(page.read_text().split('id="data">')[1].split("</script>")[0])
    first = data["rows"][0][0]
    assert first["text"].endswith("backward")
    motion, quarter = (np.reshape(first[key], (-1, 3)) for key in ("motion", "quarter"))
    shaft = next(line for line in data["sides"][0]["lines"] if line[0] == "member")
    tip = shaft[2] - 1
    assert np.linalg.norm(quarter[tip]) == pytest.approx(np.linalg.norm(motion[tip]), rel=1e-2)
    assert abs(motion[tip] @ quarter[tip]) < 1e-2 * motion[tip] @ motion[tip]
    assert "a quarter of a period before" in grid.read_text()
