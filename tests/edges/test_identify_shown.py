"""What ``middeck identify`` shows of its work and of poles that are no modes."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

from cli_runner import middeck
from middeck.cli.shown import progress
from middeck.files.records import write_record
from middeck.plot import fit
from middeck.plot.fit import fit_figure
from middeck.signals.ports import Port
from middeck.signals.record import Record

RATE_HZ, SAMPLES, MODE_HZ = 100.0, 100, 12.0
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mode under a held force; three states are one more than it has."""
    omega, u = 2.0 * np.pi * MODE_HZ, np.random.default_rng(4).standard_normal(SAMPLES)
    b, a, _ = scipy.signal.cont2discrete(([omega**2], [1.0, 0.02 * omega, omega**2]), 1.0 / RATE_HZ, "zoh")
    y = scipy.signal.lfilter([1.0, 0.3], [1.0], scipy.signal.lfilter(b.ravel(), a, u))
    y += 1e-3 * y.std() * np.random.default_rng(5).standard_normal(SAMPLES)
    path = tmp_path_factory.mktemp("run") / "run.npz"
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    u, y = (x[None, None, :, None] for x in (u, y))
    write_record(path, Record(sample_hz=RATE_HZ, u=u, y=y, periodic=False, held=True, **ports))
    return path


def test_a_pole_beyond_half_the_rate_is_no_mode_and_every_step_is_shown(
    run: Path, monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    steps = []

    @contextmanager
    def status(verb: str) -> Generator[Callable[[str], None]]:
        yield lambda what: steps.append(f"{verb}: {what}")

    monkeypatch.setattr(progress, "status", status)
    found = json.loads(middeck(capfd, "identify", run, "--states", 3, "--sampled", "--json").out)
    assert found["frequency_hz"] == pytest.approx([MODE_HZ], rel=1e-3)
    (fast,) = found["pole_of_no_mode"]["re"]
    assert fast < -np.pi * RATE_HZ
    assert steps[:2] == ["identify: reading", "identify: looking for faults"]
    assert len(steps) > 2


def test_a_step_stands_on_a_terminal_with_its_seconds(
    monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    monkeypatch.setattr(progress, "is_terminal", lambda stream: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with progress.status("identify") as show:
        show("looking for faults")
    drawn = capfd.readouterr().err
    assert "0:00:00" in drawn
    assert "identify: looking for faults" in drawn


def test_what_is_drawn_as_data_has_no_dips_of_a_start_from_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    """Three periods of a multisine, the first from rest, which left lines wrong by up to 12.7 dB."""
    samples, periods, rng = 256, 3, np.random.default_rng(6)
    lines = np.zeros(samples // 2 + 1, complex)
    lines[5:103] = np.exp(2j * np.pi * rng.random(98))
    u, pole = np.tile(np.fft.irfft(lines), periods), np.exp(2.0 * np.pi * 0.12 * (1j - 0.004))
    y = np.imag(scipy.signal.lfilter([0.0, 1.0], [1.0, -pole], u))
    y += 1e-3 * y.std() * rng.standard_normal(len(y))
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("sensor", "m"),)}
    u, y = (x.reshape(1, periods, samples, 1) for x in (u, y))
    write_record(tmp_path / "run.npz", Record(sample_hz=RATE_HZ, u=u, y=y, periodic=True, held=True, **ports))
    drawn = []
    monkeypatch.setattr(
        fit, "fit_figure", lambda measured, found: drawn.append(measured) or fit_figure(measured, found)
    )
    asked = ("--states", 2, "--sampled", "--figure", tmp_path / "fit.svg")
    ended = middeck(capfd, "identify", tmp_path / "run.npz", *asked)
    assert (ended.code, len(drawn)) == (0, 1)
    assert "begin with a transient" in ended.err
    q = np.exp(2j * np.pi * drawn[0].frequency_hz / RATE_HZ)
    error = drawn[0].H[:, 0, 0] - (1.0 / (q - pole) - 1.0 / (q - pole.conj())) / 2j
    assert np.abs(error / np.sqrt(drawn[0].variance[:, 0, 0])).max() < 5.0
