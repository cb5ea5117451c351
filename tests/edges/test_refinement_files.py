"""Documents of refinements, refined articles, and the verb."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import middeck, refine_once, share_results
from coarse_articles import coarse
from middeck.errors import ConfigError, DataError
from middeck.files.measured.modes import load_measured_modes, write_measured_modes
from middeck.files.promises.promise_file import read_promise
from middeck.files.refinements.documents import load_refinement, refined_text
from middeck.files.refinements.promised_loads import load_promised_loads
from middeck.files.setups import load_setup, load_structure
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.structure.model.article import LoadCase
from middeck.updating.orbit.deflections import predict_deflections
from middeck.updating.refinement.refine import Refined

ROOT = Path(__file__).parents[2]
ARTICLE = coarse("mace-simple")
SURVEY = ROOT / "data/virtual-survey"


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is refined alike is refined once."""
    share_results(monkeypatch)


def test_factors_multiply_what_the_article_says(tmp_path: Path):
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    first.write_text(refined_text(ARTICLE, {"members.E": 1.1, "node.n3.mass": 0.9}))
    second.write_text(refined_text(first, {"members.E": 1.1}))
    article, once, twice = (load_structure(f) for f in (ARTICLE, first, second))
    assert once.members[0].section.EI_y == pytest.approx(1.1 * article.members[0].section.EI_y)
    assert twice.members[0].section.EI_y == pytest.approx(1.21 * article.members[0].section.EI_y)
    assert twice.nodes[2].body.mass == pytest.approx(0.9 * article.nodes[2].body.mass)
    assert second.read_text().count("[factors]") == 1


@pytest.mark.parametrize(
    ("line", "what"),
    [('"members.F" = 1.1', "no parameter 'members.F'"), ('"members.E" = -1.0', "must be > 0")],
)
def test_factors_of_nothing_are_refused_in_their_line(tmp_path: Path, line: str, what: str):
    file = tmp_path / "a.toml"
    file.write_text(f"{ARTICLE.read_text()}\n[factors]\n{line}\n")
    with pytest.raises(ConfigError, match=what) as raised:
        load_structure(file)
    assert f"a.toml:{len(file.read_text().splitlines())}" in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("spread = 0.1", "spread = 0.0", "must be > 0"),
        ("spread = 0.1", "sprad = 0.1", "did you mean 'spread'"),
        ('schema = "middeck.refinement/1"', 'schema = "middeck.refinement/9"', "middeck.refinement/1"),
        ("members.E", "members.F", "no parameter 'members.F'"),
        ('environment = "lab"', 'environment = "cellar"', "no environment 'cellar'"),
        ("mace-simple-lab.json", "none.json", "none.json"),
        ("[[survey]]", "[[surveys]]", "did you mean 'survey'"),
    ],
)
def test_documents_that_cannot_be(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, what: str
):
    text = (SURVEY / "refine.toml").read_text()
    assert old in text
    (tmp_path / "refine.toml").write_text(text.replace(old, new, 1))
    (tmp_path / "mace-simple-lab.json").write_bytes((SURVEY / "mace-simple-lab.json").read_bytes())
    ended = middeck(capfd, "refine", ARTICLE, tmp_path / "refine.toml")
    assert ended.code in (ConfigError.exit_code, DataError.exit_code)
    assert what in ended.err


def test_the_verb_finds_what_was_changed_and_writes_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """The survey's article: modulus 2.44 instead of 2.35 GPa, centre node 9.2 instead of 9.0 kg."""
    written = tmp_path / "refined.toml"
    ended = middeck(capfd, "refine", ARTICLE, SURVEY / "refine.toml", "-o", written, "--json", "--count", 3)
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    truth = {"modulus": np.log(2.44 / 2.35), "centre node": np.log(9.2 / 9.0), "end nodes": 0.0}
    for unknown in found["unknowns"]:
        assert abs(unknown["x"] - truth[unknown["name"]]) < 2.5 * unknown["std"]
    assert len(found["predicted"]["frequency_hz"]) == 3
    factor = np.exp(found["unknowns"][0]["x"])
    refined = load_structure(written).members[0].section.GJ
    assert refined == pytest.approx(factor * load_structure(ARTICLE).members[0].section.GJ, rel=1e-9)


