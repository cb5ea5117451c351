"""Candidates that cannot be, in files and in Python, and the verb."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import middeck, refine_once, share_results
from coarse_articles import coarse
from middeck.errors import ConfigError, DataError, NumericalError
from middeck.files.refinements.candidate_documents import RankedTests, load_candidates
from middeck.structure.model.environment import Environment
from middeck.updating.candidates.candidate_survey import CandidateSurvey
from middeck.updating.candidates.rank_tests import rank_tests
from middeck.updating.refinement.refine import Refined

ROOT = Path(__file__).parents[2]
ARTICLE = coarse("mace-simple")
SURVEY = ROOT / "data/virtual-survey"


ORBIT = {"orbit": Environment.orbit()}


@functools.cache
def asked() -> RankedTests:
    return load_candidates(SURVEY / "candidates.toml", ARTICLE)


@functools.cache
def before() -> Refined:
    return refine_once(asked().structure, *asked().refinement.of_refine)


def candidate(name: str = "new", **given: Any) -> CandidateSurvey:
    (lab,) = {id(s.environment): s.environment for s in asked().refinement.surveys}.values()
    usual: dict[str, Any] = {"name": name, "environment": lab, "frequency_std": 1e-3}
    return CandidateSurvey(**usual | given)


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The documents stand on one refinement."""
    share_results(monkeypatch)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("refine.toml", "mace-simple-lab.json", "candidates.toml"):
        (tmp_path / name).write_bytes((SURVEY / name).read_bytes())
    return tmp_path


def test_the_verb_ranks_and_names_the_widest(capfd: pytest.CaptureFixture[str]):
    ended = middeck(capfd, "candidates", ARTICLE, SURVEY / "candidates.toml", "--json")
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    ratios = {c["name"]: c["ratio_of_the_widest"] for c in found["candidates"]}
    assert list(ratios.values()) == sorted(ratios.values())
    assert ratios["longer records"] < ratios["again"] < ratios["two kilograms"] <= 1.0
    # All that is noise halves its square at most.
    assert ratios["again"] > 0.999 * 0.5**0.5
    widest = found["promised"][found["widest"]]
    assert widest["std"] == max(p["std"] for p in found["promised"])
    shown = middeck(capfd, "candidates", ARTICLE, SURVEY / "candidates.toml")
    assert shown.code == 0
    assert shown.out.startswith(f"widest: {widest['name']} in orbit")
    assert shown.out.index("longer records") < shown.out.index("two kilograms")


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("frequency_std = 0.001\n", "", "frequency_std"),
        ("frequency_std = 0.001\n", "frequency_std = 0.0\n", "must be > 0"),
        ("frequency_std = 0.001\n", "frequency_std = 2.0\n", "above 0 and below 1"),
        ('"n1 x"', '"n1"', 'channels.0 = "n1": is no channel'),
        ('"n1 x"', '"n9 x"', "candidate 'one end, to 40 Hz', measured channels: the model has no node 'n9'"),
        ('"n1 x"', '"n1 z"', "two channels are 'n1 z'"),
        ('"n1 x"', '"nobody sensor"', "nobody"),
        ("[1.6, 40.0]", "[40.0, 1.6]", "a band that rises"),
        ("[1.6, 40.0]", "[4.0e4, 5.0e4]", "no mode from 40000 to 50000 Hz"),
        ("node.n3.mass", "node.n9.mass", "no parameter 'node.n9.mass'"),
        ('name = "again"', 'name = "longer records"', "the name 'longer records' is given twice"),
        ('name = "again"', 'name = "virtual survey"', "a test of this name has been made"),
        ('name = "again"', 'name = "again"\nenvironment = "cellar"', "no environment 'cellar'"),
        ('environments = ["orbit"]', 'environments = ["orbit", "orbit"]', "the name 'orbit' is given twice"),
        ('at = "n5"', 'at = "n9"', "candidate 'two kilograms', gauge 'slope': no node 'n9'"),
        ("std_deg = 0.001", "std_m = 0.001", "of a tilt"),
        ("std_deg = 0.001", "std_deg = 0.001\nvalue_deg = 1.0", "value_deg"),
        ('mass = [{ frame = "n4", mass_kg = 2.0 }]', "", "of no load"),
        ('refinement = "refine.toml"', 'refinement = "none.toml"', "none.toml"),
        ("[[survey]]", "[[surveys]]", "did you mean 'survey'"),
    ],
)
def test_documents_that_cannot_be(
    folder: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, what: str
):
    file = folder / "candidates.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    ended = middeck(capfd, "candidates", ARTICLE, file)
    assert ended.code in (ConfigError.exit_code, DataError.exit_code)
    assert what in ended.err


def test_a_document_without_candidates(folder: Path, capfd: pytest.CaptureFixture[str]):
    file = folder / "candidates.toml"
    file.write_text(file.read_text().partition("[[")[0])
    ended = middeck(capfd, "candidates", ARTICLE, file)
    assert ended.code == ConfigError.exit_code
    assert "no candidate" in ended.err


