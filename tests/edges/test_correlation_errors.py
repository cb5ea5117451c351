"""A correlation that cannot be made is refused, with its place and what to try; the verb tells all."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from coarse_articles import coarse
from middeck.cli.verbs import correlate as verb
from middeck.errors import ConfigError, DataError
from middeck.files.measured.modes import load_measured_modes, write_measured_modes
from middeck.structure.correlation.correlate import correlate_modes
from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes
from middeck.structure.correlation.reduction import Reduction
from middeck.structure.correlation.review_criteria import (
    PROFILE_NAMES,
    RECALLED,
    Quantity,
    change_limit,
    find_profile,
)
from middeck.structure.modes.solve import Modes
from repeats import repeats

ARTICLE, LAB = coarse("mace-simple"), ROOT / "environments/lab.toml"
SURVEY = ROOT / "data/virtual-survey/mace-simple-lab.json"
NOISE = MeasurementNoise(0.001, 0.02)
PROFILE = find_profile("orion-well")
Capture = pytest.CaptureFixture[str]


def solved(*overrides: str) -> Modes:
    return md.solve_modes(md.solve_equilibrium(*md.load_setup(ARTICLE, LAB, overrides)))


@pytest.fixture(scope="module")
def lab() -> Modes:
    return solved()


@pytest.fixture(scope="module")
def orbit() -> Modes:
    return md.solve_modes(md.solve_equilibrium(md.load_setup(ARTICLE, LAB)[0], md.Environment.orbit()))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def refused(error: type[Exception], *says: str):
    return pytest.raises(error, match="(?s)" + ".*".join(says))


def survey(**changes: Any) -> MeasuredModes:
    return dataclasses.replace(load_measured_modes(SURVEY), **changes)


# What a test cannot have measured


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frequency_hz": -np.ones(8)}, "frequency of -1.0 Hz"),
        ({"frequency_hz": np.full(8, np.nan)}, "frequency_hz .* not finite"),
        ({"shape": np.full((24, 8), np.inf)}, "shape .* not finite"),
        ({"shape": np.zeros((24, 8))}, "shape of mode 1 is zero"),
        ({"shape_std": -np.ones((24, 8))}, "shape_std .* negative"),
        ({"direction": ("w",) * 24}, "no direction 'w'"),
        ({"node": ("n1",) * 24, "direction": ("x",) * 24}, "two channels are 'n1 x'"),
        ({"node": ("n1",)}, "1 nodes and 24 directions for 24 rows"),
    ],
)
def test_impossible_measurements(changes: dict[str, Any], says: str):
    with refused(DataError, says):
        survey(**changes)


@pytest.mark.parametrize("noise", [(-0.1, 0.0), (0.0, 1.0), (float("nan"), 0.0)])
def test_noise_out_of_range(noise: tuple[float, float]):
    with refused(ConfigError, "the noise of the", "0 to below 1"):
        MeasurementNoise(*noise)


# What does not fit the model


@pytest.mark.parametrize(
    ("channel", "says"),
    [
        (("n9", "x"), "no node 'n9'.*nodes and joints are 'n1', 'n2'"),
        (("n1", "angle"), "'n1' is no joint with an angle.*pri_x"),
        (("pri_x", "travel"), "'pri_x' is no joint with a travel.*not there"),
        (("n1", "up"), "no direction 'up'"),
    ],
)
def test_channels_that_the_model_does_not_have(lab: Modes, channel: tuple[str, str], says: str):
    with refused(ConfigError, says):
        measure_modes(lab, [channel])


def test_a_joint_that_does_not_move_has_no_angle():
    locked = solved("gimbal.0.state_x=locked")
    with refused(ConfigError, "joint 'pri_x' does not move"):
        measure_modes(locked, [("pri_x", "angle")])


def test_modes_that_no_test_measures(orbit: Modes):
    for index in (0, -1, len(orbit.omega)):
        with refused(ConfigError, f"no mode {index} "):
            measure_modes(orbit, chosen=[index])


def test_noise_needs_a_generator(lab: Modes):
    with refused(ConfigError, "without a random generator"):
        measure_modes(lab, noise=NOISE)


def test_a_test_without_stated_noise(lab: Modes):
    silent = survey(shape_std=None)
    with refused(ConfigError, "states no standard deviations", "MeasurementNoise"):
        correlate_modes(lab, silent, PROFILE, rng=rng())


def test_no_runs(lab: Modes):
    with refused(ConfigError, "0 runs"):
        correlate_modes(lab, survey(), PROFILE, rng=rng(), runs=0)


def test_frequencies_in_other_units(lab: Modes):
    kilo = survey(frequency_hz=1e-3 * load_measured_modes(SURVEY).frequency_hz)
    with refused(ConfigError, "no mode of the model between", "in Hz?"):
        correlate_modes(lab, kilo, PROFILE, rng=rng())


def test_too_few_channels_for_serep(lab: Modes):
    few = measure_modes(lab, [("n1", "y"), ("n5", "y"), ("n3", "z")], chosen=range(10, 18))
    with refused(ConfigError, "3 channels cannot distinguish", "guyan"):
        correlate_modes(lab, few, PROFILE, rng=rng(), noise=NOISE)


@pytest.mark.parametrize("reduction", [Reduction.GUYAN, Reduction.IRS])
def test_a_static_reduction_of_what_still_floats(orbit: Modes, reduction: Reduction):
    upright = measure_modes(orbit, [(f"n{i}", "y") for i in range(1, 6)], chosen=range(10, 14))
    with refused(ConfigError, "still moves freely", "add sensors"):
        correlate_modes(orbit, upright, PROFILE, rng=rng(), noise=NOISE, reduction=reduction)


def test_channels_that_read_the_same_motion():
    """What hangs on a locked axis turns with its node."""
    welded = solved("gimbal.0.state_x=locked")
    at = [("n1", "rx"), ("pri_x", "rx"), ("n3", "y"), ("n5", "y"), ("n1", "z")]
    with refused(ConfigError, "channels 0, 1 .*read the same motion", "leave one"):
        correlate_modes(
            welded,
            measure_modes(welded, at, chosen=[10, 11]),
            PROFILE,
            rng=rng(),
            noise=NOISE,
            reduction=Reduction.GUYAN,
        )


def test_two_meshes_are_not_compared_by_coordinates(lab: Modes):
    with refused(ConfigError, "different meshes", "correlate_modes"):
        md.compare_modes(solved("mesh.elements_per_strut=4"), lab)


def test_profiles_are_found_by_name_and_changed_by_hand():
    with refused(ConfigError, "no profile 'orion-wel'", "did you mean 'orion-well'"):
        find_profile("orion-wel")
    tailored = change_limit(find_profile("nasa-std-5002"), Quantity.FREQUENCY_ERROR, 0.07, "test plan 3.2")
    changed = [c for c in tailored.criteria if c.limit == 0.07]
    assert [(c.source, c.recalled) for c in changed] == [("test plan 3.2", False)]
    assert tailored.recalled
    with refused(ConfigError, "has no limit for the COMAC", "it judges"):
        change_limit(find_profile("nasa-std-5002"), Quantity.COMAC, 0.9, "test plan 3.2")


# Files


def test_a_file_comes_back_as_it_was(tmp_path: Path, lab: Modes):
    real = measure_modes(lab, noise=NOISE, rng=rng())
    turned = dataclasses.replace(real, shape=real.shape * np.exp(0.4j), damping_std=real.damping)
    for measured in (real, turned, measure_modes(lab)):
        write_measured_modes(tmp_path / "modes.json", measured)
        assert load_measured_modes(tmp_path / "modes.json") == measured


FAULTS: dict[str, tuple[Any, ...]] = {
    "empty": ("", "the file is empty"),
    "truncated": ('{"schema": "middeck.measured-modes/1",', "truncated or not JSON"),
    "other": ('{"schema": "middeck.model/1"}', "schema is 'middeck.model/1'"),
    "list": ("[1, 2]", "schema is None"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_that_is_none_of_ours(tmp_path: Path, fault: str):
    text, says = FAULTS[fault]
    path = tmp_path / "modes.json"
    path.write_text(text)
    with refused(DataError, "modes.json", says):
        load_measured_modes(path)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("damping", None, "keys missing: damping"),
        ("shape_sdt", [1.0], "unknown key 'shape_sdt'.*shape_std"),
        ("frequency_hz", ["a"], "frequency_hz: not an array of numbers"),
        ("frequency_hz", [1.0], "does not fit"),
        ("shape", [[1.0], [1.0, 2.0]], "shape: not an array of numbers"),
        ("shape", {"re": [[1.0]]}, "shape: keys re"),
        ("shape", {"re": [[1.0]], "im": [[1.0, 2.0]]}, "im \\(1, 2\\)"),
        ("node", "n1", "node: not a list of texts"),
        ("node", None, r"keys missing: node\n  try: the node in the article"),
        ("node", [], r"shapes without names of their nodes\n  try: .*frequencies alone"),
        ("node", [" "] * 24, "shapes without names of their nodes"),
        ("damping", [float("nan")] * 8, "damping: a number is not finite"),
        ("frequency_hz", [0.0] * 8, "frequency of 0.0 Hz"),
    ],
)
def test_a_fault_of_a_file_names_file_and_key(tmp_path: Path, key: str, value: Any, says: str):
    data = json.loads(SURVEY.read_text(encoding="utf-8"))
    data[key] = value
    if value is None:
        del data[key]
    path = tmp_path / "modes.json"
    path.write_text(json.dumps(data))
    with refused(DataError, "modes.json", says):
        load_measured_modes(path)


def test_a_missing_file(tmp_path: Path):
    with refused(DataError, "none.json: cannot be read"):
        load_measured_modes(tmp_path / "none.json")


# The verb


def test_channels_at_rest_are_not_among_the_lowest_comac(capfd: Capture, orbit: Modes, tmp_path: Path):
    bent = [orbit.name.index(f"first bending x-{way}") for way in "yz"]
    at = [(f"n{i}", way) for i in range(1, 6) for way in "xyz"]
    test = measure_modes(orbit, at, chosen=bent, noise=NOISE, rng=rng())
    write_measured_modes(tmp_path / "plane.json", test)
    asked = ("correlate", ARTICLE, tmp_path / "plane.json", "--environment", "orbit", "--runs", 1)
    document = json.loads(middeck(capfd, *asked, "--json").out)
    at_rest = [name for name, value in document["comac"].items() if value is None]
    assert at_rest == [f"n{i} x" for i in range(1, 6)]
    shown = middeck(capfd, *asked).out
    assert "at rest, in the model and within the noise of the test: 'n1 x', 'n2 x'" in shown
    assert "n1 x" not in shown[shown.index("lowest COMAC") : shown.index("at rest")]


def test_the_verb_prints_what_the_room_computes(capfd: Capture, lab: Modes):
    ended = middeck(capfd, "correlate", ARTICLE, SURVEY, "--runs", 50, "--seed", 4, "--json")
    assert (ended.code, ended.err) == (0, "")
    document = json.loads(ended.out)
    found = correlate_modes(
        lab,
        load_measured_modes(SURVEY),
        find_profile("ecss-e-st-32-11c"),
        rng=np.random.default_rng(4),
        runs=50,
    )
    assert document["schema"] == "middeck.correlate/2"
    assert document["passed"] == found.passed
    assert [document["model_index"], document["test_index"]] == found.pairs.T.tolist()
    assert document["mac"] == found.evaluation.mac.tolist()
    assert document["cross_orthogonality"] == found.evaluation.cross_orthogonality.tolist()
    assert list(document["comac"].values()) == found.evaluation.comac.tolist()
    assert document["probability_of_a_correct_model"]["value"] == found.probability.value
    for entry, finding in zip(document["criteria"], found.findings, strict=True):
        assert entry["worst"] == finding.worst
        assert entry["source"] == finding.criterion.source
        assert entry["probability_of_a_correct_model"]["low_95"] == finding.probability.interval[0]


@pytest.mark.parametrize("shapes", [True, False])
def test_documents_count_from_zero_and_texts_as_the_survey(tmp_path: Path, capfd: Capture, shapes: bool):
    """The model's modes as `modes` counts them, measured ones from one in texts; and which has no partner."""
    measured, test = load_measured_modes(SURVEY), tmp_path / "test.csv"
    shown = np.column_stack([np.arange(1, 9), measured.frequency_hz * np.array([0.01] + [1.0] * 7)])
    test.write_text("mode,frequency [Hz]\n" + "".join(f"{n:.0f},{hz!r}\n" for n, hz in shown.tolist()))
    ask = ("correlate", ARTICLE, SURVEY if shapes else test, *(("--runs", 2) if shapes else ()))
    document, text = json.loads(middeck(capfd, *ask, "--json").out), middeck(capfd, *ask).out
    table = text.partition("\npairs")[2].partition("\n\n")[0].splitlines()
    rows = [line.split()[:4] for line in table if line.split()[:1] and line.split()[0].isdigit()]
    assert [int(row[1]) for row in rows] == document["model_index"]
    assert [int(row[0]) for row in rows] == [j + 1 for j in document["test_index"]]
    hz = (shown[:, 1], measured.frequency_hz)[shapes]
    assert document["measured_hz"] == [hz[j] for j in document["test_index"]]
    alone = {*range(8)} - {*document["test_index"]}
    assert alone == {*document["unpaired_test_index"]}
    assert all(f"measured mode {j + 1} of" in " ".join(document["warnings"]) for j in alone)
    assert bool(alone) != shapes