def test_the_table_shows_the_factors_that_are_written(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """Changes of the parameters in per cent, not their logarithms."""
    written = tmp_path / "refined.toml"
    ended = middeck(capfd, "refine", ARTICLE, SURVEY / "refine.toml", "-o", written, "--count", 3)
    assert ended.code == 0, ended.err
    factors = tomllib.loads(written.read_text())["factors"]
    (row,) = (line.split() for line in ended.out.splitlines() if line.startswith("modulus "))
    assert row[-4:-2] == [f"{100.0 * (factors['members.E'] - 1.0):+.2f}", "%"]


def test_a_mode_without_a_partner_before_has_no_error_before(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """As one whose frequency the prior misses by more than a factor of two; the document was refused."""

    def first_unpaired(*given: Any) -> Refined:
        refined = refine_once(*given)
        return dataclasses.replace(refined, before_hz=((np.nan, *refined.before_hz[0][1:]),))

    monkeypatch.setattr("middeck.refine", first_unpaired)
    asked = "refine", ARTICLE, SURVEY / "refine.toml", "--count", 3
    assert json.loads(middeck(capfd, *asked, "--json").out)["surveys"][0]["before_hz"][0] is None
    shown = middeck(capfd, *asked).out
    assert "nan" not in shown
    row = next(line.split() for line in shown.splitlines() if line.startswith("first bending x-y "))
    assert row[-2] == "-"


def test_a_survey_states_what_the_article_carried(tmp_path: Path):
    file, named = tmp_path / "refine.toml", "mace-simple-lab.json"
    text = (SURVEY / "refine.toml").read_text().replace(named, str(SURVEY / named))
    loaded = 'environment = "lab"\nmass = [{ frame = "n3", mass_kg = 0.5, cg_m = [0.0, 0.1, 0.0] }]\n'
    file.write_text(text.replace('environment = "lab"\n', loaded))
    (survey,) = load_refinement(file, ARTICLE).surveys
    assert isinstance(survey.load_case, LoadCase)
    (hung,) = survey.load_case.masses
    assert (hung.frame, hung.body.mass, hung.body.cg.tolist()) == ("n3", 0.5, [0.0, 0.1, 0.0])
    (tmp_path / "refine.toml").write_text(
        text.replace('environment = "lab"\n', loaded + 'load_case = "ball"\n')
    )
    with pytest.raises(ConfigError, match="beside mass of its own"):
        load_refinement(tmp_path / "refine.toml", ARTICLE)


def test_a_survey_is_sought_beside_its_document():
    asked = load_refinement(SURVEY / "refine.toml", ARTICLE)
    assert [s.name for s in asked.surveys] == ["virtual survey"]
    assert [u.name for u in asked.unknowns] == ["modulus", "centre node", "end nodes"]


STATIC = """
[[static]]
name = "ball on the middle"
environment = "stand"
series = "bench"
mass = [{ frame = "n3", mass_kg = 2.0 }]

[[static.reading]]
name = "middle"
at = "n3"
direction = [0.0, -1.0, 0.0]
value_m = 1.0e-3
std_m = 1.0e-5

[[static.reading]]
name = "end"
at = "n5"
kind = "tilt"
direction = [0.0, 1.0, 0.0]
line = [1.0, 0.0, 0.0]
value_deg = 0.1
std_deg = 0.01

[[static.reading]]
name = "stand"
at = "n1"
kind = "force"
direction = [0.0, 1.0, 0.0]
value_n = 19.0
std_n = 0.1
"""
STAND = """
schema = 1
name = "stand"

[constants]
gravity_m_s2 = 9.80665

[[clamp]]
node = "n1"
"""


def with_static(folder: Path, static: str = STATIC) -> Path:
    """The refinement of the virtual survey with a static test beside it."""
    (folder / "stand.toml").write_text(STAND)
    (folder / "mace-simple-lab.json").write_bytes((SURVEY / "mace-simple-lab.json").read_bytes())
    text = (SURVEY / "refine.toml").read_text()
    file = folder / "refine.toml"
    file.write_text(text.replace("[[survey]]", f"{static}\n[[survey]]", 1))
    return file


def test_static_tests_are_read_with_the_units_of_their_keys(tmp_path: Path):
    (test,) = load_refinement(with_static(tmp_path), ARTICLE).statics
    assert test.series == "bench"
    assert [g.unit for g in test.gauges] == ["m", "rad", "N"]
    np.testing.assert_allclose(test.value, [1e-3, np.radians(0.1), 19.0])
    np.testing.assert_allclose([g.std for g in test.gauges], [1e-5, np.radians(0.01), 0.1])
    assert test.load_case is not None
    assert not isinstance(test.load_case, str)
    assert test.load_case.masses[0].body.mass == 2.0


def test_the_verb_refines_on_modes_and_sag_together(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    ended = middeck(capfd, "refine", ARTICLE, with_static(tmp_path), "--json", "--count", 1)
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    (test,) = found["statics"]
    assert test["gauge"] == ["middle", "end", "stand"]
    assert set(found["model_error"]) == {"suspension", "flexible", "static", "reading"}
    shown = middeck(capfd, "refine", ARTICLE, tmp_path / "refine.toml", "--count", 1)
    assert "static tests" in shown.out
    assert middeck(capfd, "refine", ARTICLE, tmp_path / "refine.toml", "--choose").code == 0


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("value_m = 1.0e-3", "value_deg = 1.0e-3", "value_m"),
        ("std_m = 1.0e-5", "", "a shift without std_m"),
        ('kind = "tilt"', 'kind = "tild"', "tilt"),
        ('mass = [{ frame = "n3", mass_kg = 2.0 }]', "", "of no load"),
        ('series = "bench"', 'load_case = "ball"', "beside mass of its own"),
        ('at = "n3"', 'at = "n33"', "no node 'n33'"),
        ('at = "n1"', 'at = "n2"', "no clamp or bushing to the ground 'n2'"),
        ("line = [1.0, 0.0, 0.0]", "line = [0.0, 1.0, 0.0]", "a line along the direction"),
    ],
)
def test_static_tests_that_cannot_be(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, what: str
):
    assert old in STATIC
    ended = middeck(capfd, "refine", ARTICLE, with_static(tmp_path, STATIC.replace(old, new, 1)))
    assert ended.code == ConfigError.exit_code
    assert what in ended.err


def test_frequencies_without_shapes_are_written_and_read(tmp_path: Path):
    hz = np.array([4.2, 29.2])
    bare = MeasuredModes(
        frequency_hz=hz, damping=np.zeros(2), node=(), direction=(), shape=np.zeros((0, 2)),
        frequency_std_hz=0.01 * hz,
    )  # fmt: skip
    write_measured_modes(tmp_path / "bare.json", bare)
    read = load_measured_modes(tmp_path / "bare.json")
    np.testing.assert_array_equal(read.frequency_hz, hz)
    assert read.shape.shape == (0, 2)


LOADS = """
schema = "middeck.promised-loads/1"
refinement = "refine.toml"
environment = "stand"
series = "bench"
modes = 2

[[load_case]]
name = "two_balls"
mass = [{ frame = "n3", mass_kg = 4.0 }]

[[gauge]]
name = "middle"
at = "n3"
direction = [0.0, -1.0, 0.0]
std_m = 1.0e-5

[[gauge]]
name = "end"
at = "n5"
kind = "tilt"
direction = [0.0, 1.0, 0.0]
line = [1.0, 0.0, 0.0]
std_deg = 0.01
"""


def test_readings_under_other_loads_are_promised_and_compared(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    with_static(tmp_path)
    loads, sealed, outcome = (tmp_path / n for n in ("loads.toml", "promise.json", "outcome.toml"))
    loads.write_text(LOADS)
    ended = middeck(capfd, "promise", ARTICLE, "--load-cases", loads, "-o", sealed)
    assert ended.code == 0, ended.err
    assert "two_balls" in ended.out
    found = read_promise(sealed)
    (place,) = found["environments"]
    assert len(place["modes"]) == 2
    middle, end = place["load_cases"][0]["readings"]
    assert (middle["unit"], end["unit"]) == ("m", "deg")
    assert middle["interval_95"][0] < middle["value"] < middle["interval_95"][1]
    direct = predict_deflections(
        refine_once(load_structure(ARTICLE), *load_refinement(tmp_path / "refine.toml", ARTICLE).of_refine),
        load_setup(ARTICLE, tmp_path / "stand.toml")[1],
        load_promised_loads(loads, ARTICLE).load_cases,
        load_promised_loads(loads, ARTICLE).gauges,
        series="bench",
    )
    assert end["value"] == pytest.approx(np.degrees(direct[0].value[1]), rel=1e-5)
    outcome.write_text(
        'schema = "middeck.outcome/1"\n\n[[reading]]\nenvironment = "stand"\nload_case = "two_balls"\n'
        f'gauge = "end"\nvalue = {end["interval_95"][1] + 1.0}\n'
    )
    compared = json.loads(middeck(capfd, "outcome", sealed, outcome, "--json").out)
    assert [v["inside"] for v in compared["verdicts"]] == [False]


SECOND_GAUGE = LOADS[LOADS.index("[[gauge]]") : LOADS.index('[[gauge]]\nname = "end"')]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (LOADS[LOADS.index("modes = 2") :], "", "nothing is promised"),
        (LOADS[LOADS.index("[[gauge]]") :], "", "nothing is promised"),
        (
            '[[load_case]]\nname = "two_balls"\nmass = [{ frame = "n3", mass_kg = 4.0 }]\n',
            "",
            "nothing is promised",
        ),
        ('mass = [{ frame = "n3", mass_kg = 4.0 }]\n', "", "of no load"),
        (SECOND_GAUGE, SECOND_GAUGE + SECOND_GAUGE, "a second gauge of this name"),
        ("std_deg = 0.01", "std_m = 0.01", "gauge.1.std_m: of a tilt"),
        ('kind = "tilt"', 'kind = ["tilt"]', "gauge.1.kind"),
    ],
)
def test_promised_loads_that_say_nothing_or_two_things_are_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, what: str
):
    assert old in LOADS
    with_static(tmp_path)
    loads = tmp_path / "loads.toml"
    loads.write_text(LOADS.replace(old, new))
    ended = middeck(capfd, "promise", ARTICLE, "--load-cases", loads)
    assert ended.code == ConfigError.exit_code
    assert what in ended.err


