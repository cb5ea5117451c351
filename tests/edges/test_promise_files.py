"""Documents of promises: plans with faults, seals, outcomes, and what the verbs say."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck, share_results
from coarse_articles import coarse
from middeck.cli.main import execute
from middeck.errors import ConfigError, DataError
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.promises.outcomes import load_outcomes, statements_of
from middeck.files.promises.plans import load_plan
from middeck.files.promises.promise_file import read_promise
from middeck.updating.promise.score import Scored, Statement, judge, score

ROOT = Path(__file__).parents[2]
ARTICLE = coarse("mace-simple")
FOLDER = ROOT / "data/virtual-survey"


@pytest.fixture(scope="module")
def promised(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample with two of its compensators and few draws."""
    folder = tmp_path_factory.mktemp("promise")
    files = ("refine.toml", "mace-simple-lab.json", "mace-simple-orbit.json", "outcome.toml", "promise.toml")
    for name in files:
        text = (FOLDER / name).read_text(encoding="utf-8")
        text = re.sub(r"draws = \d+ .*\nbounded = 1", "draws = 8\nbounded = 0", text)
        text = text.replace("log10_authority = [0.0, 3.0, 6.0]", "log10_authority = [0.0, 3.0]")
        (folder / name).write_text(text, encoding="utf-8")
    promise(folder, "promise.json")
    return folder


def promise(folder: Path, name: str, *more: str, fresh: bool = False) -> None:
    """``middeck promise``, on what was refined already unless ``fresh``."""
    asked = ["promise", str(ARTICLE), str(folder / "promise.toml"), "--date", "2026-11-23", *more]
    with pytest.MonkeyPatch.context() as patch:
        if not fresh:
            share_results(patch)
        assert execute([*asked, "-o", str(folder / name)], lambda: False) == 0


def test_the_document_names_what_it_stands_on(promised: Path):
    found = read_promise(promised / "promise.json")
    assert found["date"] == "2026-11-23"
    assert {f["name"] for f in found["files"]} >= {
        "promise.toml", "refine.toml", "mace-simple-lab.json", "mace-simple.toml"
    }  # fmt: skip
    assert found["draws_needed"] == 299
    (orbit,) = found["environments"]
    assert [c["name"] for c in orbit["compensators"]] == ["LQG 0", "LQG 3"]
    assert orbit["highest"] is None  # eight draws promise little
    assert all(low < m["frequency_hz"] < high for m in orbit["modes"] for low, high in [m["interval_95_hz"]])


def test_the_sweep_stands_beside_the_draws(promised: Path):
    orbit = read_promise(promised / "promise.json")["environments"][0]
    swept = orbit["sweep"]
    assert (swept["first_bending_percent"], swept["others_percent"]) == (10.0, 20.0)
    assert swept["first_bending"] == ["first bending x-y", "first bending x-z"]
    for loop in orbit["compensators"]:
        assert loop["sweep"]["cases"] == 2 * (2 + len(swept["others"])) + 4
        assert len(loop["sweep"]["lost"]) == loop["sweep"]["cases"] - loop["sweep"]["stable"]
    text = (promised / "promise.toml").read_text(encoding="utf-8")
    (promised / "other.toml").write_text(
        text + "\n[sweep]\nfirst_bending_percent = 0.0\nothers_percent = 1.0\n"
    )
    sweep = load_plan(promised / "other.toml", ARTICLE).plan.sweep
    assert (sweep.first_bending, sweep.others) == (0.0, 0.01)


def test_what_was_taken_out_is_the_way_from_the_ground(promised: Path):
    """To a thousandth of the frequency; also of modes that no survey saw."""
    orbit = read_promise(promised / "promise.json")["environments"][0]
    removed, modes = orbit["removed"], orbit["modes"]
    assert removed["survey"] == "virtual survey"
    assert removed["effects"] == ["suspension", "stiffness", "deformation"]
    for mode, shares in zip(modes, removed["share_hz"], strict=True):
        if mode["ground_hz"] is not None:
            way = mode["ground_hz"] - mode["frequency_hz"]
            assert sum(shares) == pytest.approx(way, abs=1e-3 * mode["frequency_hz"])
    largest = max(range(len(modes)), key=lambda k: sum(removed["share_hz"][k]))
    assert modes[largest]["name"] == "first torsion"
    assert removed["share_hz"][largest][1] > 0.9 * sum(removed["share_hz"][largest])


