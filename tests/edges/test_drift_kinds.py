"""A record that is compared with a model's file is fitted as the model was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import detect_faults_once
from middeck.cli.given.checked_options import FitSettings
from middeck.cli.work.fit_records import alike, identify
from middeck.files.measured.models import load_fitted, write_model
from middeck.files.records import write_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

HZ, SAMPLES = 64.0, 512
KINDS: dict[str, dict[str, Any]] = {
    "as it comes": {},
    "full rank": {"full_rank": True},
    "one delay": {"delay": "common"},
    "delays of paths": {"delay": "path"},
    "no delay": {"delay": "none"},
    "residual terms": {"residuals": True},
    "complex": {"constants": "complex"},
    "complex, falling": {"constants": "complex", "relative_degree": 1},
    "complex, falling twice": {"constants": "complex", "relative_degree": 2},
    "with a constant term": {"relative_degree": 0},
    "sampled": {"sampled": True},
}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Two modes of 3 %, two inputs one after the other, two outputs 10 ms late, 1 % noise, three periods."""
    rng = np.random.default_rng(3)
    f = np.fft.rfftfreq(SAMPLES, 1.0 / HZ)
    s, omega = 2j * np.pi * f, 2.0 * np.pi * np.array([3.0, 6.0])
    modes = omega**2 / (s[:, None] ** 2 + 0.06 * omega * s[:, None] + omega**2)
    shapes = np.array([[1.0, 0.7], [0.8, -0.9]])
    H = np.exp(-0.01 * s)[:, None, None] * np.einsum("km,om,im->koi", modes, shapes, shapes[::-1])
    lines = np.where((f > 0.5) & (f <= 7.9), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    U = lines * np.eye(2)[:, :, None]
    u, y = (np.fft.irfft(x, n=SAMPLES) for x in (U, np.einsum("koi,eik->eok", H, U)))
    u, y = (np.repeat(np.moveaxis(x, 1, 2)[:, None], 3, axis=1) for x in (u, y))
    y = y + 0.01 * y.std() * rng.standard_normal(y.shape)
    ports = (Port("a", "N"), Port("b", "N")), (Port("c", "m"), Port("d", "m"))
    path = tmp_path_factory.mktemp("record") / "record.npz"
    write_record(path, Record(sample_hz=HZ, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=True))
    return str(path)


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Faults of the one record are looked for once."""
    monkeypatch.setattr("middeck.cli.work.fit_records.detect_faults", detect_faults_once)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_record_gives_the_same_model_again(kind: str, file: str, tmp_path: Path) -> None:
    first = identify([file], FitSettings(**({"states": 4, "sampled": False} | KINDS[kind]))).fit
    write_model(tmp_path / "model.json", first.model, first.covariance)
    again = identify([file], alike(FitSettings(), *load_fitted(tmp_path / "model.json"))).fit
    assert again.covariance.structure == first.covariance.structure
    assert again.model == first.model


def test_what_is_asked_for_goes_before_the_models(file: str, tmp_path: Path) -> None:
    fit = identify([file], FitSettings(states=4, sampled=False)).fit
    asked = alike(FitSettings(states=6, delay="common", sampled=True), fit.model, fit.covariance)
    assert (asked.states, asked.delay, asked.sampled) == (6, "common", False)
