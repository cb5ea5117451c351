"""Faults that last: sensors that drift at random, gains that change, channels that stick; sound records."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import chirp, fftconvolve, lfilter
from struck_plant import shaken

from middeck.identification.faults.detect import detect_faults
from middeck.identification.faults.stuck_and_gain_drift import find_gain_drift
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats

Rng = np.random.Generator
Campaign = Callable[..., range]
COUNT, HZ = 4096, 100.0


def article(u: np.ndarray, rng: Rng) -> np.ndarray:
    """Three outputs of three modes between 0.6 and 30 Hz, under a held force: its step responses differ."""
    y, time = np.zeros((COUNT, 3)), np.arange(COUNT) / HZ
    for hz in np.exp(rng.uniform(np.log(0.6), np.log(30.0), 3)):
        w, z = 2.0 * np.pi * hz, rng.uniform(0.005, 0.03)
        d = w * np.sqrt(1.0 - z * z)
        step = 1.0 - np.exp(-z * w * time) * (np.cos(d * time) + z * w / d * np.sin(d * time))
        answer = fftconvolve(u, np.diff(step, prepend=0.0))[:COUNT]
        y += answer[:, None] * rng.standard_normal(3)
    return y


def multisine(rng: Rng) -> np.ndarray:
    lines = np.zeros(COUNT // 8 + 1, dtype=complex)
    lines[1:440] = np.exp(2j * np.pi * rng.random(439))
    return np.tile(np.fft.irfft(lines) * 20.0, 4)


def hammer(rng: Rng) -> np.ndarray:
    u = np.zeros(COUNT)
    for at in 60 + np.arange(4) * COUNT // 4:
        u[at : at + 5] = rng.uniform(0.8, 1.2) * np.hanning(7)[1:-1]
    return u


EXCITATIONS: dict[str, Callable[[Rng], np.ndarray]] = {
    "random": lambda rng: rng.standard_normal(COUNT),
    "multisine": multisine,
    "binary": lambda rng: np.repeat(rng.choice([-1.0, 1.0], COUNT // 4), 4),
    "burst": lambda rng: rng.standard_normal(COUNT) * (np.arange(COUNT) % 2048 < 1200),
    "sweep": lambda rng: chirp(np.arange(COUNT) / HZ, 0.3, COUNT / HZ, 40.0, phi=-90),
    "steps": lambda rng: np.repeat(rng.standard_normal(32), COUNT // 32),
    "hammer": hammer,
    "release": lambda rng: (np.arange(COUNT) < 400) * 1.0,
}


def measured(kind: str, seed: int, noise: float = 1e-3, *, steps: bool = False) -> Record:
    rng = np.random.default_rng([91, seed])
    u = EXCITATIONS[kind](rng)
    y = article(u - u[0] * (kind == "release"), rng)
    y += noise * y.std(axis=0) * rng.standard_normal(y.shape)
    step = 2.0 * np.abs(y).max(axis=0) / 2**12
    return Record(
        sample_hz=HZ, u=u[None, None, :, None], y=(np.round(y / step) * step if steps else y)[None, None],
        inputs=(Port("force", "N"),), outputs=tuple(Port(f"y{k}", "m") for k in range(3)), periodic=False,
    )  # fmt: skip


def faults_of(record: Record) -> list[tuple[str, str]]:
    return [(f.channel, f.kind) for f in detect_faults(record) if f.severity != "note"]


@pytest.mark.parametrize("kind", EXCITATIONS)
def test_nothing_is_reported_for_sound_records(kind: str, campaign: Campaign) -> None:
    """With and without noise and a converter's steps: releases were told as shifts, rests as dropouts."""
    runs = (*{"release": (49, 57, 63), "hammer": (15,)}.get(kind, ()), *campaign(60))
    warnings = [
        faults_of(measured(kind, seed, (0.0, 1e-4, 1e-2)[seed % 3], steps=seed % 2 == 1)) for seed in runs
    ]
    assert sum(map(bool, warnings)) <= len(runs) // 50, warnings


