"""Responses of surveys in refinement files: universal files and fitted models, and what cannot be."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import middeck
from coarse_articles import coarse
from middeck.errors import ConfigError, DataError
from middeck.files.records import load_response, write_response
from middeck.files.refinements.documents import load_refinement
from middeck.files.setups import load_setup
from middeck.signals.ports import Port
from middeck.structure.sensitivity.parameters import scale_parameters
from middeck.systems.plants.plant import delay_plant
from middeck.systems.plants.response import FrequencyResponse, evaluate_plant

ROOT = Path(__file__).parents[2]
ARTICLE = coarse("mace-simple")
SURVEY = ROOT / "data/virtual-survey"
LATE_S, LOUD = 0.0113, 0.01
HEARD = """
[survey.response]
file = "heard.unv"
relative_std = 0.005
delay_s = 0.010
band_hz = [0.8, 12.0]
"""
LOOP = """
[[unknown]]
name = "delay"
parameters = ["loop.delay_s"]
added = true
spread = 0.001

[[unknown]]
name = "gain"
parameters = ["loop.sensor_gain.pri_in_z"]
spread = 0.02
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample, with the response of the article that its survey was simulated with, delayed and louder."""
    found = tmp_path_factory.mktemp("responses")
    (found / "mace-simple-lab.json").write_bytes((SURVEY / "mace-simple-lab.json").read_bytes())
    article, lab = load_setup(ARTICLE, ROOT / "environments/lab.toml")
    true = scale_parameters(article, {"members.E": 1.038, "node.n3.mass": 1.022})
    modes = md.solve_modes(md.solve_equilibrium(true, lab))
    plant = md.build_plant(modes, inputs=("pri_rel_z",), outputs=("pri_in_z", "pri_rel_z"), count=40)
    clean = evaluate_plant(delay_plant(plant, LATE_S), np.arange(0.5, 20.0, 0.02))
    rng, H = np.random.default_rng(3), clean.H * np.array([np.exp(LOUD), 1.0])[None, :, None]
    noise = 0.005 / np.sqrt(2.0) * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape))
    write_response(found / "heard.unv", dataclasses.replace(clean, H=H * (1.0 + noise)))
    return found


def written(folder: Path, survey: str, loop: str = LOOP) -> Path:
    """The sample's refinement, with a response of its survey and unknowns of the loop."""
    text = (SURVEY / "refine.toml").read_text(encoding="utf-8")
    head, unknown, rest = text.partition("[[unknown]]")
    file = folder / "refine.toml"
    file.write_text(head + survey + "\n" + unknown + rest + loop, encoding="utf-8")
    return file


def test_delay_and_gain_come_out_of_a_file(folder: Path, capfd: pytest.CaptureFixture[str]):
    ended = middeck(capfd, "refine", ARTICLE, written(folder, HEARD), "--json")
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    named = {u["name"]: u for u in found["unknowns"]}
    for name, true in (("delay", LATE_S - 0.010), ("gain", LOUD)):
        assert abs(named[name]["x"] - true) < 3.0 * named[name]["std"]
    assert named["delay"]["std"] < 5e-5
    assert named["gain"]["std"] < 0.012
    (measured,) = found["responses"]
    assert measured["lines"] > 300
    assert measured["miss"] < 1.5
    assert set(found["not_in_the_article"]) >= {"delay", "gain"}
    assert any(path.name == "heard.unv" for path in load_refinement(folder / "refine.toml", ARTICLE).files)


def test_anti_resonances_stand_by_themselves(folder: Path):
    zero = '[[survey.anti_resonance]]\ninput = "pri_rel_z"\noutput = "bus_z"\n'
    zero += "frequency_hz = 4.0\nstd_hz = 0.01\n"
    (survey,) = load_refinement(written(folder, zero, ""), ARTICLE).surveys
    assert survey.response is not None
    assert survey.response.ports == (("pri_rel_z",), ("bus_z",))
    assert survey.response.top_hz == 4.0
    assert load_refinement(written(folder, "", ""), ARTICLE).surveys[0].response is None


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("relative_std = 0.005", "", "holds no standard deviation"),
        ("heard.unv", "none.unv", "none.unv"),
        ("relative_std = 0.005", "relative_std = 0.0", "must be > 0"),
        ("band_hz = [0.8, 12.0]", "band_hz = [12.0, 0.8]", "low < high"),
        ("band_hz", "bands_hz", "did you mean 'band_hz'"),
    ],
)
def test_a_response_that_cannot_be_is_refused(folder: Path, old: str, new: str, what: str):
    with pytest.raises((ConfigError, DataError), match=what):
        load_refinement(written(folder, HEARD.replace(old, new)), ARTICLE)


def test_a_loop_without_a_response_is_refused(folder: Path, capfd: pytest.CaptureFixture[str]):
    ended = middeck(capfd, "refine", ARTICLE, written(folder, ""))
    assert ended.code == ConfigError.exit_code
    assert "has a parameter loop.delay_s" in ended.err


def test_what_a_universal_file_does_not_keep_is_told(tmp_path: Path) -> None:
    """Read again, one with a bias is sound; a hold, without which half a period is in the delay, is kept."""
    f = np.arange(1.0, 9.0)
    port = (Port("u", "V"),)
    response = FrequencyResponse(frequency_hz=f, H=np.ones((8, 1, 1), complex), inputs=port, outputs=port)
    write_response(tmp_path / "plain.unv", response)
    for known in ({"hold_s": 0.01}, {"hold_s": 0.0}, {"perhaps_held_s": 1.0 / 1024.0}, {}):
        held = dataclasses.replace(response, **known, frequency_hz=f / 3.0)
        write_response(tmp_path / "held.unv", held)
        read = load_response(tmp_path / "held.unv")
        assert (read.hold_s, read.perhaps_held_s) == (held.hold_s, held.perhaps_held_s)
    odd = dataclasses.replace(response, hold_s=1.0 / 1023.4567891, frequency_hz=f / 3.0 + 0.0123456789012)
    with pytest.warns(UserWarning, match=r"inputs were held.* set hold_s=0.0009"):
        write_response(tmp_path / "held.unv", odd)
    assert np.allclose(load_response(tmp_path / "held.unv").frequency_hz, odd.frequency_hz, rtol=1e-15)
    with pytest.warns(UserWarning, match="does not keep a warning on the response: it clips"):
        write_response(tmp_path / "wrong.unv", dataclasses.replace(response, warnings=("it clips",)))