@pytest.mark.parametrize("profile", repeats(PROFILE_NAMES, 2))
def test_every_output_says_which_limits_are_recalled(capfd: Capture, profile: str):
    ask = ("correlate", ARTICLE, SURVEY, "--profile", profile, "--runs", 2)
    document = json.loads(middeck(capfd, *ask, "--json").out)
    recalled = find_profile(profile).recalled
    assert {c["status"] == RECALLED for c in document["criteria"]} == {recalled}
    text = middeck(capfd, *ask)
    table = text.out.partition("\ncriteria\n")[2].partition("\neffective mass")[0]
    limits = [line for line in table.splitlines() if "<=" in line or ">=" in line]
    assert len(limits) == len(document["criteria"])
    assert all(("[R]" in line) == recalled for line in limits)
    assert (f"[R] = {RECALLED}" in table) == (RECALLED in text.err) == recalled


def test_a_verdict_ends_with_one_only_where_it_was_asked_for(capfd: Capture):
    ask = ("correlate", ARTICLE, SURVEY, "--profile", "orion-adequate", "--reduction", "guyan", "--runs", 2)
    assert middeck(capfd, *ask).code == 0
    refusal = middeck(capfd, *ask, "--require")
    assert refusal.code == 1
    assert "does not pass" in refusal.out
    ended = middeck(capfd, "correlate", ARTICLE, SURVEY, "--runs", 2, "--require")
    assert ended.code == 0
    for note in (verb.PAIRS_NOTE, verb.EFFECTIVE_NOTE):
        assert ended.out.count(note) == 1
    assert all(f"{column}: " in verb.PAIRS_NOTE for column in ("cross", "off", "self off"))