@pytest.mark.parametrize("kind", ["random", "multisine", "sweep", "hammer"])
def test_a_sensor_that_drifts_at_random_is_named(kind: str, campaign: Campaign) -> None:
    found: list[bool] = []
    for seed in campaign(80):
        record, rng = measured(kind, seed), np.random.default_rng([92, seed])
        walk, y = np.cumsum(rng.standard_normal(COUNT)), record.y.copy()
        y[0, 0, :, 1] += rng.uniform(0.3, 1.0) * y[..., 1].std() * (walk - walk.mean()) / walk.std()
        found.append(("y1", "drift") in faults_of(dataclasses.replace(record, y=y)))
    assert np.mean(found) >= 0.6


@pytest.mark.parametrize("kind", ["random", "multisine", "binary", "burst"])
def test_a_gain_that_drifts_is_named(kind: str, campaign: Campaign) -> None:
    """By a tenth from the beginning to the end: an amplifier that warms up."""
    found: list[bool] = []
    for seed in campaign(80):
        record = measured(kind, seed)
        y = record.y * np.where(np.arange(3) == 2, 1.0 + 0.1 * np.linspace(0.0, 1.0, COUNT)[:, None], 1.0)
        found.append(faults_of(dataclasses.replace(record, y=y)) == [("y2", "unlike")])
    assert np.mean(found) >= 0.75


def test_an_input_that_grows_is_no_gain_that_changes(campaign: Campaign) -> None:
    """On an article of many modes, of which a short past leaves a response that changes with the input."""
    warnings: list[tuple[str, str]] = []
    for seed in (0, 60, *campaign(40)):
        rng = np.random.default_rng([8, seed])
        u, y = rng.standard_normal(8192) * np.linspace(0.2, 1.0, 8192), np.zeros((8192, 2))
        for hz in np.exp(rng.uniform(np.log(0.5), np.log(45.0), 25)):
            w, z, T = 2.0 * np.pi * hz, rng.uniform(0.003, 0.03), 1.0 / HZ
            d, decay = w * np.sqrt(1.0 - z * z), np.exp(-z * w * T)
            c, s = decay * np.cos(d * T), decay * np.sin(d * T) * z * w / d
            held = [0.0, 1.0 - c - s, decay * decay + s - c]  # of the zero-order hold
            y += lfilter(held, [1.0, -2.0 * c, decay * decay], u)[:, None] * rng.standard_normal(2)
        y += 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)
        warnings += faults_of(
            dataclasses.replace(
                measured("random", 0), u=u[None, None, :, None], y=y[None, None],
                outputs=(Port("y0", "m"), Port("y1", "m")),
            )
        )  # fmt: skip
    assert not warnings


def test_a_trend_in_one_experiment_hides_no_random_drift_in_another() -> None:
    one, rng = measured("random", 2), np.random.default_rng(7)
    u, y = np.concatenate([one.u, one.u]), np.concatenate([one.y, one.y])
    walk = np.cumsum(rng.standard_normal(COUNT))
    y[1, 0, :, 0] += 0.8 * one.y[..., 0].std() * (walk - walk.mean()) / walk.std()
    y[0, 0, :, 0] += 1.5 * one.y[..., 0].std() * np.linspace(-1.0, 1.0, COUNT)
    drifts = [f for f in detect_faults(dataclasses.replace(one, u=u, y=y)) if f.kind == "drift"]
    assert sorted((f.channel, f.experiment) for f in drifts) == [("y0", 0), ("y0", 1)]


@pytest.mark.parametrize("kind", ["random", "multisine", "binary"])
def test_an_input_that_sticks_while_the_outputs_move_is_named(kind: str, campaign: Campaign) -> None:
    for seed in campaign(80):
        record, rng = measured(kind, seed), np.random.default_rng([94, seed])
        u, first = record.u.copy(), int(rng.integers(800, 3000))
        u[:, :, first : first + int(rng.integers(150, 900))] = u[0, 0, first, 0]
        message = faults_of(dataclasses.replace(record, u=u))
        assert ("force", "stuck") in message or ("force", "dropout") in message