def test_a_promise_is_of_loops_or_of_loads(capfd: pytest.CaptureFixture[str]):
    ended = middeck(capfd, "promise", ARTICLE)
    assert ended.code == 2
    assert "neither a plan nor load cases" in ended.err


DAMPED = """
damping_error = 0.1

[[survey]]
name = "stand"
modes = "mace-simple-lab.json"
damping_std = 0.05

[[unknown]]
name = "modulus"
parameters = ["members.E"]
spread = 0.1

[[unknown]]
name = "strain"
parameters = ["damping.flexible"]
spread = 0.5

[[unknown]]
name = "suspension"
parameters = ["damping.suspension"]
spread = 0.5
"""


def damped(folder: Path, **changed: str) -> Path:
    """A refinement of damping; the article's bending has 1 % and so has the survey's."""
    text = DAMPED
    for old, new in changed.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "refine.toml").write_text('schema = "middeck.refinement/1"\n' + text)
    (folder / "mace-simple-lab.json").write_bytes((SURVEY / "mace-simple-lab.json").read_bytes())
    return folder / "refine.toml"


def test_the_verb_refines_damping_and_says_how_well_it_knows_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """Eight ratios of 5 % each: a ratio known to 2 % or so, and to the model's error of each mode."""
    file = damped(tmp_path)
    document = json.loads(middeck(capfd, "refine", ARTICLE, file, "--json").out)
    strain, suspension = document["unknowns"][1:]
    assert abs(strain["x"]) < 3.0 * strain["std"] < 0.3
    assert suspension["std"] == pytest.approx(suspension["spread"], rel=1e-6)
    assert "the tests do not determine suspension" in document["warnings"]
    assert document["model_error"].keys() == {"suspension", "flexible", "damping"}
    (reported,) = document["damping"]
    np.testing.assert_allclose(reported["measured"], 0.01)
    np.testing.assert_allclose(reported["deviation"], 0.0005)
    assert 0.0 < max(document["predicted"]["damping_deviation"]) < 0.003
    shown = middeck(capfd, "refine", ARTICLE, file, "-o", tmp_path / "refined.toml").out
    assert "damping in survey stand" in shown
    assert "1.00 +- 0." in shown
    refined = load_structure(tmp_path / "refined.toml").damping
    assert refined.flexible == pytest.approx(0.01 * np.exp(strain["x"]))


