"""Odd values through ``--set``: every result still keeps the contract, and every sentence is still true."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from test_numbers import ends

from middeck.errors import ConfigError
from middeck.files.json.output import json_text
from middeck.files.studies.documents import load_study
from middeck.report.results_folder import StudyWriter
from middeck.study.chapters.zero_g_control.chapter import ZERO_G_CONTROL
from middeck.study.chapters.zero_g_control.computation import ZeroGControl
from middeck.study.chapters.zero_g_control.numbers_and_claims import figure_7_claims
from middeck.study.mission import run_chapters
from repeats import LONG, repeats

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "studies/mace-1993.toml"
CONTRACT = json.loads((ROOT / "tests/reference/numbers.schema.json").read_text())
SHIPPED = json.loads(files("middeck.study").joinpath("numbers.schema.json").read_text())

# Each case sets what cannot touch another: Figures 4 to 7 stand on [control], the others on their own tables.
# A shorter period and a slower computer on the rig: fewer lines and less time, in every case.
SHORT = ("siso.period_s=16", "siso.periods=2", "rig.rest_s=2", "rig.sample_hz=250")
FEW_LEVELS = () if LONG else ("control.levels=9",)  # `test_numbers` holds the study to the contract's 25
if not LONG:  # fewer states and smaller designs too
    SHORT += ("siso.period_s=8", "rig.rest_s=1", "rig.sample_hz=150", "sito.states=12")
    SHORT += ("sito.smaller_states=[10]", "sito.smaller_bands_hz=[[0.6, 12]]", "mesh.elements_per_strut=2")
CASES = {
    "moon": (
        "constants.gravity=1.62",
        'figure_6.outputs=["bus_z_rate", "pri_in_z_rate"]',
        "siso.fit_band_hz=[0.25, 20]",
    ),
    "heavy": (
        "node.0.mass=30",
        "control.modes_kept=24",
        "figure_6.band_hz=[0.1, 4]",
        "rig.identification_noise=0.3",
    ),
    "soft": ("suspension.bounce_hz=0.2", "siso.pair_shift_hz=7", "siso.high.log10_authority=6"),
    "late": ("control.log10_authority_first=3", "siso.states=4", "siso.pade_order=1"),
    "many modes": ("control.modes_kept=60", "figure_6.band_hz=[35, 40]"),
    "level": ("suspension.offsets.0.2=0", "rig.delay_s=0.006", 'siso.drifted="down"'),
    "wild": ("siso.low.log10_authority=12", "sito.payload.predicted_db=90", "sito.both.predicted_db=90"),
    "weak": ("siso.robust.log10_authority=-2", "sito.lead_zeros_hz=10", "sito.lead_poles_hz=8"),
    "few": ("sito.states=10", "sito.smaller_states=[8]", "sito.smaller_bands_hz=[[0.2, 12]]"),
}


class Result:
    """What one case wrote, read back."""

    def __init__(self, out: Path) -> None:
        self.text = (out / "numbers.json").read_text(encoding="utf-8")
        self.document = json.loads(self.text)
        self.figures: dict[str, Any] = self.document["figures"]
        self.page = (out / "report.html").read_text(encoding="utf-8")
        captions = re.findall(r'<figcaption id="([^"]+)-caption">(.*?)</figcaption>', self.page, re.DOTALL)
        self.sentence: dict[str, str] = dict(captions)

    def claim(self, figure: str, beginning: str) -> dict[str, Any]:
        return next(c for c in self.figures[figure]["claims"] if beginning in c["claim"])


@pytest.fixture(scope="module", params=repeats(CASES, 2))
def case(request: pytest.FixtureRequest) -> str:
    return request.param


RESULTS: dict[str, Result] = {}


def with_rig(case: str) -> bool:
    return LONG or case == "moon"


@pytest.fixture(scope="module")
def result(case: str, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """All chapters but mirror and promise, on which these values do not act; `make test` runs one rig."""
    without = (
        ("mirror", "promise") if with_rig(case) else ("mirror", "promise", "figure 9", "figures 10 to 12")
    )
    if case not in RESULTS:
        study = load_study(STUDY, (*SHORT, *FEW_LEVELS, *CASES[case]))
        out = tmp_path_factory.mktemp("case")
        writer = StudyWriter(out, study)
        for name, compute in run_chapters(study):
            if name not in without:
                writer.add(name, compute())
        writer.finish()
        RESULTS[case] = Result(out)
    return RESULTS[case]


def of_chapters(case: str, schema: dict[str, Any]) -> dict[str, Any]:
    """The schema, without the figures of chapters and the levels that do not run."""
    schema = json.loads(json.dumps(schema))
    asked = schema["properties"]["figures"]
    if not LONG:
        asked["properties"]["figure_7"]["properties"]["log10_authority"]["minItems"] = 9
    early = ("figure_4", "figure_5", "figure_6", "figure_7")
    asked["required"] = [
        n for n in asked["required"] if n in early or (n not in ("mirror", "promise") and with_rig(case))
    ]
    return schema


def test_numbers_keep_both_schemas(case: str, result: Result) -> None:
    for schema in (CONTRACT, SHIPPED):
        jsonschema.validate(ends(result.document), of_chapters(case, schema))


def test_the_page_says_nothing_that_is_no_number(result: Result) -> None:
    words = re.sub(r"<style.*?</style>|<[^>]*>", " ", result.page, flags=re.DOTALL)
    assert not re.findall(r"(?<![\w-])(?:nan|-?inf|None)(?![\w-])", words)


def test_claims_hold_only_with_what_they_need(result: Result) -> None:
    for figure in ("figure_6", "figure_7", "figure_9b", "figure_10b", "figure_11", "figure_12"):
        for row in result.figures.get(figure, {"claims": ()})["claims"]:
            never = "or never" in row["claim"]
            assert row["number"] is not None or not row["holds"] or never, row


def test_figures_4_and_5_always_show_the_papers_modes(result: Result) -> None:
    assert len(result.figures["figure_4"]["orbit"]["frequency_hz"]) >= 26
    assert len(result.figures["figure_5"]["matrix"]) >= 26


@pytest.fixture(scope="module")
def of(tmp_path_factory: pytest.TempPathFactory):
    """A result that an earlier test has made."""
    return lambda name: RESULTS.get(name) or pytest.skip("its case was not asked for")


def test_moon_nothing_goes_unstable_and_every_row_is_there(of) -> None:
    moon: Result = of("moon")
    seven = moon.figures["figure_7"]
    assert seven["all"]["first_instability"] is None
    assert len(seven["claims"]) == 9
    assert not moon.claim("figure_7", "the 1-g loop becomes unstable")["holds"]
    assert not moon.claim("figure_7", "one complex pair")["holds"]
    assert "stay stable in 1-g" in moon.sentence["figure-7a"]


def test_moon_words_follow_the_ports_and_the_band(of) -> None:
    moon: Result = of("moon")
    assert "In the bus z rate" in moon.sentence["figure-6a"]
    assert "In the payload z rate" in moon.sentence["figure-6b"]
    assert "Figure 6a: gimbal z torque to bus z rate" in moon.page
    nine = moon.figures["figure_9a"]
    below = nine["mode_below_fit"]
    if below is None:
        assert "outside the fit" not in moon.sentence["figure-9a"]
    else:
        assert below["frequency_hz"] < nine["fit_band_hz"][0]
        assert f"{below['frequency_hz']:.2f} Hz" in moon.sentence["figure-9a"]


def test_heavy_a_real_pole_is_a_divergence(of) -> None:
    heavy: Result = of("heavy")
    seven = heavy.figures["figure_7"]
    first = seven["flexible"]["first_instability"]
    assert first["frequency_hz"] == 0.0
    assert (first["unstable_pairs"], first["unstable_real_poles"]) == (0, 1)
    assert "divergence" in heavy.sentence["figure-7b"]
    assert "0.00 Hz" not in heavy.sentence["figure-7b"]


def test_heavy_nothing_is_reported_of_what_is_not_measured(of) -> None:
    heavy: Result = of("heavy")
    six = heavy.figures["figure_6"]
    assert six["phase_gap_s"] is None
    assert six["magnitude_error_band_hz"] == [0.3, 4.0]
    assert "from 0.3 to 4 Hz" in heavy.sentence["figure-6a"]
    assert "above 5 Hz" in heavy.sentence["figure-6a"]
    assert heavy.claim("figure_6", "the phase of the rig") == {
        "claim": "the phase of the rig relative to the model above 5 Hz is that of its delay within 0.2 ms;"
        " largest difference [ms]",
        "holds": False,
        "number": None,
        "asked": "< 0.2",
        "unit": "ms",
    }


@pytest.fixture(scope="module")
def delayed() -> ZeroGControl:
    """Figure 7 at three levels, the first of which is unstable in 1-g already."""
    study = load_study(STUDY, ("control.log10_authority_first=3", "control.levels=3"))
    outcome = dict(run_chapters(study))["figure 7"]()
    assert isinstance(outcome, ZeroGControl)
    return outcome


def test_an_unstable_first_level_has_no_decibels_and_ends_no_study(delayed: ZeroGControl) -> None:
    rows = {row["claim"].partition(";")[0]: row for row in figure_7_claims(delayed)}
    low = rows["at the lowest authority the error is smaller in 1-g than in 0-g"]
    assert (low["holds"], low["number"]) == (False, None)
    repeats = rows["in the rigid sub-model the same mode becomes unstable first, within 0.25 decade"]
    assert (repeats["holds"], repeats["number"]) == (False, None)
    json_text(ZERO_G_CONTROL.tabulate(delayed))  # raises for what is not finite


def leaves(table: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        name = f"{path}.{key}".lstrip(".")
        if isinstance(value, dict):
            yield from leaves(value, name)
        else:
            yield name, value


GIVEN = tomllib.loads(STUDY.read_text(encoding="utf-8"))
KEYS = dict(leaves({name: GIVEN[name] for name in ("siso", "sito")}))
PATHS = (
    "siso.article",
    "siso.environment",
    "siso.actuator",
    "siso.sensor",
    "sito.sensors",
)  # names, not values


def changed(value: Any) -> Any:
    """Another value of the same kind that the study still takes: states stay even, bands ascend."""
    match value:
        case bool() | str():
            return value
        case int():
            return value + 2
        case float():
            return 1.25 * value
        case _:
            return [changed(v) for v in value]


@pytest.mark.parametrize("key", KEYS)
def test_every_key_of_the_loops_can_be_set(key: str) -> None:
    wanted = {"siso.drifted": "down"}.get(key, KEYS[key] if key in PATHS else changed(KEYS[key]))
    study = load_study(STUDY, (f"{key}={json.dumps(wanted)}",))
    found: Any = study
    for name in key.split("."):
        found = getattr(found, name)
    assert found == wanted or list(found) == wanted or [list(v) for v in found] == wanted
    assert (wanted != KEYS[key]) or key in PATHS or key.endswith(".reason")


BAD = {
    "siso.pair_shift_percent=0": ("siso.pair_shift_percent", "> 0"),
    'siso.drifted="sideways"': ("siso.drifted", "down"),
    "sito.smaller_states=[10]": ("sito.smaller_bands_hz", "one each"),
    "sito.smaller_states=[10, 11, 16]": ("sito.smaller_states", "even"),
    "sito.smaller_bands_hz=[[20, 0.6], [0.1, 15], [0.1, 30]]": ("sito.smaller_bands_hz", "ascend"),
    "sito.angle_noise_rad_per_rthz=[1e-5]": ("sito.angle_noise_rad_per_rthz", "one each"),
    "control.metric_weights=[0, 0, 0, 0, 0]": ("control.metric_weights", "> 0"),
    "siso.periods=1": ("siso.periods", "2 to 1000"),
    'figure_6.outputs=["pri_in_z_rate"]': ("figure_6.outputs", "two rates"),
    'figure_6.outputs=["pri_in_z", "bus_z_rate"]': ("figure_6.outputs", "two rates"),
    'figure_6.outputs=["pri_in_z_rate", "bus_z_rate", "bus_x_rate"]': ("figure_6.outputs", "two rates"),
}


@pytest.mark.parametrize("override", BAD)
def test_what_no_stage_can_use_is_refused_with_its_key(override: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_study(STUDY, (override,))
    for words in BAD[override]:
        assert words in str(caught.value)


@pytest.mark.parametrize("kept", [8, 10])
def test_too_few_modes_are_refused_with_the_number_that_is_needed(kept: int) -> None:
    chapters = dict(run_chapters(load_study(STUDY, (f"control.modes_kept={kept}",))))
    with pytest.raises(ConfigError, match="no flexible one") as caught:
        chapters["figure 7"]()
    assert caught.value.where == "control.modes_kept"
    assert "at least 11" in caught.value.hint


PROGRAM = """
import sys
from middeck.files.json.output import json_text
from middeck.files.studies.documents import load_study
from middeck.study.mission import run_chapters, study_numbers
study = load_study(sys.argv[2], sys.argv[3:])
outcomes = {name: compute() for name, compute in run_chapters(study) if name not in sys.argv[1].split(",")}
sys.stdout.write(json_text(study_numbers(study, outcomes)))
"""


def test_another_process_computes_the_same_bytes(of) -> None:
    """Neither the order of sets nor the address of an array reaches the numbers."""
    left_out = "mirror,promise" if LONG else "mirror,promise,figure 7,figures 10 to 12"
    command = [sys.executable, "-c", PROGRAM, left_out, str(STUDY), *SHORT, *CASES["moon"]]
    another = subprocess.run(command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONHASHSEED": "7"})
    assert another.returncode == 0
    assert len(another.stdout) > (100_000 if LONG else 50_000)
    figures = json.loads(another.stdout)["figures"]
    alone = {"figure_4", "figure_5", "figure_6", "figure_9a", "figure_9b"}
    assert set(figures) == (set(of("moon").figures) if LONG else alone)
    assert figures == {key: of("moon").figures[key] for key in figures}
