"""A run of samples becomes a periodic record by saying how many periods it holds."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import detect_faults_once, middeck
from middeck.errors import DataError
from middeck.files.measured.models import load_model
from middeck.files.records import load_record, split_periods, write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

Capture = pytest.CaptureFixture[str]
HZ, SAMPLES, PERIODS = 256.0, 1024, 3
MODES_HZ = (3.0, 8.5, 9.3, 22.0)
DELAY_S = 0.010


def run(last_hz: float) -> Record:
    """Four modes of 1 %, 10 ms late, under three periods of a multisine up to ``last_hz``, as one run."""
    rng = np.random.default_rng(3)
    f = np.fft.rfftfreq(SAMPLES, 1.0 / HZ)
    s = 2j * np.pi * f
    omega = 2.0 * np.pi * np.array(MODES_HZ)
    G = np.exp(-DELAY_S * s) * np.sum(
        omega**2 / (s[:, None] ** 2 + 0.02 * omega * s[:, None] + omega**2), axis=1
    )
    lines = np.where((f > 0.0) & (f <= last_hz), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    u, y = (np.tile(np.fft.irfft(x, n=SAMPLES), PERIODS)[None, None, :, None] for x in (lines, lines * G))
    y = y + 1e-3 * y.std() * rng.standard_normal(y.shape)
    return Record(
        sample_hz=HZ,
        u=u,
        y=y,
        inputs=(Port("torque", "N m"),),
        outputs=(Port("angle", "rad"),),
        periodic=False,
    )


def as_csv(path: Path, record: Record) -> Path:
    time = np.arange(record.u.shape[2]) / HZ
    table = np.column_stack([time, record.u[0, 0], record.y[0, 0]])
    header = "time [s],u:torque [N m],y:angle [rad]"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Faults of one record are looked for once."""
    monkeypatch.setattr("middeck.cli.work.fit_records.detect_faults", detect_faults_once)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    csv, npz = as_csv(folder / "run.csv", run(30.0)), folder / "run.npz"
    write_record(npz, run(30.0))
    return csv, npz


def test_csv_and_npz_are_identified_alike(files: tuple[Path, Path], capfd: Capture) -> None:
    found = []
    for path in files:
        arguments = ("--periods", PERIODS, "--states", 8, "--validate", path, "--json")
        ended = middeck(capfd, "identify", path, *arguments)
        assert (ended.code, ended.err) == (0, "")
        found.append(json.loads(ended.out))
        assert found[-1]["frequency_hz"] == pytest.approx(MODES_HZ, rel=1e-4)  # 1e-3 of noise at 3.4 lines/Hz
        assert found[-1]["delay_s"]["angle"] == pytest.approx(DELAY_S, abs=1e-4)
        assert found[-1]["held_out_nrmse"]["angle"] < 0.01
    assert found[0]["frequency_hz"] == found[1]["frequency_hz"]  # 17 digits carry every bit


def test_a_ramp_of_held_out_periods_is_not_scored(files: tuple[Path, Path], capfd: Capture) -> None:
    """The fit takes it out, and no model has it: the score was 50 % where the noise is 0.1 %."""
    whole = run(30.0)
    ramp = whole.y.std() * np.linspace(-1.0, 1.0, PERIODS * SAMPLES)[:, None]
    path = files[1].with_name("drifting.npz")
    write_record(path, dataclasses.replace(whole, y=whole.y + ramp))
    arguments = ("--periods", PERIODS, "--states", 8, "--validate", path, "--json")
    ended = middeck(capfd, "identify", files[1], *arguments)
    assert json.loads(ended.out)["held_out_nrmse"]["angle"] < 0.01


def test_design_takes_periods_too(files: tuple[Path, Path], capfd: Capture) -> None:
    ended = middeck(capfd, "design", files[0], "--set", f"periods={PERIODS}", "--states", 8, "--json")
    assert ended.code == 0, ended.err
    assert json.loads(ended.out)["stable"] is True


def test_without_periods_they_are_found_in_the_input(files: tuple[Path, Path], capfd: Capture) -> None:
    for path in files:
        reported, found = (
            json.loads(middeck(capfd, "identify", path, "--states", 8, "--json", *more).out)
            for more in (("--periods", PERIODS), ())
        )
        (warning,) = (w for w in found["warnings"] if w not in reported["warnings"])
        assert f"cut into {PERIODS} steady periods of {SAMPLES} samples" in warning
        assert found["frequency_hz"] == reported["frequency_hz"]


