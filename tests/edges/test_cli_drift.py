"""``middeck drift``: the verdict, who moved, and what cannot be compared."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import identify_once, middeck
from middeck.files.records import write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

Capture = pytest.CaptureFixture[str]
HZ, SAMPLES, PERIODS = 64.0, 2048, 3
FIT = ("--states", 4, "--continuous", "--band", "0.5,16")


def write(
    path: Path, seed: int, *, moved: float = 1.0, output: str = "angle", periods: int = PERIODS
) -> Path:
    """Two modes of 1 %, 10 ms late, at 1 % noise; the second moved."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(SAMPLES, 1.0 / HZ)
    s = 2j * np.pi * f
    omega = 2.0 * np.pi * np.array([3.0, 9.35 * moved])
    modes = omega**2 / (s[:, None] ** 2 + 0.02 * omega * s[:, None] + omega**2)
    G = np.exp(-0.01 * s) * np.sum(modes, axis=1)
    lines = np.where((f > 0.3) & (f <= 20.0), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    u, y = (np.fft.irfft(x, n=SAMPLES)[None, None, :, None] for x in (lines, lines * G))
    u, y = np.repeat(u, periods, axis=1), np.repeat(y, periods, axis=1)
    y = y + 0.01 * y.std() * rng.standard_normal(y.shape)
    write_record(
        path,
        Record(
            sample_hz=HZ,
            u=u,
            y=y,
            inputs=(Port("torque", "N m"),),
            outputs=(Port(output, "rad"),),
            periodic=True,
        ),
    )
    return path


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A record is fitted once alike."""
    monkeypatch.setattr("middeck.cli.work.fit_records.identify", identify_once)


@pytest.fixture(scope="module")
def weeks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("weeks")
    return {
        "first": write(folder / "first.npz", 1),
        "same": write(folder / "same.npz", 2),
        "moved": write(folder / "moved.npz", 3, moved=1.003),
        "other": write(folder / "other.npz", 4, output="rate"),
        "once": write(folder / "once.npz", 5, periods=1),
    }


def test_nothing_moved(weeks: dict[str, Path], capfd: Capture) -> None:
    ended = middeck(capfd, "drift", weeks["first"], weeks["same"], *FIT, "--require")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith("no drift\nnone of 2 modes moved at the level 0.05\n")


def test_a_mode_that_moved_is_named(weeks: dict[str, Path], capfd: Capture) -> None:
    ask = ("drift", weeks["first"], weeks["moved"], *FIT)
    ended = middeck(capfd, *ask, "--json")
    assert (ended.code, ended.err) == (0, "")
    found = json.loads(ended.out)
    assert found["schema"] == "middeck.drift/1"
    assert found["drifted"] is True
    assert [m["moved"] for m in found["modes"]] == [False, True]
    mode = found["modes"][1]
    change = mode["frequency_hz"][1] - mode["frequency_hz"][0]
    # Within four deviations of what was done to it.
    assert change == pytest.approx(0.003 * 9.35, abs=4.0 * mode["frequency_std_hz"])
    assert "1 of 2 modes moved: 9.3" in found["sentence"]
    worst = max(found["bands"], key=lambda band: band["deviations"])
    assert worst["low_hz"] < 9.35 < worst["high_hz"]
    assert all(b["low_hz"] > 6.0 for b in found["bands"])
    text = middeck(capfd, *ask)
    assert text.out.startswith("drifted\n")
    assert middeck(capfd, *ask, "--require").code == 1


def test_small_numbers_and_single_lines_read_well() -> None:
    from middeck.cli.verbs.drift import _change, _probability
    from middeck.identification.uncertainty.fit_drift import ModeChange
    from middeck.identification.uncertainty.response_drift import MovedBand, ResponseDrift

    assert (_probability(1.2e-318), _probability(0.0), _probability(0.0123)) == (
        "< 1e-16",
        "< 1e-16",
        "0.012",
    )
    assert _change((2.0, 2.00000123), 1e-7) == ("+1.2e-06", "1.0e-07")
    move = ModeChange(
        before=0,
        after=0,
        frequency_hz=(2.0, 2.000002),
        frequency_std_hz=1e-7,
        damping=(0.01, 0.0100001),
        damping_std=1e-8,
        p_pole=1e-9,
        p_constants=0.5,
        moved=True,
        reshaped=False,
    )
    assert "(+0.0001%, 20.0 deviations)" in move.sentence
    assert "by +1e-05%" in move.sentence
    line = MovedBand(low_hz=11.44, high_hz=11.44, output="tip", input="force", deviations=5.0, change=0.1)
    found = ResponseDrift(
        frequency_hz=np.array([11.44]),
        statistic=np.ones((1, 1, 1)),
        inflation=1.0,
        moved=np.ones((1, 1, 1), bool),
        bands=(line,),
        level=0.05,
    )
    assert found.sentence.startswith("the response moved at 11.44 Hz (tip from force by 10.0%")


def test_a_change_that_only_the_responses_show_is_reported_in_one_line() -> None:
    from middeck.cli.verbs.drift import _verdict

    document = {
        "drifted": True, "modes": (), "delays": (),
        "sentence": "none of 2 modes moved at the level 0.05",
        "response_sentence": "the response moved at 11.44 Hz",
    }  # fmt: skip
    message = "drifted: the response moved at 11.44 Hz, although none of 2 modes moved at the level 0.05"
    assert _verdict(document) == [message]


def test_a_record_against_a_model(weeks: dict[str, Path], tmp_path: Path, capfd: Capture) -> None:
    model = tmp_path / "model.json"
    assert middeck(capfd, "identify", weeks["first"], *FIT, "-o", model).code == 0
    against = {}
    for week, drifted in (("same", False), ("moved", True)):
        found = json.loads(middeck(capfd, "drift", model, weeks[week], "--band", "0.5,16", "--json").out)
        assert found["drifted"] is drifted
        assert found["bands"] is None
        assert not any("exact" in w for w in found["warnings"])
        against[week] = found
    # The file tells all that the record tells of the fit.
    from_record = middeck(capfd, "drift", weeks["first"], weeks["same"], *FIT, "--json").out
    assert against["same"]["modes"] == json.loads(from_record)["modes"]


def test_a_model_without_covariance_is_reported_as_taken_for_exact(
    weeks: dict[str, Path], tmp_path: Path, capfd: Capture
) -> None:
    model = tmp_path / "model.json"
    assert middeck(capfd, "identify", weeks["first"], *FIT, "-o", model).code == 0
    document = json.loads(model.read_text())
    del document["covariance"]
    model.write_text(json.dumps(document))
    ended = middeck(capfd, "drift", model, weeks["moved"], "--band", "0.5,16", "--json")
    found = json.loads(ended.out)
    assert found["drifted"] is True
    assert found["warnings"][-1].startswith(f"{model}: the model has no covariance and is taken as exact")
    # Its deviations are those of the record's fit alone.
    assert found["modes"][0]["frequency_std_hz"] > 0.0


def test_records_of_other_channels(weeks: dict[str, Path], capfd: Capture) -> None:
    ended = middeck(capfd, "drift", weeks["first"], weeks["other"], *FIT)
    assert (ended.code, ended.out) == (2, "")
    assert "the outputs differ: angle [rad] and rate [rad]" in ended.err
    assert str(weeks["other"]) in ended.err


def test_a_record_of_one_period_is_compared_by_its_fit_alone(weeks: dict[str, Path], capfd: Capture) -> None:
    found = json.loads(middeck(capfd, "drift", weeks["first"], weeks["once"], *FIT, "--json").out)
    assert found["bands"] is None
    assert found["response_sentence"] is None
    assert any("one period" in w for w in found["warnings"])


def test_levels_and_files_that_are_none(weeks: dict[str, Path], capfd: Capture) -> None:
    assert middeck(capfd, "drift", weeks["first"], weeks["same"], "--level", 1.0).code == 2
    assert middeck(capfd, "drift", weeks["first"], "nowhere.npz").code in (2, 4)
