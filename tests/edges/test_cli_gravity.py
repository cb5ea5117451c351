"""The verbs of gravity print what the rooms compute, draw on demand, and refuse what makes no sense."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from coarse_articles import coarse
from middeck.structure.gravity.budget import build_budget
from middeck.structure.gravity.gravity_levels import DeviceRule, find_place
from middeck.structure.gravity.path import follow_gravity

DM = coarse("mace-dm")
LAB = ROOT / "environments/lab.toml"
Capture = pytest.CaptureFixture[str]


def document(capfd: Capture, *arguments: object) -> dict[str, Any]:
    ended = middeck(capfd, *arguments, "--json")
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out, parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))


def test_budget(capfd: Capture, tmp_path: Path) -> None:
    drawing = tmp_path / "budget.svg"
    found = document(capfd, "budget", DM, "--count", 12, "--figure", drawing)
    structure, lab = md.load_setup(DM, LAB)
    modes = [md.solve_modes(md.solve_equilibrium(structure, e)) for e in (md.Environment.orbit(), lab)]
    expected = build_budget(modes[0], modes[1], 12)
    assert found["schema"] == "middeck.budget/1"
    assert found["share_hz"] == expected.share_hz.tolist()  # exact: JSON carries all digits
    assert found["omega2"] == expected.corner.tolist()
    assert np.sum(found["share_hz"], axis=1) == pytest.approx(found["shift_hz"], abs=1e-12)
    drawn = drawing.read_text(encoding="utf-8")
    assert drawn.startswith("<svg")
    assert "Development Model" in drawn
    assert "from orbit to lab" in drawn
    assert "in the colour of each effect" in drawn
    assert "corner" not in drawn
    text = middeck(capfd, "budget", DM, "--count", 12)
    assert text.code == 0
    assert "payload pendulum" in text.out


def test_path(capfd: Capture, tmp_path: Path) -> None:
    drawing = tmp_path / "path.svg"
    coarse = "mesh.elements_per_strut=1"
    ask = ("path", DM, "--through", "moon,1.5", "--devices", "retuned", "--count", 12, "--set", coarse)
    found = document(capfd, *ask, "--figure", drawing)
    structure, lab = md.load_setup(DM, LAB, [coarse])
    places = [find_place(n, lab.gravity) for n in ("moon", "1.5")]
    expected = follow_gravity(structure, lab, places, devices=DeviceRule.RETUNED, count=12)
    assert found["schema"] == "middeck.path/1"
    assert found["complete"]
    assert found["frequency_hz"] == expected.frequency_hz.tolist()
    assert [p["name"] for p in found["places"]] == ["moon", "1.5 m/s^2"]
    drawn = drawing.read_text(encoding="utf-8")
    assert "payload pendulum" in drawn
    assert "Development Model" in drawn
    assert "lab, devices retuned" in drawn


def upside_down(folder: Path) -> Path:
    """The payload's centre of mass above its axes."""
    file = folder / "article.toml"
    text = DM.read_text(encoding="utf-8")
    assert "payload_cg_m = [0.0, -0.08, 0.0]" in text
    file.write_text(text.replace("payload_cg_m = [0.0, -0.08, 0.0]", "payload_cg_m = [0.0, 0.08, 0.0]"))
    return file


def test_unstable_path_is_an_answer(capfd: Capture, tmp_path: Path) -> None:
    ask = ("path", upside_down(tmp_path), "--environment", LAB, "--count", 12)
    found = document(capfd, *ask, "--figure", tmp_path / "path.svg")
    assert (found["complete"], found["s"]) == (False, [])
    assert found["events"][-1]["what"] == "unstable start"
    ended = middeck(capfd, *ask, "--require")
    assert ended.code == 1
    assert "payload pendulum" in ended.out
    assert "unstable where the path begins" in ended.out


def test_branches_past_a_veering_are_marked_and_the_release_is_reported(
    capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    known: dict[str, Any] = {}  # the path is followed once, and told twice

    def once(structure: Any, lab: Any, places: Any, **more: Any) -> Any:
        ways = str([p.name for p in places])
        return known.get(ways) or known.setdefault(ways, follow_gravity(structure, lab, places, **more))

    monkeypatch.setattr("middeck.structure.gravity.path.follow_gravity", once)
    coarse = ("--count", 12, "--set", "mesh.elements_per_strut=1")
    found = document(capfd, "path", DM, "--through", "1,orbit", *coarse)
    veered = {name for e in found["events"] if e["what"] == "veering" for name in e["modes"]}
    last = {n for n, past in zip(found["name"], found["exchanged"][-1], strict=True) if past}
    assert veered == last != set()
    assert not np.any(found["exchanged"][0])
    text = middeck(capfd, "path", DM, "--through", "1,orbit", *coarse).out
    table = text[text.index("branch") : text.index("on the way")]
    for name in found["name"]:
        assert (f"{name} ~" in table) == (name in last)
    assert "~ past a veering" in table
    assert "in orbit all supports but clamps are released" in table
    grounded = middeck(capfd, "path", DM, "--through", "earth,8", *coarse).out
    assert "are released" not in grounded
    assert "~" not in grounded


def test_tilt_or_places_and_both_make_sense(capfd: Capture) -> None:
    for wrong, says in (
        (("--through", "earth,pluto"), "no place 'pluto'"),
        (("--through", "earth"), "unlike the one before"),
        (("--through", "earth,moon", "--tilt", "5,0,0,1"), "one of them"),
        (("--tilt", "5,0,0,0"), "zero vector"),
        (("--environment", "orbit"), "needs an environment with gravity"),
    ):
        ended = middeck(capfd, "path", DM, *wrong)
        assert ended.code == 2
        assert says in ended.err


def test_compare_says_what_holds_and_which_modes_have_no_partner(capfd: Capture, tmp_path: Path) -> None:
    """A cantilever beside itself in orbit: its first bending is none of the free article."""
    held = tmp_path / "held.toml"
    held.write_text('schema = 1\nname = "held"\n[[clamp]]\nnode = "n1"\n')
    call = ("compare", coarse("mace-simple"), "--environment", held, "--count", 12)
    shown = middeck(capfd, *call).out
    reported = "orbit: free, no gravity; held: clamped at 'n1', no gravity"
    reported += " (`middeck budget` keeps the clamps in 0-g)"
    assert reported in shown
    assert "without a partner" in shown
    found = json.loads(middeck(capfd, *call, "--json").out)
    for side, column in (("orbit", 0), ("lab", 1)):
        flexible = {i for i, kind in enumerate(found[side]["kind"]) if kind == "flexible" and i < 12}
        assert set(found["unpaired"][side]) == flexible - {pair[column] for pair in found["pairs"]}
    assert found["unpaired"]["lab"]
    assert not [w for w in found["warnings"] if "is flexible" in w]
    few = json.loads(middeck(capfd, *call[:-1], 3, "--json").out)["warnings"]
    reported = "none of the 3 lowest modes in orbit is flexible: increase --count; `middeck budget` keeps"
    assert [w for w in few if "is flexible" in w and w.startswith(reported)]


def test_a_decimal_comma_in_a_gravity_is_doubted(capfd: Capture) -> None:
    few = ("--count", 3, "--set", "mesh.elements_per_strut=1")
    found = document(capfd, "path", DM, "--through", "9,81", *few)  # two places: 9 and 81 m/s^2
    assert sum("gravity is 81 m/s^2" in text for text in found["warnings"]) == 1
    assert not any(
        "Jupiter" in text for text in document(capfd, "path", DM, "--through", "9,8", *few)["warnings"]
    )
