"""``middeck check`` says how an article hangs; ``middeck level`` levels it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from coarse_articles import coarse

SIMPLE = coarse("mace-simple")
LAB = ROOT / "environments/lab.toml"
UNLEVELLED = "suspension.offsets.0.2=0"  # the offset that the sheet gives against a roll of 6.8 degrees
Capture = pytest.CaptureFixture[str]


def checked(capfd: Capture, *arguments: object) -> dict[str, Any]:
    ended = middeck(capfd, "check", *arguments, "--json")
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


def test_a_level_article_is_sound(capfd: Capture) -> None:
    found = checked(capfd, SIMPLE, LAB)
    hangs = md.structure.estimate_attitude(md.solve_equilibrium(*md.load_setup(SIMPLE, LAB)))
    assert (found["sound"], found["findings"]) == (True, [])
    assert found["attitude"]["tilt_deg"] == np.degrees(hangs.tilt).tolist()
    assert found["attitude"]["hangs_from"] == "plane"  # the offset takes n1 out of the line
    assert checked(capfd, SIMPLE, "orbit")["attitude"] is None


def test_a_tilted_article_is_doubted_and_the_hint_levels_it(capfd: Capture) -> None:
    (found,) = checked(capfd, SIMPLE, LAB, "--set", UNLEVELLED)["findings"]
    assert found["what"] == "the article hangs tilted by 6.8 deg; it was drawn level"
    assert found["hint"].startswith("middeck level with --free n1.z --about x; ")
    ended = middeck(capfd, "check", SIMPLE, LAB, "--set", UNLEVELLED, "--require")
    assert ended.code == 1
    assert "hangs        tilted 6.8" in ended.out


@pytest.mark.parametrize(
    ("was", "now", "where", "what"),
    [
        ('n3 = "xyz"\n', "", "attach point 'n3'", "no device or spring of 'lab' holds it"),
        ('n3 = "xyz"\n', 'n3 = "yz"\n', "suspension", "no attach point is held along x"),
    ],
)
def test_what_nothing_holds(
    capfd: Capture, tmp_path: Path, was: str, now: str, where: str, what: str
) -> None:
    file = tmp_path / "lab.toml"
    text = LAB.read_text(encoding="utf-8")
    assert was in text
    file.write_text(text.replace(was, now), encoding="utf-8")
    findings = checked(capfd, SIMPLE, file)["findings"]
    assert any(f["where"] == where and f["what"].startswith(what) and f["hint"] for f in findings)


def levelled(capfd: Capture, *arguments: object) -> dict[str, Any]:
    ended = middeck(capfd, "level", *arguments, "--json")
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


def test_level_prints_what_the_room_finds_by_the_keys_of_the_file(capfd: Capture) -> None:
    ask = (SIMPLE, "--set", UNLEVELLED, "--free", "n1.z", "--about", "x")
    found = levelled(capfd, *ask)
    article, lab = md.load_setup(SIMPLE, LAB, [UNLEVELLED])
    expected = md.level(article, lab, free=[("n1", "z")], about="x")
    assert found["schema"] == "middeck.level/1"
    assert found["change_m"] == {"n1.z": expected.change[0]}
    assert found["before"]["tilt_deg"] == np.degrees(expected.before.tilt).tolist()
    assert found["after"]["tilt_deg"] == np.degrees(expected.after.tilt).tolist()
    offset = expected.structure.attach_points[0].offset.tolist()
    assert found["offsets"] == {"suspension.offsets_m.0": offset}


def test_the_line_that_level_prints_levels_the_article(capfd: Capture) -> None:
    ended = middeck(capfd, "level", SIMPLE, "--set", UNLEVELLED, "--free", "n1.z,n3.z", "--about", "x")
    assert (ended.code, ended.err) == (0, "")
    lines = ended.out.splitlines()
    keys = lines[lines.index("new offsets, for the article's file or for --set") + 1 :]
    assert [key.partition("=")[0] for key in keys] == ["suspension.offsets_m.0", "suspension.offsets_m.1"]
    sets = [part for key in keys for part in ("--set", key)]
    tilt = checked(capfd, SIMPLE, LAB, *sets)["attitude"]["tilt_deg"]
    # Printed to 1e-7 m, of 0.08 m to the centre of mass: 1e-6 rad, 1e-4 degrees.
    assert abs(tilt[0]) < 1e-4


def test_an_attach_point_of_its_own_has_its_own_key(capfd: Capture, tmp_path: Path) -> None:
    file, around = tmp_path / "article.toml", tmp_path / "lab.toml"
    text = SIMPLE.read_text(encoding="utf-8")
    file.write_text(text + '\n[[attach]]\nname = "hook"\nframe = "n1"\n', encoding="utf-8")
    around.write_text(LAB.read_text(encoding="utf-8").replace("n1 =", "hook ="), encoding="utf-8")
    found = levelled(capfd, file, "--environment", around, "--free", "hook.z", "--about", "x")
    assert list(found["offsets"]) == ["attach.hook.offset_m"]


def test_what_level_refuses(capfd: Capture) -> None:
    ask = ("level", SIMPLE, "--set", UNLEVELLED, "--about", "x", "--free")
    ended = middeck(capfd, *ask, "n1.z", "--limit", 0.01)
    assert ended.code == 5
    assert "would need more than the limit of 0.01 m, about 0.029" in ended.err
    for wrong, says in (("n1", "no offset 'n1'"), ("n9.z", "no offset 'z' of an attach point 'n9'")):
        ended = middeck(capfd, *ask, wrong)
        assert ended.code == 2
        assert says in ended.err