JOINT = """
[[joint]]
name = "pri_rel_z"
slip_torque_nm = 0.002
slip_angle_deg = 0.05
slip_torque_tolerance = 0.1
"""


SLIDE = """
[[proof_mass]]
name = "pm"
node = "n3"
axis = [0.0, 1.0, 0.0]
mass_kg = 0.2
natural_hz = 1.0
"""


def with_joint(promised: Path, folder: Path, joint: str) -> Path:
    """The plan with a joint, for three draws of one compensator."""
    for name in ("refine.toml", "mace-simple-lab.json"):
        (folder / name).write_bytes((promised / name).read_bytes())
    text = (promised / "promise.toml").read_text(encoding="utf-8").replace("draws = 8", "draws = 3")
    text = text.replace("log10_authority = [0.0, 3.0]", "log10_authority = [0.0]") + joint
    (folder / "promise.toml").write_text(text, encoding="utf-8")
    return folder


def test_friction_stands_beside_what_would_be_without_and_all_is_the_same_again(
    promised: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    promise(with_joint(promised, tmp_path, JOINT), "promise.json")
    assert "friction of joints" in capfd.readouterr().out
    document = read_promise(tmp_path / "promise.json")
    (orbit,) = document["environments"]
    (loop,) = orbit["compensators"]
    middle = document["shares"].index(0.5)
    assert loop["db"][middle] > loop["without_friction_db"][middle]
    assert loop["stable_while_sticking"] == 1.0
    assert set(loop["travel_over_slip_angle"]) == {"pri_rel_z"}
    assert orbit["friction"]["joints"][0]["slip_torque_nm"] == 0.002
    assert not any("every plant is linear" in limit for limit in document["not_valid_for"])
    assert sum("drag of pri_rel_z other than" in limit for limit in document["not_valid_for"]) == 1
    assert sum("a weak cable to the article" in limit for limit in document["not_valid_for"]) == 1
    first = (tmp_path / "promise.json").read_bytes()
    promise(tmp_path, "again.json", "--ledger", str(tmp_path / "draws.ledger"), fresh=True)
    assert (tmp_path / "again.json").read_bytes() == first


def test_no_draw_of_a_loop_with_friction_is_stable(
    promised: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    folder = with_joint(promised, tmp_path, JOINT)
    plan = folder / "promise.toml"
    text = plan.read_text(encoding="utf-8").replace("authority = [0.0]", "authority = [6.0]")
    text = text.replace("delay_s = 0.010", "delay_s = 0.2").replace(
        "tolerance_s = 0.001", "tolerance_s = 0.19"
    )
    plan.write_text(text, encoding="utf-8")
    promise(folder, "promise.json")
    (orbit,) = read_promise(folder / "promise.json")["environments"]
    (loop,) = orbit["compensators"]
    assert loop["probability_stable"] == 0.0
    assert loop["travel_over_slip_angle"] == {"pri_rel_z": None}
    assert "pri_rel_z -" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("joint", "what"),
    [
        (JOINT + JOINT, "the name 'pri_rel_z' is given twice"),
        (JOINT.replace("slip_angle_deg = 0.05", "slip_angle_deg = 0.0"), "slip_angle_deg"),
        (JOINT.replace("tolerance = 0.1", "tolerance = 1.5"), "tolerances from 0 to below 1"),
        (JOINT.replace("slip_torque_nm", "slip_nm"), "slip_nm"),
    ],
)
def test_a_joint_with_a_fault_is_refused(promised: Path, tmp_path: Path, joint: str, what: str):
    with pytest.raises(ConfigError, match=what):
        load_plan(with_joint(promised, tmp_path, joint) / "promise.toml", ARTICLE)


@pytest.mark.parametrize("of_plan", [True, False])
def test_friction_of_a_slide_is_refused(promised: Path, tmp_path: Path, of_plan: bool):
    """Its N and m have no place in N m and degrees, and would be read as such."""
    article = tmp_path / "slide.toml"
    article.write_text(ARTICLE.read_text(encoding="utf-8") + SLIDE, encoding="utf-8")
    joint = JOINT.replace("pri_rel_z", "pm_rel") if of_plan else ""
    folder = with_joint(promised, tmp_path, joint)
    if not of_plan:
        with (folder / "refine.toml").open("a", encoding="utf-8") as file:
            file.write('\n[[friction]]\njoint = "pm"\nslip_torque_nm = 0.1\nslip_angle_deg = 0.1\n')
    with pytest.raises(ConfigError, match=r"(?s)joint 'pm' slides.*in Python"):
        load_plan(folder / "promise.toml", article)


def test_what_came_is_compared(promised: Path, capfd: pytest.CaptureFixture[str]):
    outcome = promised / "outcome.toml"
    text = outcome.read_text(encoding="utf-8")
    outcome.write_text(text[: text.index('[[compensator]]\nenvironment = "orbit"\nname = "LQG 6"')])
    found = json.loads(middeck(capfd, "outcome", promised / "promise.json", outcome, "--json").out)
    assert found["promise"] == read_promise(promised / "promise.json")["sha256"]
    assert found["score"]["count"] == 10
    assert found["score"]["brier"] == 0.0
    assert sum(v["inside"] for v in found["verdicts"]) >= 9


def test_many_comparisons_are_scored_together(
    promised: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """By hand: 3 of 4 inside; two loops of 0.9 and 0.6, of which the second is lost; 1.5 dB."""

    def written(name: str, promise: str, *rows: tuple[object, ...]) -> Path:
        keys = "kind", "name", "inside", "brier", "pessimism_db"
        verdicts = [dict(zip(keys, row, strict=True)) for row in rows]
        sealed = seal({"schema": "middeck.comparison/1", "promise": promise, "verdicts": verdicts})
        (tmp_path / name).write_text(json.dumps(sealed), encoding="utf-8")
        return tmp_path / name

    mode = "mode", "orbit: mode 1"
    a = written("a.json", "aa", (*mode, True, None, None), ("compensator", "orbit: K", True, 0.01, 1.5))
    b = written("b.json", "bb", (*mode, False, None, None), ("compensator", "orbit: K", True, 0.36, None))
    found = json.loads(middeck(capfd, "outcome", a, b, "--json", "-o", tmp_path / "score.json").out)
    assert found["score"] == {
        "count": 4, "coverage": 0.75, "coverage_interval_95": [0.19412, 0.993691], "brier": 0.185,
        "pessimism_db": 1.5, "lost": 1,
    }  # fmt: skip
    assert found["by_kind"]["mode"]["coverage"] == 0.5
    assert found["by_kind"]["mode"]["brier"] is None
    assert [c["promise"] for c in found["comparisons"]] == ["aa", "bb"]
    assert json.loads((tmp_path / "score.json").read_text(encoding="utf-8")) == found
    assert seal({key: value for key, value in found.items() if key != SEAL}) == found
    assert "score of 2 comparisons" in middeck(capfd, "outcome", a, b).out
    twice = middeck(capfd, "outcome", a, written("c.json", "aa", (*mode, True, None, None)))
    assert (twice.code, "orbit: mode 1 of promise aa... stands in" in twice.err) == (4, True)
    tampered = json.loads(b.read_text(encoding="utf-8"))
    tampered["verdicts"][0]["inside"] = True
    b.write_text(json.dumps(tampered), encoding="utf-8")
    assert "not what was sealed" in middeck(capfd, "outcome", a, b).err
    assert middeck(capfd, "outcome", a, promised / "promise.json", a).code == 2


def test_a_changed_promise_is_refused(promised: Path, tmp_path: Path):
    text = (promised / "promise.json").read_text(encoding="utf-8")
    changed = tmp_path / "promise.json"
    changed.write_text(text.replace('"probability_stable": 1.0', '"probability_stable": 0.5', 1))
    with pytest.raises(DataError, match="not what was sealed"):
        read_promise(changed)
    changed.write_text(json.dumps(json.loads(text)))  # other spaces, the same content
    assert read_promise(changed)["sha256"] == json.loads(text)["sha256"]


def test_another_document_is_no_promise(tmp_path: Path):
    other = tmp_path / "x.json"
    other.write_text(json.dumps(seal({"schema": "middeck.refine/1"})))
    with pytest.raises(DataError, match="schema"):
        read_promise(other)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("weights = [1.0]", "weights = [1.0, 2.0]", "2 weights for 1 ports"),
        ("kd_nms_per_rad = [", "kd_nms_per_rad = [0.1, ", "kd"),
        ("delay_tolerance_s = 0.001", "delay_tolerance_s = 0.1", "delay"),
        ("draws = 8", "draws = 0", "draws"),
        ('refinement = "refine.toml"', 'refinement = "none.toml"', "none.toml"),
        ('environments = ["orbit"]', 'environments = ["moon"]', "moon"),
        ("[noise]", "[noises]", "noise"),
        ("[noise]", "[sweep]\nothers_percent = 100.0\n[noise]", "others_percent"),
        ("log10_authority = [0.0, 3.0]", "log10_authority = [0.0, 400.0]", "must be >= -12 and <= 12"),
        ("log10_authority = [0.0, 3.0]", "log10_authority = 3.0", r"try: log10_authority = \[3.0\]"),
    ],
)
def test_a_plan_with_a_fault_is_refused(promised: Path, tmp_path: Path, old: str, new: str, what: str):
    for name in ("refine.toml", "mace-simple-lab.json"):
        (tmp_path / name).write_bytes((promised / name).read_bytes())
    text = (promised / "promise.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "promise.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises((ConfigError, DataError), match=what):
        load_plan(tmp_path / "promise.toml", ARTICLE)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('[[compensator]]\nenvironment = "orbit"\nname = "a"\nstable = true\n', "without its rms_db"),
        ('[[compensator]]\nenvironment = "orbit"\nname = "a"\nstable = false\nrms_db = 1.0\n', "with rms_db"),
        ('[[mode]]\nenvironment = "orbit"\nnumber = 0\nfrequency_hz = 1.0\n', "number"),
        ('[[mode]]\nenvironment = "orbit"\nfrequency_hz = 1.0\n', "neither name nor number"),
        ("mode = 3\n", r"must be an array\n  try: mode = \[3\]"),
        ("[mode]\nnumber = 1\n", r"must be an array\n  try: \[\[mode\]\] for each table"),
    ],
)
def test_an_outcome_that_cannot_be_is_refused(tmp_path: Path, text: str, what: str):
    file = tmp_path / "outcome.toml"
    file.write_text('schema = "middeck.outcome/1"\n\n' + text)
    with pytest.raises((ConfigError, DataError), match=what):
        load_outcomes(file)


