"""``middeck record``: what it shows, judges and converts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from cli_runner import middeck
from middeck.files.models import write_model
from middeck.files.records import load_record, write_record
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.spectra import estimate_response
from middeck.systems.ports import Channel, Port
from middeck.systems.record import Record

Capture = pytest.CaptureFixture[str]
TIP = Port("tip", "m", Channel("12", "+z", "sensor", 9.81, "V", "2026-01-31"))


def bench() -> Record:
    """One mode under a multisine, two periods, a per mille of noise."""
    rng = np.random.default_rng(2)
    f = np.fft.rfftfreq(1024, 1.0 / 64.0)
    s = 2j * np.pi * f
    U = np.where((f > 0) & (f < 20.0), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    u, y = (
        np.fft.irfft(x)[None, None, :, None].repeat(2, 1) for x in (U, U * 900.0 / (s**2 + 3.0 * s + 900.0))
    )
    y = y + 1e-3 * y.std() * rng.standard_normal(y.shape)
    return Record(64.0, u, y, (Port("force", "N"),), (TIP,), True)


@pytest.fixture
def npz(tmp_path: Path) -> Path:
    write_record(tmp_path / "bench.npz", bench())
    return tmp_path / "bench.npz"


def test_channels_transducers_and_statistics(npz: Path, capfd: Capture) -> None:
    ended = middeck(capfd, "record", npz, "--json")
    assert (ended.code, ended.err) == (0, "")
    found = json.loads(ended.out)
    assert (found["schema"], found["sample_hz"], found["samples"]) == ("middeck.record/1", 64.0, 1024)
    assert (found["periods"], found["duration_s"], found["sound"], found["faults"]) == (2, 32.0, True, [])
    force, tip = found["channels"]
    keys = ("node", "direction", "role", "gain", "raw_unit", "calibrated")
    assert [tip[k] for k in keys] == ["12", "+z", "sensor", 9.81, "V", "2026-01-31"]
    u = bench().u
    assert force["rms"] == pytest.approx(u.std())
    assert force["peak"] == pytest.approx(np.abs(u - u.mean()).max())
    shown = middeck(capfd, "record", npz).out
    assert "9.81 m/V 2026-01-31" in shown
    assert "no faults found" in shown


def test_faults_and_what_to_try(tmp_path: Path, capfd: Capture) -> None:
    y = bench().y.copy()
    y[0, 0, 5:9] = np.nan
    write_record(tmp_path / "bad.npz", replace(bench(), y=y))
    ended = middeck(capfd, "record", tmp_path / "bad.npz", "--require")
    assert ended.code == 1
    assert "4 samples are missing or no numbers" in ended.out
    assert "try:" in ended.out
    document = json.loads(middeck(capfd, "record", tmp_path / "bad.npz", "--json").out)
    (fault,) = document["faults"]
    assert (fault["kind"], fault["channel"], fault["samples"], document["sound"]) == (
        "gap",
        "tip",
        [[5, 9]],
        False,
    )


def test_a_channel_that_is_all_gaps_has_no_statistics(tmp_path: Path, capfd: Capture) -> None:
    write_record(tmp_path / "bad.npz", replace(bench(), y=np.full_like(bench().y, np.nan)))
    ended = middeck(capfd, "record", tmp_path / "bad.npz", "--json")
    assert ended.code == 0
    assert json.loads(ended.out)["channels"][1]["rms"] is None


def test_a_model_as_reference(npz: Path, capfd: Capture) -> None:
    model = npz.with_name("model.json")
    write_model(model, fit_response(estimate_response(bench()), states=2).model)
    assert "no faults found" in middeck(capfd, "record", npz, "--reference", model).out
    turned = npz.with_name("turned.npz")
    write_record(turned, replace(bench(), y=-bench().y))
    assert (
        "has the wrong sign against the reference"
        in middeck(capfd, "record", turned, "--reference", model).out
    )
    other = npz.with_name("other.npz")
    write_record(other, replace(bench(), outputs=(Port("bus", "m"),)))
    ended = middeck(capfd, "record", other, "--reference", model)
    assert (ended.code, "the reference has tip" in ended.err) == (4, True)


@pytest.mark.parametrize("name", ["r.h5", "r.mat", "r.uff", "r.csv", "r.npz"])
def test_conversion(npz: Path, capfd: Capture, name: str) -> None:
    target = npz.with_name(name)
    assert middeck(capfd, "record", npz, "-o", target).code == 0
    found = load_record(target)
    assert np.array_equal(found.u, bench().u)
    assert np.array_equal(found.y, bench().y)
    assert found.outputs == (TIP,)
    assert found.periodic


def test_columns_and_periods_by_options_and_overrides(tmp_path: Path, capfd: Capture) -> None:
    matrix = np.column_stack([bench().u.ravel(), bench().y.ravel()])
    scipy.io.savemat(tmp_path / "a.mat", {"a": matrix, "b": matrix})
    named = ("--inputs", "force [N]", "--outputs", "tip [m]")
    ended = middeck(
        capfd, "record", tmp_path / "a.mat", *named, "--set", "variable=b", "--set", "sample_hz=64",
        "--periods", 2, "-o", tmp_path / "a.npz",
    )  # fmt: skip
    assert (ended.code, ended.err) == (0, "")
    assert load_record(tmp_path / "a.npz") == replace(bench(), outputs=(Port("tip", "m"),))
    ended = middeck(capfd, "record", tmp_path / "a.mat", *named, "--set", "sample_hz=-1")
    assert (ended.code, "must be > 0" in ended.err) == (2, True)


@pytest.mark.parametrize("target", ["r.xyz", "r.npy"])
def test_a_kind_that_cannot_be_written(npz: Path, capfd: Capture, target: str) -> None:
    ended = middeck(capfd, "record", npz, "-o", npz.with_name(target))
    assert ended.code == 4
    assert "no writer" in ended.err
