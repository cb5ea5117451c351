"""``middeck check`` says how an article hangs; ``middeck level`` levels it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck

SIMPLE = ROOT / "articles/mace-simple.toml"
LAB = ROOT / "environments/lab.toml"
UNLEVELLED = "suspension.offsets.0.2=0"  # the offset that the sheet gives against a roll of 6.8 degrees
Capture = pytest.CaptureFixture[str]


def checked(capfd: Capture, *arguments: object) -> dict[str, Any]:
    ended = middeck(capfd, "check", *arguments, "--json")
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


def test_a_level_article_is_sound(capfd: Capture) -> None:
    found = checked(capfd, SIMPLE, LAB)
    hangs = md.estimate_attitude(md.solve_equilibrium(*md.load_case(SIMPLE, LAB)))
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
        ('n3 = "xyz"\n', "", "attach point 'n3'", "nothing in 'lab' hangs or ties it"),
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
