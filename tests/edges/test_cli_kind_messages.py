"""Messages that name what was typed: empty names, folders that take no file, options without an effect."""

from __future__ import annotations

import shutil
from pathlib import Path

import click
import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from middeck.cli.app import VERBS, app
from middeck.errors import ConfigError, DataError
from middeck.files.records import load_campaign, load_record, read_record

Capture = pytest.CaptureFixture[str]
ARTICLE = ROOT / "articles/mace-dm.toml"


def refused(capfd: Capture, *arguments: object) -> str:
    ended = middeck(capfd, *arguments)
    assert ended.code in (2, 4), ended
    assert ended.out == ""
    assert ended.err.startswith("error: ")
    assert "  try: " in ended.err
    return ended.err


def arguments_of(verb: str) -> list[click.Argument]:
    command = app.get_command(click.Context(app), verb)
    assert command is not None
    return [p for p in command.params if isinstance(p, click.Argument)]


@pytest.mark.parametrize("verb", [v for v in VERBS if v not in ("doctor", "excite", "new")])
def test_an_empty_argument_is_no_folder(capfd: Capture, verb: str) -> None:
    """As a variable without a value leaves it; the path of nothing is the current folder."""
    empty = [""] * max(1, sum(a.nargs == 1 for a in arguments_of(verb)))
    required = {
        "study": ["-o", "x"],
        "level": ["--free", "n1.z"],
        "sensitivity": ["--parameter", "*"],
        "response": ["--input", "a", "--output", "b", "--at", "1"],
    }
    extra = ["law.mdk"] if verb in ("qualify", "gate") else []
    reported = refused(capfd, verb, *empty, *extra, *required.get(verb, []))
    assert "the text is empty" in reported


def results_of() -> list[tuple[str, str]]:
    """Each option of each verb that names a file to write."""
    from middeck.cli.options import OutputOption

    found = []
    for verb in VERBS:
        command = app.get_command(click.Context(app), verb)
        assert command is not None
        found += [(verb, p.opts[0]) for p in command.params if isinstance(p, OutputOption)]
    return found


@pytest.mark.parametrize(
    ("name", "says"), [("", "the text is empty"), ("a/b.json", "no such folder: .* is a file")]
)
def test_a_result_without_a_place(tmp_path: Path, name: str, says: str) -> None:
    from middeck.cli.options import require_writable

    (tmp_path / "a").touch()
    assert len(results_of()) > 20
    path = f"{tmp_path}/{name}" if name else name
    with pytest.raises(ConfigError, match=says):
        require_writable(path, (".json",), "-o")