def test_a_record_without_periods_is_fitted_by_its_samples(tmp_path: Path, capfd: Capture) -> None:
    """Its last part is cut off: five modes and a delay, from samples that begin and end in motion."""
    whole = run(30.0)
    keep = slice(SAMPLES // 3, 2 * SAMPLES)
    u, y = (x.reshape(1, 1, -1, 1)[:, :, keep] for x in (whole.u, whole.y))
    part = Record(
        sample_hz=whole.sample_hz, u=u, y=y, inputs=whole.inputs, outputs=whole.outputs, periodic=False
    )
    write_record(tmp_path / "part.npz", part)
    ended = middeck(capfd, "identify", tmp_path / "part.npz", "--states", 8, "--continuous", "--json")
    found = json.loads(ended.out)
    assert any("not cut into periods" in w for w in found["warnings"])
    assert found["lines"] is None
    # A record 1.7 periods long, against the three periods and 1e-4 of the test above.
    assert found["frequency_hz"] == pytest.approx(MODES_HZ, rel=3e-4)
    assert found["delay_s"]["angle"] == pytest.approx(DELAY_S, abs=3e-4)


def test_a_cost_that_a_fit_of_samples_does_not_have_is_refused(
    files: tuple[Path, Path], capfd: Capture
) -> None:
    whole = load_record(files[1])
    noise = np.random.default_rng(0).standard_normal(whole.u.shape)
    path = files[0].parent / "noise.npz"
    write_record(
        path,
        Record(
            sample_hz=whole.sample_hz,
            u=noise,
            y=whole.y,
            inputs=whole.inputs,
            outputs=whole.outputs,
            periodic=False,
        ),
    )
    ended = middeck(capfd, "identify", path, "--cost", "logarithmic", "--states", 8)
    assert (ended.code, ended.out) == (2, "")
    assert "likelihood" in ended.err
    assert "--method" in ended.err


@pytest.mark.parametrize("method", ["local rational", "samples"])
@pytest.mark.parametrize(
    ("options", "states", "pole_at_zero"),
    [
        (("--integrators", 1, "--states", 3), 3, True),
        (("--rigid", 1, "--states", 4), 4, True),
        (("--delay", "path", "--states", 2), 2, False),
        (("--constants", "complex", "--relative-degree", 2, "--delay", "common", "--states", 2), 2, False),
        (("--constants", "complex", "--full-rank", "--states", 2), 2, False),
    ],
    ids=str,
)
def test_both_fits_take_the_same_options(
    tmp_path: Path,
    capfd: Capture,
    method: str,
    options: tuple[str | int, ...],
    states: int,
    pole_at_zero: bool,
) -> None:
    """Of a torque to a rate or an angle: 1/s or 1/s^2 beside a mode, or that mode alone."""
    power = {"--integrators": 1, "--rigid": 2}.get(str(options[0]))
    rng, rate, samples = np.random.default_rng(0), 64.0, 2048
    f = np.fft.rfftfreq(4 * samples, 1.0 / rate)
    on = (f > 0.3) & (f < 7.0)
    s, w = np.where(on, 2j * np.pi * f, 1.0), 2.0 * np.pi * 3.0
    G = w**2 / (s**2 + 0.02 * w * s + w**2) + (0.0 if power is None else (3.0 / s) ** power)
    U = np.where(on, rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)), 0.0)
    u, y = (np.fft.irfft(X, n=4 * samples)[samples : 2 * samples][None, None, :, None] for X in (U, G * U))
    y = y + 1e-3 * y.std() * rng.standard_normal(y.shape)
    ports = (Port("torque", "N m"),), (Port("angle", "rad"),)
    write_record(
        tmp_path / "part.npz",
        Record(sample_hz=rate, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=False),
    )
    path, model_file = tmp_path / "part.npz", tmp_path / "model.json"
    asked = ("--method", method, "--band", "0.5,6.5", "--continuous", "-o", model_file, "--json")
    ended = middeck(capfd, "identify", path, *options, *asked)
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    assert found["states"] == states
    assert found["frequency_hz"][-1] == pytest.approx(3.0, rel=1e-3)
    model = load_model(model_file)
    at_zero = model.integral if power == 1 else model.rigid
    assert (at_zero is not None) == pole_at_zero
    if at_zero is not None and power is not None:
        assert at_zero[0, 0] == pytest.approx(3.0**power, rel=1e-2)


