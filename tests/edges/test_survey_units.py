"""Units that slip in a survey: seen against the model, and nothing said of a survey in its units."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from coarse_articles import coarse
from middeck.files.measured.modes import write_measured_modes
from middeck.files.setups import load_setup
from middeck.structure.correlation.measured_modes import (
    STRAIGHT,
    MeasuredModes,
    MeasurementNoise,
    every_channel,
    measure_modes,
    sensor_rows,
)
from middeck.structure.correlation.unit_slips import warnings_on_units
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.refinement.findings import findings

SEEDS = range(1993, 1999)


@pytest.fixture(scope="module")
def modes() -> Modes:
    return solve_modes(solve_equilibrium(*load_setup(coarse("mace-simple"), ROOT / "environments/lab.toml")))


def survey(modes: Modes, seed: int) -> MeasuredModes:
    """Channels and modes drawn by lot, frequencies 6 % off the model's, each shape of its own scale."""
    rng = np.random.default_rng(seed)
    channels = every_channel(modes.equilibrium.model)
    at = [channels[i] for i in sorted(rng.choice(len(channels), 18, replace=False))]
    chosen = sorted(int(i) for i in rng.choice(np.arange(4, 20), 7, replace=False))
    found = measure_modes(modes, at, chosen=chosen, noise=MeasurementNoise(1e-3, 0.02), rng=rng)
    return dataclasses.replace(
        found,
        frequency_hz=found.frequency_hz * np.exp(rng.normal(0.0, 0.06, 7)),
        shape=found.shape * 10.0 ** rng.uniform(-2.0, 2.0, 7),
        frequency_std_hz=0.001 * found.frequency_hz,
        shape_std=None,
    )


def doubts(modes: Modes, measured: MeasuredModes) -> str:
    rows = sensor_rows(modes, measured.node, measured.direction)
    return " | ".join(warnings_on_units(modes, measured, np.asarray(rows @ modes.shapes)))


def turned(measured: MeasuredModes, by: float) -> MeasuredModes:
    rotates = np.array([d not in STRAIGHT for d in measured.direction])
    return dataclasses.replace(measured, shape=np.where(rotates[:, None], by, 1.0) * measured.shape)


SLIPS = {
    "rad/s in place of Hz": lambda m: dataclasses.replace(m, frequency_hz=2.0 * np.pi * m.frequency_hz),
    "Hz divided by 2 pi": lambda m: dataclasses.replace(m, frequency_hz=m.frequency_hz / (2.0 * np.pi)),
    "kHz in place of Hz": lambda m: dataclasses.replace(m, frequency_hz=1e-3 * m.frequency_hz),
    "cycles a minute": lambda m: dataclasses.replace(m, frequency_hz=60.0 * m.frequency_hz),
    "(rad/s)^2": lambda m: dataclasses.replace(m, frequency_hz=(2.0 * np.pi * m.frequency_hz) ** 2),
    "periods in s": lambda m: dataclasses.replace(m, frequency_hz=1.0 / m.frequency_hz),
    "per cent in place of a ratio": lambda m: dataclasses.replace(m, damping=100.0 * m.damping),
    "degrees beside metres": lambda m: turned(m, 180.0 / np.pi),
    "m beside mm": lambda m: turned(m, 1e-3),
    "levels in dB": lambda m: dataclasses.replace(m, shape=20.0 * np.log10(np.abs(m.shape) + 1e-12)),
}


@pytest.mark.parametrize("message", SLIPS)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_slip_is_seen(modes: Modes, message: str, seed: int) -> None:
    assert message in doubts(modes, SLIPS[message](survey(modes, seed)))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_survey_in_its_units_is_not_doubted(modes: Modes, seed: int) -> None:
    assert doubts(modes, survey(modes, seed)) == ""


def first_of(measured: MeasuredModes, count: int) -> MeasuredModes:
    parts = {"frequency_hz": 0, "damping": 0, "shape": 1, "frequency_std_hz": 0}
    return dataclasses.replace(
        measured, **{key: np.take(getattr(measured, key), range(count), axis) for key, axis in parts.items()}
    )


@pytest.mark.parametrize("count", [1, 2])
def test_few_modes_tell_a_slip_where_their_shapes_are_known(modes: Modes, count: int) -> None:
    """Seen with at least half of the seeds, never where there is none."""
    slip = SLIPS["rad/s in place of Hz"]
    surveys = [first_of(survey(modes, seed), count) for seed in range(20)]
    assert not any(doubts(modes, s) for s in surveys)
    assert sum("rad/s" in doubts(modes, slip(s)) for s in surveys) >= 10


def test_a_refinement_says_so() -> None:
    """A survey of three modes in rad/s, beside modes of the model that are near these numbers."""
    article, lab = load_setup(coarse("mace-simple"), ROOT / "environments/lab.toml")
    modes = solve_modes(solve_equilibrium(article, lab))
    seen = SLIPS["rad/s in place of Hz"](survey(modes, 1))
    unknown = md.Unknown(name="modulus", parameters=("members.E",), spread=0.1)
    refined = md.refine(article, [md.Survey(name="s", measured=seen, environment=lab)], [unknown])
    assert any("rad/s in place of Hz" in warning for warning in findings(refined))


def test_correlate_says_so(tmp_path: Path, modes: Modes, capfd: pytest.CaptureFixture[str]) -> None:
    write_measured_modes(tmp_path / "s.json", SLIPS["rad/s in place of Hz"](survey(modes, 1)))
    ended = middeck(
        capfd,
        "correlate",
        coarse("mace-simple"),
        tmp_path / "s.json",
        "--noise",
        "0.001,0.02",
        "--runs",
        1,
    )
    assert "rad/s in place of Hz" in ended.err
