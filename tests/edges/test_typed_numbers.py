"""Numbers typed with a decimal comma or in quotes, and what is refused before anything slow."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from middeck.files.measured.modes import load_measured_modes

Capture = pytest.CaptureFixture[str]
ARTICLE = ROOT / "articles/mace-dm.toml"


def refusal(capfd: Capture, *arguments: object) -> str:
    ended = middeck(capfd, *arguments)
    assert ended.code == 2
    assert ended.out == ""
    return ended.err


@pytest.mark.parametrize(
    ("option", "typed", "said"),
    [
        ("--sample-hz", "100,5", "is not a number: a decimal point, as 100.5"),
        ("--sample-hz", "fast", "'fast' is not a number\n"),
        ("--states", "4,0", "'4,0' is not a whole number\n"),
    ],
)
def test_an_option_that_takes_a_number(capfd: Capture, option: str, typed: str, said: str) -> None:
    assert said in refusal(capfd, "identify", "a.npz", option, typed)


@pytest.mark.parametrize(("typed", "meant"), [("2,5", "2.5"), ("-,5e3", "-0.5e3"), ("0,020", "0.020")])
def test_an_override_with_a_decimal_comma(capfd: Capture, typed: str, meant: str) -> None:
    said = refusal(capfd, "modes", ARTICLE, "--set", f"node.0.mass_kg={typed}")
    assert f"a decimal point: node.0.mass_kg={meant}\n" in said


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("nu = ,33", "a decimal point: nu = 0.33"),
        ("nu = -,33 # negative", "a decimal point: nu = -0.33"),
        ("nu = {least = 0,1}", "a decimal comma in a table"),
        ('nu = "0,37"', "without quotes: 0.37"),
        ('nu = "0.37"', "without quotes: 0.37"),
    ],
)
def test_a_line_of_an_article(tmp_path: Path, capfd: Capture, line: str, said: str) -> None:
    text = ARTICLE.read_text(encoding="utf-8")
    (was,) = (part for part in text.splitlines() if part.startswith("nu = "))
    (tmp_path / "a.toml").write_text(text.replace(was, line), encoding="utf-8")
    assert said in refusal(capfd, "modes", tmp_path / "a.toml")


def test_a_text_for_a_number_gets_no_advice(tmp_path: Path, capfd: Capture) -> None:
    shutil.copy(ARTICLE, tmp_path / "a.toml")
    said = refusal(capfd, "modes", tmp_path / "a.toml", "--set", "node.0.mass_kg=heavy")
    assert "must be a number, in kg" in said
    assert "quotes" not in said


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ((), "--measure is missing"),
        (("--measure", "tilt"), "no output named 'tilt'"),
        (("--measure", "angle", "--control", "force"), "no input named 'force'"),
    ],
)
def test_ports_of_a_record_are_asked_for_before_it_is_fitted(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch, typed: tuple[str, ...], said: str
) -> None:
    record = md.Record(
        u=np.eye(1, 64).reshape(1, 1, 64, 1),
        y=np.ones((1, 1, 64, 2)),
        sample_hz=100.0,
        inputs=(md.Port("torque", "N m"),),
        outputs=(md.Port("angle", "rad"), md.Port("rate", "rad/s")),
        periodic=False,
    )
    md.write(tmp_path / "a.npz", record)
    monkeypatch.setattr("middeck.cli.work.fit_records.identify", lambda *_: pytest.fail("it was fitted"))
    assert said in refusal(capfd, "design", tmp_path / "a.npz", *typed)


def test_an_empty_universal_file_is_called_empty(tmp_path: Path) -> None:
    (tmp_path / "a.unv").touch()
    with pytest.raises(md.MiddeckError, match="the file is empty"):
        load_measured_modes(tmp_path / "a.unv")


@pytest.mark.parametrize("start", [md.fit_record, md.estimate_response, md.fit_response])
def test_a_path_in_place_of_what_is_in_it(start: object) -> None:
    with pytest.raises(md.MiddeckError, match=r"a str stands in .*\n.*(load_record|estimate_re)"):
        start("a.npz")  # ty: ignore[call-non-callable]
