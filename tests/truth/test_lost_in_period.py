"""Samples lost or repeated within one period of a record are told, and no noise is taken for it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import middeck as md
from middeck.identification.faults.detect import detect_faults
from middeck.identification.faults.lost_in_a_period import find_lost_in_period

SAMPLES, RATE_HZ = 512, 64.0


def steady(seed: int) -> tuple[md.Record, np.random.Generator]:
    """Periods of one mode in steady state under a multisine, with noise of the sensor or of the same mode."""
    rng = np.random.default_rng([61, seed])
    periods, hz, zeta = int(rng.integers(2, 7)), rng.uniform(3.0, 20.0), 10.0 ** rng.uniform(-2.5, -1.8)
    f = np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    H = 1.0 / (1.0 - (f / hz) ** 2 + 2j * zeta * f / hz)
    force = np.exp(2j * np.pi * rng.random(len(f))) * ((f > 2.0) & (f < 24.0))
    u, y = (np.tile(np.fft.irfft(x, SAMPLES), periods) for x in (force, H * force))
    noise = rng.standard_normal(len(y))
    if seed % 2:
        pole = np.exp(2.0 * np.pi * hz / RATE_HZ * (-zeta + 1j))
        noise = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], noise)
    y = y + 10.0 ** rng.uniform(-3.0, -1.0) * y.std() / noise.std() * noise
    shape = 1, periods, SAMPLES, 1
    record = md.Record(
        sample_hz=RATE_HZ,
        u=u.reshape(shape),
        y=y.reshape(shape),
        inputs=(md.Port("force", "N"),),
        outputs=(md.Port("tip", "m"),),
        periodic=True,
    )
    return record, rng


def test_samples_lost_in_one_period_are_reported_with_their_place(campaign) -> None:
    for seed in campaign(120):
        record, rng = steady(seed)
        y, shift = record.y[0, :, :, 0].copy(), [1, 2, -3][seed % 3]
        period, at = int(rng.integers(len(y))), int(rng.integers(SAMPLES // 8, 7 * SAMPLES // 8))
        y[period, at:] = np.roll(y[period], -shift)[at:]
        found = detect_faults(dataclasses.replace(record, y=y[None, :, :, None]))
        found = [fault for fault in found if fault.kind == "shift"]
        assert len(found) == 1
        if len(y) == 2:
            assert "the two periods" in found[0].what
        else:
            assert f"in period {period + 1} of" in found[0].what
            # The motion of one mode is nearly the same a cycle later, which leaves the place open, too.
            assert abs(found[0].samples[0][0] - period * SAMPLES - at) < 40


def test_of_two_periods_none_is_accused(campaign) -> None:
    """Lost in one is repeated in the other: whichever has them, the same is said of both places."""
    for seed in campaign(20):
        rng = np.random.default_rng([62, seed])
        at, shift = int(rng.integers(50, 350)), int(rng.choice([-3, -1, 1, 2]))
        steady = rng.standard_normal(400)
        moved = np.append(steady[:at], np.roll(steady, -shift)[at:])
        noise = 0.05 * rng.standard_normal((2, 400))
        warnings = [
            find_lost_in_period((np.array(rows) + noise).ravel(), 400)[0]
            for rows in ([steady, moved], [moved, steady])
        ]
        for found in warnings:
            assert f"{abs(shift)} samples apart" in found.what
            assert "lost or repeated in one of them" in found.what
            assert [
                run[0] <= place <= run[1] for run, place in zip(found.samples, (at, 400 + at), strict=True)
            ] == [True] * 2


@pytest.mark.parametrize("triggered", [True, False])
def test_a_loss_that_stays_spoils_the_periods_after_it(triggered: bool, campaign) -> None:
    """A recorder that starts each period anew is right again in the next; one that runs on is not."""
    for seed in campaign(20):
        rng = np.random.default_rng([63, seed])
        periods = int(rng.integers(4, 8))
        x = np.tile(rng.standard_normal(400), periods) + 0.05 * rng.standard_normal(400 * periods)
        at = 400 * (periods - 2) + int(rng.integers(50, 350))
        end = 400 * (periods - 1) if triggered else len(x)
        x[at:end] = np.append(x[at + 1 : end], x[end - 400])
        (found,) = find_lost_in_period(x, 400)
        assert f"in period {periods - 1} of" in found.what
        assert ("those after it" in found.hint) is not triggered


@pytest.mark.parametrize("both", [False, True], ids=["in the output", "in both"])
def test_a_loss_that_lasts_is_reported_in_any_period(both: bool, campaign) -> None:
    """The first and the one before the last among them; of input and output, each is told."""
    for seed in campaign(120):
        record, rng = steady(1000 + seed)
        lost, periods = [1, 2, -3, 5][seed % 4], record.y.shape[1]
        period = int(rng.integers(periods))
        at = period * SAMPLES + int(rng.integers(SAMPLES // 8, 7 * SAMPLES // 8))
        now = np.arange(periods * SAMPLES)
        when = now + lost * (now >= at)
        u, y = (np.append(x, x[0, -1])[when].reshape(x.shape) for x in (record.u, record.y))
        spoilt = dataclasses.replace(record, u=u if both else record.u, y=y)
        found = [fault for fault in detect_faults(spoilt) if fault.kind == "shift"]
        assert [fault.side for fault in found] == (["input", "output"] if both else ["output"])
        for fault in found:
            assert f"{abs(lost)} samples" in fault.what
            assert min(abs(run[0] - at) for run in fault.samples) < 45
            if period < periods - 1:
                assert "as all periods after it" in fault.what


def test_a_transient_at_the_start_is_no_loss(campaign) -> None:
    wrong, seeds = 0, campaign(200)
    for seed in seeds:
        record, rng = steady(2000 + seed)
        now = np.arange(record.y.size)
        free = np.exp(-now / rng.uniform(40.0, 600.0)) * np.cos(now * rng.uniform(0.3, 2.0) + seed)
        y = record.y + rng.uniform(0.1, 1.0) * record.y.std() * free.reshape(record.y.shape)
        wrong += any(f.kind == "shift" for f in detect_faults(dataclasses.replace(record, y=y)))
    assert wrong <= len(seeds) // 100


def test_a_start_from_rest_is_no_loss(campaign) -> None:
    """Light modes ring on through all periods: of 300 such records 24 were told to have lost samples."""
    wrong, seeds = 0, campaign(400)
    for seed in seeds:
        rng = np.random.default_rng([75, seed])
        samples, periods = int(rng.choice([256, 512, 1024])), int(rng.integers(2, 7))
        u = np.tile(np.repeat(np.sign(rng.standard_normal(samples // 4)), 4), periods)
        y = np.zeros(len(u))
        for _ in range(int(rng.integers(1, 4))):
            pole = np.exp(rng.uniform(0.03, 1.9) * (1j - 10.0 ** rng.uniform(-3.3, -1.5)))
            y += lfilter([0.0, 1.0], [1.0, -pole], rng.standard_normal() * u).imag
        y += 10.0 ** rng.uniform(-5.0, -1.0) * y.std() * rng.standard_normal(len(y))
        wrong += find_lost_in_period(y, samples) != []
    assert wrong <= len(seeds) // 100


def test_no_samples_are_lost_in_clean_periods(campaign) -> None:
    for seed in campaign(200):
        record, _ = steady(seed)
        assert not any(f.kind == "shift" for f in detect_faults(record))


@pytest.mark.parametrize("lost", [1, 3])
def test_a_loss_is_no_free_motion_where_noise_foretells_itself(lost) -> None:
    """Slow signals in slow noise: the difference to the next period is as smooth as free motion."""
    reported, samples, periods = 0, 1024, 2
    for seed in range(20):
        rng = np.random.default_rng([69, seed])
        lines = np.zeros(samples // 2 + 1, complex)
        lines[1:51] = np.exp(2j * np.pi * rng.random(50))
        y = np.tile(np.fft.irfft(lines), (periods, 1))
        at, period = int(rng.integers(128, 896)), int(rng.integers(periods))
        y[period, at:] = np.roll(y[period], -lost)[at:]
        noise = lfilter(*butter(2, 0.05), rng.standard_normal(y.size))
        reported += find_lost_in_period(y.ravel() + 0.05 * y.std() * noise / noise.std(), samples) != []
    assert reported >= 19