@pytest.mark.parametrize(
    ("periods", "message"), [(7, "not 7 whole periods"), (2, "does not repeat"), (4, "repeat")]
)
def test_a_wrong_number_of_periods(
    files: tuple[Path, Path], capfd: Capture, periods: int, message: str
) -> None:
    ended = middeck(capfd, "identify", files[0], "--states", 8, "--periods", periods)
    assert (ended.code, ended.out) == (4, "")
    assert message in ended.err
    assert str(files[0]) in ended.err


def test_a_record_that_is_cut_already(files: tuple[Path, Path]) -> None:
    cut = split_periods(load_record(files[1]), PERIODS)
    assert cut.u.shape == (1, PERIODS, SAMPLES, 1)
    assert cut.periodic
    assert split_periods(cut, PERIODS) == cut
    with pytest.raises(DataError, match="cut into 3 periods, not 2"):
        split_periods(cut, 2)


def test_a_sampled_model_that_nobody_asked_for_is_reported_to_have_no_delay(
    tmp_path: Path, capfd: Capture
) -> None:
    """60 Hz is past an eighth of 256 Hz; ten sampled states do not hold four modes and 10 ms."""
    path = tmp_path / "wide.npz"
    write_record(path, run(60.0))
    ask = ("identify", path, "--periods", PERIODS, "--states", 8, "--json")
    found = json.loads(middeck(capfd, *ask).out)
    assert found["sampled"] is True
    chosen = [w for w in found["warnings"] if "--continuous" in w and "--band" in w and "no delay" in w]
    assert len(chosen) == 1
    assert any("modes that the model lacks" in w for w in found["warnings"])
    for wanted in ("--sampled", "--continuous"):
        asked = json.loads(middeck(capfd, *ask, wanted).out)
        assert not any("was chosen" in w for w in asked["warnings"])
    assert asked["delay_s"]["angle"] == pytest.approx(DELAY_S, abs=1e-4)


@pytest.mark.parametrize(
    "option",
    [
        ("--integrators", 1, "--constants", "complex"),
        ("--rigid", 1),
        ("--residuals",),
        ("--delay", "output"),
        ("--constants", "real"),
        ("--relative-degree", 2, "--constants", "complex"),
    ],
)
def test_an_option_of_continuous_models_asks_for_one(
    tmp_path: Path, capfd: Capture, option: tuple[str | int, ...]
) -> None:
    path = tmp_path / "wide.npz"
    write_record(path, run(60.0))  # past an eighth of 256 Hz
    states = 2 + {"--integrators": 1, "--rigid": 2}.get(str(option[0]), 0)  # one mode of four
    ask = ("identify", path, "--periods", PERIODS, "--states", states, *option, "--json")
    found = json.loads(middeck(capfd, *ask).out)
    assert found["sampled"] is False
    assert len([w for w in found["warnings"] if "continuous model was chosen" in w and option[0] in w]) == 1
    message = json.loads(middeck(capfd, *ask, "--continuous").out)
    assert message["pole"] == found["pole"]
    assert not any("was chosen" in w for w in message["warnings"])
    refused = middeck(capfd, *ask, "--sampled")
    assert (refused.code, refused.out) == (2, "")
    assert str(option[0]) in refused.err
    assert "--continuous" in refused.err


@pytest.mark.parametrize("option", [("--delay", "none"), ("--relative-degree", 1), ("--integrators", 0)])
def test_what_sampled_models_have_too_chooses_nothing(
    tmp_path: Path, capfd: Capture, option: tuple[str | int, ...]
) -> None:
    path = tmp_path / "wide.npz"
    write_record(path, run(60.0))
    found = middeck(capfd, "identify", path, "--periods", PERIODS, "--states", 2, *option, "--json")
    assert json.loads(found.out)["sampled"] is True


def test_what_the_reader_doubts_is_reported_for_periods_too(tmp_path: Path, capfd: Capture) -> None:
    whole = as_csv(tmp_path / "run.csv", run(30.0)).read_text()
    path = tmp_path / "cut.csv"
    path.write_text(whole[:-12])  # a last number that lost its exponent or its digits
    ended = middeck(capfd, "identify", path, "--states", 8, "--json")
    warnings = json.loads(ended.out)["warnings"]
    assert any("cut into" in w for w in warnings)
    assert any("the file was cut there" in w for w in warnings)
