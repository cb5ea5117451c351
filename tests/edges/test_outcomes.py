"""Outcomes beside promises: modes are paired by shape, by name, or, where nothing else came, by number."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck
from middeck.errors import DataError
from middeck.files.disk.digest import sha256_of
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.measured.modes import load_measured_modes, write_measured_modes
from middeck.files.promises.outcomes import comparison_document, load_outcomes, promised_modes_of
from middeck.files.promises.promise_file import read_promise
from middeck.structure.correlation.measured_modes import MeasuredModes

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "data/virtual-survey"
PROMISE = FOLDER / "promise.json"
SHAPES = FOLDER / "mace-simple-orbit.json"
FROZEN = [
    path
    for path in sorted((ROOT / "promises").glob("*.json"))
    if json.loads(path.read_text())["date"] == "2026-11-23"
]
HEAD = 'schema = "middeck.outcome/1"\n'


def compared(folder: Path, text: str, promise: Path = PROMISE) -> dict:
    """The comparison of an outcome with this text."""
    (folder / "outcome.toml").write_text(HEAD + text, encoding="utf-8")
    return comparison_document(
        read_promise(promise), load_outcomes(folder / "outcome.toml"), date="2026-11-23"
    )


def mode(hz: float, **keys: object) -> str:
    message = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    return f'[[mode]]\nenvironment = "orbit"\nfrequency_hz = {hz}\n{message}'


def crossed() -> MeasuredModes:
    """The first two modes have changed places: what was promised of each is wrong, by its shape."""
    seen = load_measured_modes(SHAPES)
    shape = np.array(seen.shape)
    shape[:, [0, 1]] = shape[:, [1, 0]]
    return MeasuredModes(
        frequency_hz=seen.frequency_hz, damping=seen.damping, node=seen.node, direction=seen.direction,
        shape=shape,
    )  # fmt: skip


def survey(folder: Path, measured: MeasuredModes) -> str:
    write_measured_modes(folder / "flown.json", measured)
    return '[[survey]]\nenvironment = "orbit"\nmodes = "flown.json"\n'


def test_modes_in_another_order_are_compared_by_shape(tmp_path: Path):
    """In whatever order a survey lists them."""
    seen = load_measured_modes(SHAPES)
    turned = MeasuredModes(
        frequency_hz=seen.frequency_hz[::-1], damping=seen.damping, node=seen.node[::-1],
        direction=seen.direction[::-1], shape=-3.0 * seen.shape[::-1, ::-1],
    )  # fmt: skip
    found = compared(tmp_path, survey(tmp_path, turned))
    assert [v["name"] for v in found["verdicts"]] == [f"orbit: mode {k}" for k in range(1, 9)]
    assert all(v["inside"] and v["paired_by"] == "shape" and not v["open"] for v in found["verdicts"])
    assert min(v["mac"] for v in found["verdicts"]) > 0.99
    assert found["remarks"] == []
    assert [file["name"] for file in found["surveys"]] == ["flown.json"]


def test_a_survey_in_rad_per_s_is_reported(tmp_path: Path):
    """The frequencies of eight shapes are 2 pi times those that were promised."""
    seen = load_measured_modes(SHAPES)
    wrong = dataclasses.replace(seen, frequency_hz=2.0 * np.pi * seen.frequency_hz)
    assert any("rad/s in place of Hz" in r for r in compared(tmp_path, survey(tmp_path, wrong))["remarks"])


def test_modes_that_cross_are_each_judged_by_what_was_said_of_their_shape(tmp_path: Path):
    found = compared(tmp_path, survey(tmp_path, crossed()))
    first, second, *others = found["verdicts"]
    assert (first["mode"], first["value"]) == ("first bending x-y", pytest.approx(1.7591, abs=1e-4))
    assert (second["mode"], second["value"]) == ("first bending x-z", pytest.approx(1.6937, abs=1e-4))
    assert not first["inside"]
    assert not second["inside"]
    assert all(v["inside"] for v in others)


def test_modes_that_cross_are_found_by_name(tmp_path: Path):
    """Whatever their order in the file, and in frequency; by number alone it is said that this is open."""
    text = mode(1.7579, name="first bending x-z") + mode(1.6923, name="first bending x-y")
    found = compared(tmp_path, text)
    assert [(v["name"], v["inside"], v["open"]) for v in found["verdicts"]] == [
        ("orbit: mode 2", True, False), ("orbit: mode 1", True, False),
    ]  # fmt: skip
    by_number = compared(tmp_path, mode(1.7579, number=1) + mode(1.6923, number=2))
    assert [(v["inside"], v["open"]) for v in by_number["verdicts"]] == [(False, True)] * 2
    assert (
        "by its number alone; it lies within the interval of mode 2 (first bending x-z)"
        in (by_number["remarks"][0])
    )
    assert compared(tmp_path, mode(1.6923, number=1))["remarks"] == []


def test_numbers_of_modes_whose_intervals_overlap_are_open(tmp_path: Path):
    """The fifth and the sixth of GARTEUR from three: 31.6 to 34.8 Hz holds 33.0 to 33.3 Hz."""
    text = mode(33.1, number=5).replace("orbit", "bungees")
    found = compared(tmp_path, text, ROOT / "promises/garteur-from-three.json")
    assert found["verdicts"][0]["open"]
    assert "mode 6 (local: wing, torsion 2)" in found["remarks"][0]
    named = text + 'name = "local: wing, torsion"\n'
    assert not compared(tmp_path, named, ROOT / "promises/garteur-from-three.json")["verdicts"][0]["open"]


def test_shapes_that_few_channels_do_not_distinguish_are_open(tmp_path: Path):
    seen = load_measured_modes(SHAPES)
    one = seen.channels.index("n3 y"), seen.channels.index("n1 y")
    few = MeasuredModes(
        frequency_hz=[1.7, 30.0], damping=[0.01, 0.01], node=("n3", "n1", "n9"), direction=("y", "y", "z"),
        shape=np.vstack([seen.shape[list(one)][:, :1] @ [[1.0, 1.0]], [[0.1, 0.1]]]),
    )  # fmt: skip
    found = compared(tmp_path, survey(tmp_path, few))
    (verdict,) = found["verdicts"]
    assert verdict["open"]
    message = "\n".join(found["remarks"])
    assert "2 of 3 channels of the survey are in the promise" in message
    assert "30 Hz resembles none that was promised" in message
    assert "which mode it is stays open" in message


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (mode(1.7, name="first"), "no mode 'first' was promised"),
        (mode(1.7, number=99), "the promise has no mode 99"),
        (mode(1.7, number=1, name="first torsion"), "mode 1 of the promise is 'first bending x-y'"),
        (mode(1.7, number=1).replace("orbit", "moon"), "the promise has no environment 'moon'"),
        (mode(1.7, number=1) + mode(1.7, name="first bending x-y"), "two outcomes of mode 'orbit: mode 1'"),
    ],
)
def test_a_mode_that_was_not_promised_is_refused(tmp_path: Path, text: str, what: str):
    with pytest.raises(DataError, match=what):
        compared(tmp_path, text)


def test_a_survey_without_a_channel_in_common_is_refused(tmp_path: Path):
    seen = load_measured_modes(SHAPES)
    numbered = MeasuredModes(
        frequency_hz=seen.frequency_hz, damping=seen.damping, shape=seen.shape, direction=seen.direction,
        node=tuple(str(k) for k in range(len(seen.node))),
    )  # fmt: skip
    with pytest.raises(DataError, match="no channel of the survey is in the promise"):
        compared(tmp_path, survey(tmp_path, numbered))
    bare = MeasuredModes(frequency_hz=[1.7], damping=[0.01], node=(), direction=(), shape=np.zeros((0, 1)))
    with pytest.raises(DataError, match="the survey has no shapes"):
        compared(tmp_path, survey(tmp_path, bare))


def test_files_that_are_no_longer_what_was_promised_on_are_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    """Beside the promise of the repository none; beside a copy with a survey that was measured anew this."""
    message = middeck(capfd, "outcome", PROMISE, FOLDER / "outcome.toml", "--json").out
    assert json.loads(message)["remarks"] == []
    for name in ("promise.json", "outcome.toml", "refine.toml", SHAPES.name, "mace-simple-lab.json"):
        (tmp_path / name).write_bytes((FOLDER / name).read_bytes())
    seen = load_measured_modes(FOLDER / "mace-simple-lab.json")
    write_measured_modes(
        tmp_path / "mace-simple-lab.json", dataclasses.replace(seen, frequency_hz=1.001 * seen.frequency_hz)
    )
    message = middeck(capfd, "outcome", tmp_path / "promise.json", tmp_path / "outcome.toml", "--json").out
    (remark,) = json.loads(message)["remarks"]
    assert remark.startswith("mace-simple-lab.json beside the promise is not the file that it was made of")
    promise = tmp_path / "promise.json"
    body = {k: v for k, v in json.loads(promise.read_text()).items() if k != SEAL}
    twin = {"name": "mace-simple-lab.json", "sha256": sha256_of(tmp_path / "mace-simple-lab.json")}
    promise.write_text(json.dumps(seal(body | {"files": [*body["files"], twin]})))  # of another folder
    message = middeck(capfd, "outcome", promise, tmp_path / "outcome.toml", "--json").out
    assert json.loads(message)["remarks"] == []


def test_two_files_of_one_name_are_known_by_either_hash(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """Surveys of two tests have one name in folders of their own; one of them lies beside the promise."""
    for name in ("outcome.toml", SHAPES.name, "mace-simple-lab.json"):
        (tmp_path / name).write_bytes((FOLDER / name).read_bytes())
    message = {k: v for k, v in json.loads(Path(PROMISE).read_text()).items() if k != SEAL}
    other = {"name": "mace-simple-lab.json", "sha256": "0" * 64}
    (tmp_path / "promise.json").write_text(json.dumps(seal(message | {"files": [*message["files"], other]})))
    asked = "outcome", tmp_path / "promise.json", tmp_path / "outcome.toml", "--json"
    assert json.loads(middeck(capfd, *asked).out)["remarks"] == []


@pytest.mark.parametrize("frozen", FROZEN, ids=lambda path: path.stem)
def test_documents_older_than_shapes_are_read(tmp_path: Path, frozen: Path):
    promise = read_promise(frozen)
    (place,) = promised_modes_of(promise).values()
    assert place.shape is None
    asked = survey(tmp_path, load_measured_modes(SHAPES)).replace('"orbit"', f'"{place.environment}"')
    with pytest.raises(DataError, match="no shapes to compare a survey with"):
        compared(tmp_path, asked, frozen)
    if place.name:
        text = mode(float(place.frequency_hz[0]), name=place.name[0]).replace("orbit", place.environment)
        assert compared(tmp_path, text, frozen)["verdicts"][0]["inside"]


def test_the_verb_says_by_what_modes_were_paired(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    message = middeck(capfd, "outcome", PROMISE, FOLDER / "outcome.toml").out
    assert "orbit: mode 1, first bending x-y" in message
    assert "shape, MAC 1.00" in message
    (tmp_path / "outcome.toml").write_text(HEAD + mode(1.7579, number=1), encoding="utf-8")
    message = middeck(capfd, "outcome", PROMISE, tmp_path / "outcome.toml").out
    assert "number: open" in message
    assert "which mode it is stays open" in message