def test_damping_that_cannot_be_is_reported_with_its_place(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    for changed, what in (
        ({"damping_error = 0.1": "damping_error = 0.0"}, "must be > 0"),
        ({"damping_std = 0.05": "damping_std = -0.05"}, "refine.toml:8"),
        ({"damping_std = 0.05": ""}, "no standard deviations of its damping"),
        ({"damping.flexible": "damping.flexibel"}, "damping.flexible"),
    ):
        ended = middeck(capfd, "refine", ARTICLE, damped(tmp_path, **changed))
        assert ended.code in (ConfigError.exit_code, DataError.exit_code)
        assert what in ended.err


TWICE = """[[friction]]
joint = "pri_z"
slip_torque_nm = 1e-6
slip_angle_deg = 1.0

"""
RUBBED = """
[[friction]]
joint = "pri_z"
slip_torque_nm = 1e-6
slip_angle_deg = 0.02

[[unknown]]
name = "slip"
parameters = ["friction.pri_z.*"]
spread = 0.3

[[survey.amplitude]]
joint = "pri_z"
angle_deg = [1.5]
"""


def test_friction_is_read_in_degrees_and_reported_in_newton_metres(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """So weak that eight modes do not tell it: it keeps what was stated, and stands in no factors."""
    file = damped(tmp_path, **{"damping_std = 0.05": "damping_std = 0.05\n" + RUBBED})
    (survey,) = load_refinement(file, ARTICLE).surveys
    (stated,) = survey.friction
    np.testing.assert_allclose(stated.amplitude, np.full(8, np.radians(1.5)))
    assert stated.slip_angle == pytest.approx(np.radians(0.02))
    assert not stated.random
    document = json.loads(middeck(capfd, "refine", ARTICLE, file, "--json").out)
    (reported,) = document["friction"]
    assert reported["slip_torque_nm"] == pytest.approx(1e-6, rel=0.05)
    assert reported["slip_torque_deviation_nm"] == pytest.approx(0.3e-6, rel=0.05)
    assert reported["slip_angle_deg"] == pytest.approx(0.02, rel=0.05)
    assert document["not_in_the_article"] == ["slip"]
    assert any("without the friction of joints: pri_z" in warning for warning in document["warnings"])
    assert "friction of joints" in middeck(capfd, "refine", ARTICLE, file).out


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('amplitude]]\njoint = "pri_z"', 'amplitude]]\njoint = "pri_y"', "did you mean 'pri_z'"),
        ("angle_deg = [1.5]", "angle_deg = [1.5, 1.0]", "one for each measured mode"),
        ("angle_deg = [1.5]", "angle_deg = [0.0]", "must be > 0"),
        ("[[unknown]]", TWICE + "[[unknown]]", "given twice"),
        ("slip_torque_nm = 1e-6", "slip_torque_nm = -1e-6", "must be > 0"),
    ],
)
def test_friction_that_cannot_be_is_reported_with_its_place(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, what: str
):
    assert old in RUBBED
    file = damped(tmp_path, **{"damping_std = 0.05": "damping_std = 0.05\n" + RUBBED.replace(old, new, 1)})
    ended = middeck(capfd, "refine", ARTICLE, file)
    assert ended.code == ConfigError.exit_code
    assert what in ended.err
