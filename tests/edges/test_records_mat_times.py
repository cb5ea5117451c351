"""MAT files whose only rate is an array of times: even ones give it, others are refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import middeck as md
from middeck.errors import DataError
from middeck.files.records import read_record
from middeck.files.records.columns import name_columns
from middeck.files.records.mat import write_mat

K = np.arange(1500)


def written(folder: Path, **arrays: object) -> Path:
    rng = np.random.default_rng(3)
    plain = {"u": rng.standard_normal((len(K), 1)), "y": rng.standard_normal((len(K), 2))}
    scipy.io.savemat(folder / "run.mat", plain | arrays)
    return folder / "run.mat"


@pytest.mark.parametrize(
    ("times", "rate"),
    [
        (K / 256.0, 256.0),
        ((K / 256.0)[:, None], 256.0),
        (1.7e9 + K / 256.0, 256.0),
        (np.cumsum(np.full(len(K), 1e-3)), 1000.0),
        ((100.0 + K / 500.0).astype(np.float32), 500.0),
        (np.round(K / 256.0, 3), 256.0),
        (5.0 + K / 333.3, 333.3),
    ],
)
def test_even_times_give_the_rate(times: np.ndarray, rate: float, tmp_path: Path) -> None:
    assert md.load_record(written(tmp_path, t=times)).sample_hz == pytest.approx(rate, rel=1e-9)
    (warning,) = read_record(written(tmp_path, time=times)).faults
    assert (warning.severity, warning.kind) == ("note", "rate")
    assert f"give {rate:.9g} Hz" in warning.what
    assert read_record(written(tmp_path, t=times, fs=rate)).faults == ()


@pytest.mark.parametrize("times", [K, K / 4.0])
def test_slow_times_are_doubted(times: np.ndarray, tmp_path: Path) -> None:
    (warning,) = read_record(written(tmp_path, t=times)).faults
    assert warning.severity == "serious"


@pytest.mark.parametrize(
    ("reported", "message"),
    [
        ({"fs": 0.004}, r"fs = 0.004 means 0.004 Hz: if it is a period, it is 250 Hz"),
        ({"Ts": 250.0}, r"Ts = 250 means 0.004 Hz: if it is a rate, it is 250 Hz"),
        ({"run": {"u": K[:, None], "y": K[:, None], "Fs": 1e-3}}, r"run.Fs = 0.001 .* 1000 Hz"),
        ({"fs": 250.0}, ""),
        ({"Ts": 0.004}, ""),
        ({"Ts": 1.0}, ""),
    ],
)
def test_a_period_told_as_a_rate_is_doubted(
    reported: dict[str, object], message: str, tmp_path: Path
) -> None:
    path = written(tmp_path, **reported)
    if "run" in reported:
        scipy.io.savemat(path, reported)
    faults = read_record(path).faults
    assert [f.severity for f in faults] == (["serious"] if message else [])
    assert all(re.search(message, f.what) for f in faults)


@pytest.mark.parametrize("reported", [{"fs": 0.1}, {"Ts": 10.0}])
def test_a_slow_rate_that_the_times_confirm_is_not_doubted(
    reported: dict[str, object], tmp_path: Path
) -> None:
    assert read_record(written(tmp_path, t=10.0 * K, **reported)).faults == ()


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"t": np.where(K > 900, K + 1, K) / 256.0}, "not in even steps"),
        ({"t": (K + 0.2 * np.sin(K)) / 256.0}, "not in even steps"),
        ({"t": -K / 256.0}, "not in even steps"),
        ({"t": np.where(K == 5, np.nan, K / 256.0)}, "not in even steps"),
        ({"t": np.ones(len(K))}, "not in even steps"),
        ({"t": K / 256.0, "fs": 512.0}, "no one sampling rate: fs = 512, t for 256 Hz"),
        ({"t": K / 256.0, "Ts": 0.01}, "no one sampling rate: Ts = 0.01, t for 256 Hz"),
        ({"t": K[:-1] / 256.0}, "no sampling rate"),
        ({}, "no sampling rate"),
    ],
)
def test_others_are_refused(arrays: dict[str, np.ndarray], message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        md.load_record(written(tmp_path, **arrays))


def test_the_one_structure_with_u_and_y_is_the_run(tmp_path: Path) -> None:
    plain = scipy.io.loadmat(written(tmp_path, fs=256.0))
    run = {name: plain[name] for name in ("u", "y", "fs")}
    scipy.io.savemat(tmp_path / "one.mat", {"run": run, "note": {"who": "me"}})
    found = md.load_record(tmp_path / "one.mat")
    assert found == md.load_record(tmp_path / "run.mat")
    scipy.io.savemat(tmp_path / "two.mat", {"run": run, "again": run})
    with pytest.raises(DataError, match="6 variables"):
        md.load_record(tmp_path / "two.mat")
    scipy.io.savemat(tmp_path / "third.mat", {"run": run, "y": plain["y"]})
    with pytest.raises(DataError, match="4 variables"):
        md.load_record(tmp_path / "third.mat")


BESIDE: list[dict[str, object]] = [{"fs": 256.0}, {"Ts": 1.0 / 256.0}, {"t": K / 256.0}, {"sample_hz": 256.0}]


@pytest.mark.parametrize("beside", BESIDE)
def test_what_lies_beside_the_structure_is_read(beside: dict[str, object], tmp_path: Path) -> None:
    plain = scipy.io.loadmat(written(tmp_path))
    run: dict[str, object] = {name: plain[name] for name in ("u", "y")}
    file = tmp_path / "one.mat"
    for inner, outer in ((run, beside), (run | {"Fs": 256.0}, beside)):
        scipy.io.savemat(file, {"run": inner} | outer)
        assert md.load_record(file).sample_hz == pytest.approx(256.0, rel=1e-9)
        with pytest.raises(DataError, match="256"):
            md.load_record(file, name_columns(sample_hz=128.0))
    scipy.io.savemat(file, {"test": {"run": run} | beside})
    assert md.load_record(file).sample_hz == pytest.approx(256.0, rel=1e-9)
    scipy.io.savemat(file, {"run": run | {"fs": 100.0}} | beside)
    with pytest.raises(DataError, match=r"no one sampling rate: run\.fs = 100, "):
        md.load_record(file)


def test_a_rate_beside_a_record_of_the_own_layout_is_held_against_it(tmp_path: Path) -> None:
    write_mat(tmp_path / "own.mat", md.load_record(written(tmp_path, fs=256.0)))
    own = {k: x for k, x in scipy.io.loadmat(tmp_path / "own.mat").items() if not k.startswith("__")}
    scipy.io.savemat(tmp_path / "both.mat", {"run": own, "fs": 256.0})
    assert md.load_record(tmp_path / "both.mat").sample_hz == 256.0
    scipy.io.savemat(tmp_path / "both.mat", {"run": own, "fs": 100.0})
    with pytest.raises(DataError, match=r"no one sampling rate: run\.sample_hz = 256, fs = 100"):
        md.load_record(tmp_path / "both.mat")