@pytest.mark.parametrize("kind", ["random", "multisine", "binary", "burst"])
def test_an_output_that_begins_late_is_named(kind: str, campaign: Campaign) -> None:
    for seed in campaign(80):
        record, rng = measured(kind, seed), np.random.default_rng([95, seed])
        y, dead = record.y.copy(), int(rng.integers(100, 900))
        y[:, :, :dead, 1] = rng.choice([0.0, y[0, 0, dead, 1]])
        assert ("y1", "stuck") in faults_of(dataclasses.replace(record, y=y))


def test_a_dead_time_is_no_output_that_begins_late(campaign: Campaign) -> None:
    """A rest that ends with the answer to the first input, 90 to 300 samples late, in noiseless records."""
    for seed in campaign(40):
        record, delay = measured("random", seed, 0.0), 90 + 7 * (seed % 30)
        y = np.concatenate([np.zeros_like(record.y[:, :, :delay]), record.y[:, :, :-delay]], axis=2)
        assert not any(kind == "stuck" for _, kind in faults_of(dataclasses.replace(record, y=y)))


def test_two_sensors_of_one_mode_without_noise_are_a_note() -> None:
    """Computed outputs may be equal with all cables right; with noise that both share, they are one."""
    rng = np.random.default_rng(96)
    u = rng.standard_normal(COUNT)
    y = lfilter([0.0, 1.0], [1.0, -1.8, 0.98], u)
    found = {}
    for noise in (0.0, 1e-3):
        x = y + noise * y.std() * rng.standard_normal(COUNT)
        found[noise] = detect_faults(
            Record(
                sample_hz=HZ,
                u=u[None, None, :, None],
                y=np.stack([x, -2.0 * x], axis=1)[None, None],
                inputs=(Port("force", "N"),),
                outputs=(Port("a", "m"), Port("b", "m")),
                periodic=False,
            )
        )
    assert [(f.kind, f.severity) for f in found[0.0]] == [("duplicate", "note")]
    assert [(f.kind, f.severity) for f in found[1e-3]] == [("duplicate", "serious")]


@pytest.mark.parametrize("seed", repeats([2, 0, 1]))
@pytest.mark.parametrize("parts", [1.5e-4, -4e-4])
def test_two_clocks_are_named(seed: int, parts: float) -> None:
    """An output sampled by a clock that runs fast or slow was called a gain that changes by up to 130 %."""
    plant = ([2.9, 8.4, 17.0], [0.006, 0.02, 0.01], [300.0, -2000.0, 9000.0], 0.008)
    one = shaken(plant, COUNT + 40, HZ, (0.4, 38.0), noise=2e-3, seed=seed)
    time = np.arange(COUNT + 40) / HZ
    y = make_interp_spline(time, one.y[0, 0, :, 0], 5)(time[20:-20] * (1.0 + parts))
    record = dataclasses.replace(one, u=one.u[:, :, 20:-20], y=y[None, None, :, None])
    (warning,) = find_gain_drift(record)
    ((way, ms),) = re.findall(r"ever (\w+), by some ([\d.]+) ms", warning.what)
    assert way == ("earlier" if parts > 0.0 else "later")
    assert float(ms) == pytest.approx(1e3 * COUNT / HZ * abs(parts), rel=0.4)
    ends = 1.0 + np.linspace(-0.1, 0.1, COUNT)
    gain = dataclasses.replace(one, u=record.u, y=one.y[:, :, 20:-20] * ends[:, None])
    (warning,) = find_gain_drift(gain)
    assert "gain to the inputs that changes by +" in warning.what
    assert find_gain_drift(one) == []