def test_a_folder_that_takes_no_file_is_refused_before_any_work(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def locked(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", locked)
    monkeypatch.setattr("middeck.cli.given.typed_article.solve_modes", pytest.fail)
    for option, file in (("-o", "shapes.unv"), ("--figure", "modes.svg")):
        message = refused(capfd, "modes", ARTICLE, option, tmp_path / file)
        assert f"{option} {tmp_path / file}: Permission denied: no file" in message
    message = refused(capfd, "study", ROOT / "studies/mace-1993.toml", "-o", tmp_path / "out")
    assert "Permission denied" in message
    assert not list(tmp_path.iterdir())


def test_a_study_fills_no_folder_below_a_file(tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "taken").touch()
    message = refused(capfd, "study", ROOT / "studies/mace-1993.toml", "-o", tmp_path / "taken" / "out")
    assert f"no such folder: {tmp_path / 'taken'} is a file" in message


def test_names_of_a_command_are_counted_before_it_is_designed(
    capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("middeck.cli.work.design_excitation.design", pytest.fail)
    given = ("multisine", "--band", "1,9", "--period", 4, "--rate", 100, "--peak", 1)
    assert "--name: 2 names for 1 inputs" in refused(capfd, "excite", *given, "--name", "a,b")


def test_a_study_fills_no_folder_without_a_name(capfd: Capture) -> None:
    assert "-o: no name of a file" in refused(capfd, "study", ROOT / "studies/mace-1993.toml", "-o", "")


@pytest.mark.parametrize(
    "typed", [("--states", 4), ("--fit-band", "1,2"), ("--periods", 3), ("--pade-order", 3)]
)
def test_an_option_for_records_is_not_ignored_with_an_article(
    capfd: Capture, typed: tuple[object, ...]
) -> None:
    message = refused(capfd, "design", ARTICLE, *typed)
    kinds = "a fitted model or a record" if typed[0] == "--pade-order" else "a record"
    assert f"{typed[0]} is for {kinds}\n" in message


@pytest.mark.parametrize("typed", [("--states", 4), ("--fit-band", "1,2"), ("--periods", 3)])
def test_an_option_of_fits_is_not_ignored_with_a_model_that_is_fitted(
    capfd: Capture, typed: tuple[object, ...]
) -> None:
    assert f"{typed[0]} is for a record\n" in refused(capfd, "design", "model.json", *typed)


@pytest.mark.parametrize("typed", ["states=4", "sampled=true"])
def test_keys_of_fits_are_not_ignored_with_a_model_that_is_fitted(capfd: Capture, typed: str) -> None:
    message = refused(capfd, "design", "model.json", "--set", typed)
    assert f"--set {typed.partition('=')[0]} is for a record" in message


@pytest.mark.parametrize("typed", [("--environment", "orbit"), ("--count", 4), ("--load-case", "a")])
def test_models_that_are_qualified_have_no_environment(
    tmp_path: Path, capfd: Capture, typed: tuple[object, ...]
) -> None:
    md.write(tmp_path / "model.json", one_mode())
    zero = md.systems.StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
    law = md.Compensator(
        dynamics=zero, inputs=(md.Port("angle", "rad"),), outputs=(md.Port("torque", "N m"),)
    )
    md.write(tmp_path / "law.json", law)
    message = refused(capfd, "qualify", tmp_path / "law.json", tmp_path / "model.json", *typed)
    assert f"{typed[0]} is for articles and environments" in message


@pytest.mark.parametrize("typed", [("--environment", "orbit"), ("--count", 4), ("--load-case", "a")])
def test_an_option_for_articles_is_not_ignored_with_a_model(
    capfd: Capture, typed: tuple[object, ...]
) -> None:
    assert f"{typed[0]} is for an article" in refused(capfd, "design", "model.json", *typed)


@pytest.mark.parametrize(
    ("verb", "flag", "more"),
    [
        ("refine a b", "--choose", ("-o", "refined.toml")),
        ("refine a b", "--choose", ("--predict", "lab")),
        ("refine a b", "--choose", ("--count", 3)),
        ("record a", "--stream", ("--require",)),
        ("record a", "--stream", ("--periods", 2)),
        ("record a", "--stream", ("--reference", "m.json")),
        ("gate p a", "--paper", ("--share", 0.5)),
        ("gate p a", "--paper", ("--noise", 0.1)),
    ],
)
def test_an_option_without_an_effect_beside_a_flag_is_not_ignored(
    capfd: Capture, verb: str, flag: str, more: tuple[object, ...]
) -> None:
    message = refused(capfd, *verb.split(), flag, *more)
    assert f"{more[0]} has no effect beside {flag}" in message


def test_names_that_are_not_there(tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    message = refused(capfd, "design", ARTICLE, "--control", "torque", "--measure", "pri_in_z")
    assert f"{ARTICLE}: no actuator 'torque'" in message
    message = refused(capfd, "response", ARTICLE, "--input", "", "--output", "bus_z", "--at", 1)
    assert message.startswith("error: --input: an option that takes names has none")
    alone = shutil.copy(ARTICLE, tmp_path)
    message = refused(capfd, "modes", alone, "--set", "no.such=1")
    assert "not in" in message
    assert "environment 'lab'" in message


@pytest.mark.parametrize("name", ["bus.toml", "parts/bus"])
def test_a_path_that_is_not_there(capfd: Capture, name: str) -> None:
    assert "check the path" in refused(capfd, "modes", name)
    assert "check the path; one of lab, orbit" in refused(capfd, "modes", ARTICLE, "--environment", name)


def test_the_document_that_is_wrong_is_named_alone(tmp_path: Path, capfd: Capture) -> None:
    empty = tmp_path / "empty.toml"
    empty.touch()
    message = refused(capfd, "promise", empty, ROOT / "data/virtual-survey/promise.toml")
    assert message.startswith(f"error: {empty}:1: the file is empty")


def test_a_picture_is_no_deck(tmp_path: Path, capfd: Capture) -> None:
    picture = tmp_path / "truss.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR")
    message = refused(capfd, "convert", picture, "--units", "m-kg-s-N", "-o", tmp_path / "a.toml")
    assert "looks like a binary file, not a Nastran deck" in message


# records


def write_csv(path: Path, head: str, times: list[str], seed: int = 0) -> Path:
    values = np.random.default_rng(seed).normal(size=(len(times), 2))
    rows = [f"{t},{u:.6g},{y:.6g}" for t, (u, y) in zip(times, values, strict=True)]
    path.write_text(f"{head},u:torque [N m],y:angle [rad]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


HEADS = {
    **dict.fromkeys(
        ("time_s", "t_s", "Time_sec", "timestamp", "unix_time", "elapsed time", "time [sec]"), 1.0
    ),
    "time_ms": 1e-3,
    "TIME_US": 1e-6,
}


@pytest.mark.parametrize(("head", "unit"), HEADS.items())
def test_headings_of_times(tmp_path: Path, head: str, unit: float) -> None:
    times = [f"{0.01 * k / unit:.6f}" for k in range(200)]
    assert load_record(write_csv(tmp_path / "run.csv", head, times)).sample_hz == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("step", "first", "doubted"),
    [(1, 1_700_000_000, False), (50, 1_700_000_000, False), (1, 0, True), (10, 1_700_000_000_000, True)],
)
def test_seconds_since_1970_count_no_lines(tmp_path: Path, step: int, first: int, doubted: bool) -> None:
    path = write_csv(tmp_path / "run.csv", "time", [str(first + step * k) for k in range(200)])
    found = read_record(path)
    assert found.record.sample_hz == pytest.approx(1.0 / step)
    assert any(f.kind == "rate" for f in found.faults) == doubted


@pytest.mark.parametrize("step", [100, 1000])
def test_ticks_of_a_counter_are_no_seconds_since_1970(tmp_path: Path, step: int) -> None:
    """Microseconds of 32 bits count to 4.3e9: three quarters of them are in that range, read as minutes."""
    path = write_csv(tmp_path / "run.csv", "time", [str(1_200_000_000 + step * k) for k in range(200)])
    assert any(f.kind == "rate" and f.severity == "serious" for f in read_record(path).faults)


def test_seconds_since_1970_are_reported_with_their_day(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", "time", [str(1_300_000_000 + 10 * k) for k in range(200)])
    (note,) = (f for f in read_record(path).faults if f.kind == "format")
    assert "from 2011-03-13 on, at 0.1 Hz" in note.what


@pytest.mark.parametrize("stamp", ["2026-11-29T06:00:0{}", "06:00:0{}", "29.11.2026 06:00:0{}"])
def test_a_date_is_no_number(tmp_path: Path, stamp: str) -> None:
    path = write_csv(tmp_path / "run.csv", "time", [stamp.format(k) for k in range(9)])
    with pytest.raises(DataError, match=r"run\.csv:2: .* is a date or a clock time\n  try: times as seconds"):
        load_record(path)


@pytest.mark.parametrize("verb", ["identify", "record"])
def test_the_file_whose_input_does_not_repeat(tmp_path: Path, capfd: Capture, verb: str) -> None:
    times = [f"{0.01 * k:.2f}" for k in range(200)]
    good, bad = (
        write_csv(tmp_path / f"{n}.csv", "time [s]", times, k) for k, n in enumerate(("good", "bad"))
    )
    table = load_record(good)
    twice = np.concatenate([table.u[0, 0, :100], table.u[0, 0, :100]])[:, 0]
    rows = [f"{t},{u:.6g},{y:.6g}" for t, u, y in zip(times, twice, twice, strict=True)]
    good.write_text("time [s],u:torque [N m],y:angle [rad]\n" + "\n".join(rows) + "\n")
    message = refused(capfd, verb, good, bad, "--periods", 2)
    assert message.startswith(f"error: {bad}, input torque, experiment 0: the input does not repeat")


def test_unlike_records_in_words(tmp_path: Path, capfd: Capture) -> None:
    times = [f"{0.01 * k:.2f}" for k in range(200)]
    whole, cut = (
        write_csv(tmp_path / "a.csv", "time", times),
        write_csv(tmp_path / "b.csv", "time", times[:99]),
    )
    message = refused(capfd, "record", whole, cut)
    assert (
        f"{cut}: mismatched periods and samples: 99 samples, in {whole} 200 samples\n  try: cut them alike"
        in message
    )


def test_a_record_has_not_drifted_from_itself(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    u, y = np.random.default_rng(0).normal(size=400), np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.9 * y[k - 1] + u[k - 1]
    rows = [f"{0.01 * k:.2f},{a:.6g},{b:.6g}" for k, (a, b) in enumerate(zip(u, y, strict=True))]
    path.write_text("time_s,u:torque [N m],y:angle [rad]\n" + "\n".join(rows) + "\n")
    monkeypatch.setattr("middeck.cli.work.fit_records.identify", pytest.fail)
    message = refused(capfd, "drift", path, tmp_path / "." / "a.csv", "--states", 1, "--sampled")
    assert "the same record twice" in message


# in Python


def one_mode() -> md.MeasurementModel:
    zero = np.zeros((1, 1))
    return md.MeasurementModel(
        poles=np.array([-0.1 + 6j]),
        shapes=np.array([[-0.5j]]),
        participation=np.array([[1.0]]),
        direct=zero,
        lower=zero,
        delay_s=np.zeros(1),
        inputs=(md.Port("torque", "N m"),),
        outputs=(md.Port("angle", "rad"),),
    )


def test_swapped_arguments_of_write(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^write: a MeasurementModel stands where the path belongs"):
        md.write(one_mode(), tmp_path / "model.json")  # ty: ignore[invalid-argument-type]


@pytest.mark.parametrize("ending", [".toml", ".txt", ""])
def test_a_model_is_written_as_json_or_mat_only(tmp_path: Path, ending: str) -> None:
    with pytest.raises(ConfigError, match=r"no writer for a MeasurementModel .*\n  try: name it \.json or"):
        md.write(tmp_path / f"model{ending}", one_mode())
    assert not list(tmp_path.iterdir())


def test_one_path_is_a_campaign_of_one(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", "time_s", [f"{0.01 * k:.2f}" for k in range(99)])
    assert len(load_campaign(str(path)).records) == 1
    with pytest.raises(DataError, match=r"none\.csv: no such file"):
        load_campaign(str(tmp_path / "none.csv"))
