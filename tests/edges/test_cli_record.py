"""``middeck record``: what it shows, judges and converts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from cli_runner import middeck
from middeck.files.measured.models import write_model
from middeck.files.records import load_record, write_record
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.spectra.estimate import estimate_response
from middeck.signals.ports import Channel, Port
from middeck.signals.record import Record

Capture = pytest.CaptureFixture[str]
TIP = Port(
    "tip",
    "m",
    Channel(node="12", direction="+z", role="sensor", gain=9.81, raw_unit="V", calibrated="2026-01-31"),
)


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
    return Record(sample_hz=64.0, u=u, y=y, inputs=(Port("force", "N"),), outputs=(TIP,), periodic=True)


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


def test_an_input_and_an_output_of_one_name_are_found_by_their_sides(tmp_path: Path, capfd: Capture) -> None:
    """A motor and its encoder, whose names are those of their joint."""
    x, joint = np.random.default_rng(3).standard_normal((3, 1, 1, 50, 1)), "arm"
    y = np.concatenate([x[1], x[2]], axis=-1)
    ports = (Port("tip", "m"), Port(joint, "rad"))
    taken = Record(sample_hz=10.0, u=x[0], y=y, inputs=(Port(joint, "N m"),), outputs=ports, periodic=False)
    write_record(tmp_path / "r.npz", taken)
    asked = ("--inputs", joint, "--outputs", joint, "-o", tmp_path / "s.npz")
    assert middeck(capfd, "record", tmp_path / "r.npz", *asked).code == 0
    kept = load_record(tmp_path / "s.npz")
    assert np.array_equal(kept.u, taken.u)
    assert np.array_equal(kept.y, taken.y[..., 1:])


@pytest.mark.parametrize("target", ["r.xyz", "r.npy"])
def test_a_kind_that_cannot_be_written(npz: Path, capfd: Capture, target: str) -> None:
    ended = middeck(capfd, "record", npz, "-o", npz.with_name(target))
    assert ended.code == 2  # before anything is read
    assert "no writer" in ended.err


def started_from_rest() -> Record:
    """The bench uncut, in three periods; a start-up transient of its mode in the first."""
    steady = bench()
    u, y = (np.concatenate([x, x[:, :1]], axis=1).reshape(1, 1, -1, 1) for x in (steady.u, steady.y))
    t = np.arange(y.shape[2]) / 64.0
    y = y + y.std() * (np.exp(-1.5 * t) * np.cos(30.0 * t))[None, None, :, None]
    return replace(steady, u=u, y=y, periodic=False)


def test_what_excited_a_run_is_recognised_and_its_transient_judged(tmp_path: Path, capfd: Capture) -> None:
    write_record(tmp_path / "run.npz", started_from_rest())
    ended = middeck(capfd, "record", tmp_path / "run.npz", "--require")
    assert ended.code == 1
    assert "excited by: multisine, 3 periods of 1024 samples (16 s)" in ended.out
    assert "--periods 3" in ended.out
    found, cut = (
        json.loads(middeck(capfd, "record", tmp_path / "run.npz", "--json", *more).out)
        for more in ((), ("--periods", 3))
    )
    assert (found["excitation"]["period"], found["excitation"]["periods"]) == (1024, 3)
    assert cut["excitation"] is None
    assert [f for f in found["faults"] if f["kind"] == "transient"] == cut["faults"]
    assert len(cut["faults"]) == 1


def test_a_run_that_does_not_repeat_is_called_so(tmp_path: Path, capfd: Capture) -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1, 1, 500, 1))
    write_record(tmp_path / "run.npz", replace(bench(), u=u, y=u, periodic=False))
    assert "excited by: noise, not repeated" in middeck(capfd, "record", tmp_path / "run.npz").out


def test_a_folder_is_no_record(tmp_path: Path, capfd: Capture) -> None:
    (tmp_path / "folder.npz").mkdir()
    ended = middeck(capfd, "record", tmp_path / "folder.npz")
    assert ended.code == 4
    assert "is a folder" in ended.err


def test_a_command_is_no_record(tmp_path: Path, capfd: Capture) -> None:
    target = tmp_path / "torque.npz"
    ask = ("excite", "multisine", "--band", "1,20", "--period", 8, "--rate", 64, "--rms", 1, "-o", target)
    assert middeck(capfd, *ask).code == 0
    ended = middeck(capfd, "record", target)
    assert ended.code == 4
    assert "a command written by middeck excite" in ended.err
    assert "arrays missing" not in ended.err


@pytest.mark.parametrize("name", ["objects.npz", "objects.npy"])
def test_objects_are_refused_in_our_words(tmp_path: Path, capfd: Capture, name: str) -> None:
    objects = np.array([{"a": 1}], dtype=object)
    with open(tmp_path / name, "wb") as file:
        if name.endswith(".npz"):
            np.savez(file, allow_pickle=True, u=objects)
        else:
            np.save(file, objects, allow_pickle=True)
    ended = middeck(capfd, "record", tmp_path / name)
    assert ended.code == 4
    assert "holds objects" in ended.err
    assert "unsafe" not in ended.err
    assert "pickle" not in ended.err