def test_noise_of_the_command_line_replaces_that_of_the_test(capfd: Capture):
    ask = ("correlate", ARTICLE, SURVEY, "--runs", 20, "--profile", "orion-well", "--json")
    chance = [
        json.loads(middeck(capfd, *ask, *more).out)["probability_of_a_correct_model"]["value"]
        for more in (("--noise", "0,0"), ("--noise", "0.001,0.3"))
    ]
    assert chance == [1.0, 0.0]


def test_usage_and_data_errors_of_the_verb(capfd: Capture, tmp_path: Path):
    ended = middeck(capfd, "correlate", ARTICLE, SURVEY, "--profile", "none")
    assert (ended.code, ended.out) == (2, "")
    ended = middeck(capfd, "correlate", ARTICLE, tmp_path / "none.json")
    assert (ended.code, ended.out) == (4, "")
    ended = middeck(capfd, "correlate", ARTICLE, SURVEY, "--noise", "2,0")
    assert (ended.code, ended.out) == (2, "")
    dm = middeck(capfd, "correlate", ROOT / "articles/mace-dm.toml", SURVEY)
    assert dm.code == 2
    assert str(SURVEY) in dm.err  # its channels are not the article's


def test_a_set_of_sensors_that_is_too_small_has_no_condition(capfd: Capture, lab: Modes, tmp_path: Path):
    few = measure_modes(lab, [(f"n{i}", "z") for i in (1, 3, 5)], chosen=[10, 11, 12, 13])
    write_measured_modes(tmp_path / "few.json", few)
    ask = ("correlate", ARTICLE, tmp_path / "few.json", "--noise", "0,0", "--runs", 1, "--reduction", "guyan")
    assert json.loads(middeck(capfd, *ask, "--json").out)["sensor_condition"] is None
    assert "sensors      too few to distinguish the modes" in middeck(capfd, *ask).out