def test_scores_are_those_of_a_hand_count():
    warnings = [
        Statement(kind="mode", name="f", low=1.0, high=2.0),
        Statement(kind="compensator", name="held", low=-21.0, high=-19.0, probability=0.9, cautious=-18.5),
        Statement(kind="compensator", name="lost", low=-30.0, high=np.inf, probability=0.6, cautious=np.inf),
    ]
    came = [
        Scored(kind="mode", name="f", value=2.5),
        Scored(kind="compensator", name="held", value=-20.0),
        Scored(kind="compensator", name="lost", value=None, stable=False),
    ]
    found = score(judge(warnings, came))
    assert found.coverage == pytest.approx(2 / 3)
    assert found.brier == pytest.approx((0.1**2 + 0.6**2) / 2)
    assert found.pessimism == pytest.approx(1.5)


def test_an_outcome_of_which_nothing_was_said_is_refused(promised: Path):
    statements = statements_of(read_promise(promised / "promise.json"))
    with pytest.raises(DataError, match="the promise has no mode 'orbit: mode 99'"):
        judge(statements, [Scored(kind="mode", name="orbit: mode 99", value=1.0)])
    one = Scored(kind="mode", name="orbit: mode 1", value=1.0)
    with pytest.raises(DataError, match="two outcomes"):
        judge(statements, [one, one])
    with pytest.raises(DataError, match="no outcome"):
        score(())