def test_candidates_that_cannot_be():
    static = asked().tests[-1]
    for tests, environments, what in (
        ([], ORBIT, "no candidate"),
        ([candidate()], {}, "nothing is promised"),
        ([candidate(), dataclasses.replace(static, name="new")], ORBIT, "the name 'new' is given twice"),
        ([candidate(channels=(("n9", "x"),))], ORBIT, "no node 'n9'"),
        ([candidate(channels=(("pri_x", "travel"),))], ORBIT, "no joint with a travel"),
    ):
        with pytest.raises(ConfigError, match=what):
            rank_tests(before(), tests, environments)
    with pytest.raises(ConfigError, match="0 modes"):
        candidate(count=0)
    with pytest.raises(ConfigError, match="in frequency and 1"):
        candidate(shape_std=1.0)


def test_channels_that_see_nothing():
    """The first torsion turns the centre node about its strut and shifts it nowhere."""
    seen = candidate(channels=(("n3", "x"), ("n3", "y"), ("n3", "z")), band_hz=(4.0, 6.0))
    with pytest.raises(ConfigError, match="its channels see none of 1 modes"):
        rank_tests(before(), [seen], ORBIT)


def test_a_candidate_that_has_no_rest_state_is_named():
    """A suspension needs weight to carry."""
    nowhere = dataclasses.replace(candidate().environment, gravity=np.zeros(3))
    with pytest.raises(NumericalError, match=r"candidate 'afloat'.*needs gravity"):
        rank_tests(before(), [candidate(), candidate("afloat", environment=nowhere)], ORBIT)


def test_what_is_not_seen_is_reported(folder: Path, capfd: pytest.CaptureFixture[str]):
    file = folder / "candidates.toml"
    file.write_text(file.read_text().replace('["n1 x", "n1 y", "n1 z"]', '["n3 rx"]'))
    ended = middeck(capfd, "candidates", ARTICLE, file)
    assert ended.code == 0, ended.err
    assert "one end, to 40 Hz: its channels do not see" in ended.err


def test_frequencies_alone_need_no_channels():
    found = rank_tests(before(), [candidate("alone", channels=()), candidate("with shapes")], ORBIT)
    for test in found.tests:
        assert test.widest < 0.9
        assert test.foreseen.unseen == ()


LOADS = """
schema = "middeck.promised-loads/1"
refinement = "refine.toml"

[[load_case]]
name = "three_kilograms"
mass = [{ frame = "n4", mass_kg = 3.0 }]

[[gauge]]
name = "slope"
at = "n5"
kind = "tilt"
direction = [0.0, 1.0, 0.0]
line = [1.0, 0.0, 0.0]
std_deg = 0.001
"""


def test_readings_are_promised_beside_frequencies_or_alone(folder: Path, capfd: pytest.CaptureFixture[str]):
    file, loads = folder / "candidates.toml", folder / "loads.toml"
    loads.write_text(LOADS)
    text = file.read_text()
    file.write_text(text.replace("modes = 8", 'modes = 8\npromised_loads = "loads.toml"'))
    both = json.loads(middeck(capfd, "candidates", ARTICLE, file, "--json").out)
    assert [p["unit"] for p in both["promised"]] == 8 * ["Hz"] + ["rad"]
    assert both["promised"][8]["where"] == "three_kilograms"
    file.write_text(file.read_text().replace('environments = ["orbit"]', "environments = []"))
    alone = json.loads(middeck(capfd, "candidates", ARTICLE, file, "--json").out)
    assert alone["candidates"][0]["name"] == "two kilograms"
    assert alone["candidates"][0]["ratio_of_the_widest"] < 0.6


def test_readings_that_cannot_be_promised(folder: Path, capfd: pytest.CaptureFixture[str]):
    """On another refinement; by a gauge that no load moves."""
    file, loads = folder / "candidates.toml", folder / "loads.toml"
    file.write_text(file.read_text().replace("modes = 8", 'modes = 8\npromised_loads = "loads.toml"'))
    (folder / "other.toml").write_bytes((folder / "refine.toml").read_bytes())
    loads.write_text(LOADS.replace("refine.toml", "other.toml"))
    ended = middeck(capfd, "candidates", ARTICLE, file)
    assert ended.code == ConfigError.exit_code
    assert "one refinement" in ended.err
    loads.write_text(LOADS.replace("refine.toml", "./refine.toml").replace('"n4"', '"n3"'))
    ended = middeck(capfd, "candidates", ARTICLE, file)
    assert ended.code == ConfigError.exit_code
    assert "promised gauge 'slope': it reads" in ended.err
    loads.write_text(LOADS.partition("[[load_case]]")[0])
    found = json.loads(middeck(capfd, "candidates", ARTICLE, file, "--json").out)
    assert len(found["promised"]) == 8