def test_help_lists_every_profile_and_reduction():
    """The verb repeats the names, as help must not import what computes."""
    assert verb.PROFILES == PROFILE_NAMES
    assert tuple(r.value for r in Reduction) == verb.REDUCTIONS
    assert [q.name for q in Quantity] == [name.replace("-", "_").upper() for name in verb.QUANTITIES]


def test_a_limit_of_ones_own_is_marked(capfd: Capture):
    ask = ("correlate", ARTICLE, SURVEY, "--runs", 2, "--limit", "frequency-error", 0.02, "--json")
    found = json.loads(middeck(capfd, *ask).out)
    limits = {c["quantity"]: (c["limit"], c["source"]) for c in found["criteria"]}
    assert limits["frequency error"] == (0.02, "--limit of the command line")
    assert "frequency error by --limit" in found["profile_title"]
    assert limits["MAC"][1] != limits["frequency error"][1]


def test_the_example_survey_is_what_its_script_makes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(SURVEY.parent))
    import make as maker

    made = maker.rounded(maker.survey())
    stored = load_measured_modes(SURVEY)
    assert made.channels == stored.channels
    # Rounded to six decimals; another machine may round the last one the other way.
    np.testing.assert_allclose(made.frequency_hz, stored.frequency_hz, atol=2e-6)
    np.testing.assert_allclose(made.shape, stored.shape, atol=2e-6)
