"""Noise that peaks where the article does: of a measured input, or of a disturbance that moves it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import middeck as md
from middeck.identification.spectra.excess_variance import line_degrees, spread_of
from middeck.systems.plants.response import FrequencyResponse, ResponseCovariance
from repeats import repeats

HZ, ZETA = np.array([9.0, 17.0]), np.array([3e-3, 4e-3])
LINES = np.arange(1.0, 40.0, 0.125)
PERIODS = 4
TWO_INPUTS_HZ = np.array([7.0, 7.05, 23.0])
SEEN = np.array([[1.0, 0.7], [0.8, -1.0], [0.5, 0.6]])
DRIVEN = np.array([[1.0, -0.6], [0.9, 1.0], [0.8, 0.7]])


def response() -> np.ndarray:
    s, w = 2j * np.pi * LINES[:, None], 2.0 * np.pi * HZ
    return np.sum(w**2 * [1.0, -0.7] / (s**2 + 2.0 * ZETA * w * s + w**2), axis=1)


def measured(of_input: float, of_output: float, seed: int) -> tuple[FrequencyResponse, np.ndarray]:
    """H with the noise of its input and of its output, its variance from four periods, and the true one."""
    rng, H = np.random.default_rng(seed), response()
    true = of_input**2 * np.abs(H) ** 2 + of_output**2 * np.mean(np.abs(H) ** 2)
    noise = np.sqrt(0.5 * true) * (rng.standard_normal(len(H)) + 1j * rng.standard_normal(len(H)))
    degrees = PERIODS - 1
    known = true * rng.gamma(degrees, 1.0 / degrees, len(H))
    taken = FrequencyResponse(
        frequency_hz=LINES,
        H=(H + noise)[:, None, None],
        inputs=(md.Port("force", "N"),),
        outputs=(md.Port("tip", "m"),),
        variance=known[:, None, None],
    )
    return taken, true


def test_the_variance_of_a_peak_is_not_that_of_its_neighbours() -> None:
    """The mean of 21 lines is a fifteenth of it on the middle one."""
    peaks = np.searchsorted(LINES, HZ)
    ratios = []
    for seed in range(50):
        taken, true = measured(0.05, 1e-4, seed)
        assert np.mean(true[peaks[0] - 10 : peaks[0] + 11]) < 0.2 * true[peaks[0]]
        ratios.append((spread_of(taken, relative=False).variance[0, :, 0] / true)[peaks])
    # Three degrees of freedom: a mean of one, and none that is a tenth.
    assert 0.7 < np.mean(ratios) < 1.3
    assert np.mean(np.array(ratios) < 0.2) < 0.1


def test_the_variance_of_white_noise_is_still_an_average() -> None:
    raised = []
    for seed in range(20):
        taken, true = measured(0.0, 1e-2, seed)
        raised.append(spread_of(taken, relative=False).variance[0, :, 0] > 2.0 * true)
    # Three widths at one in a thousand, a line wide or three or seven.
    assert np.mean(raised) < 0.01


def test_a_fit_through_noise_that_peaks_asks_for_no_more_modes() -> None:
    """Frequencies within their deviations, which were half of what they should be."""
    off = []
    for seed in range(4):
        found = md.fit_response(measured(0.05, 1e-4, seed)[0])
        assert len(found.model.poles) == 2, found.order_reason
        hz = np.abs(found.model.poles) / (2.0 * np.pi)
        off.append((hz - HZ) / found.uncertainty.natural_hz)
    # Eight draws; three degrees of freedom on the line that says most.
    assert np.abs(off).max() < 4.5


def test_the_likelihood_of_one_output_is_its_weighted_fit() -> None:
    """Noise that no other output shares: the two costs are one, also where it peaks with the response."""
    taken = measured(0.05, 1e-4, 3)[0]
    alone = ResponseCovariance(taken.variance, np.ones((len(LINES), 1, 1)))
    taken = dataclasses.replace(taken, covariance=alone)
    weighted, likeliest = (md.fit_response(taken, states=4, cost=c) for c in ("weighted", "likelihood"))
    apart = np.abs(np.sort_complex(weighted.model.poles) - np.sort_complex(likeliest.model.poles))
    # The searches end within a hundredth of a deviation; with averages of 21 lines it was up to one.
    assert np.all(apart < 0.02 * 2.0 * np.pi * np.min(weighted.uncertainty.natural_hz))


def two_inputs(seed: int) -> tuple[md.Record, np.ndarray]:
    """Two experiments of random phases, three periods each, and the true noise of an output's line."""
    rng, (experiments, periods, samples, hz) = np.random.default_rng(seed), (2, 3, 1500, 200.0)
    f = np.fft.rfftfreq(samples, 1.0 / hz)
    driven = ((f >= 0.5) & (f <= 60.0))[None, :, None]
    U = np.where(driven, np.exp(2j * np.pi * rng.random((experiments, len(f), 2))), 0.0)
    s, w = 2j * np.pi * f[:, None], 2.0 * np.pi * TWO_INPUTS_HZ
    G = np.einsum("km,mo,mi->koi", 1.0 / (s**2 + 2.0 * ZETA[0] * w * s + w**2), SEEN, DRIVEN)
    u, y = (np.fft.irfft(x, n=samples, axis=1)[:, None] for x in (U, np.einsum("koi,eki->eko", G, U)))
    deviation = 0.01 * np.std(y)
    y = y + deviation * rng.standard_normal((experiments, periods, samples, 2))
    force, tip = (
        [md.Port(f"{name}{n}", unit) for n in "12"] for name, unit in (("force", "N"), ("tip", "m"))
    )
    record = md.Record(
        sample_hz=hz,
        u=u.repeat(periods, axis=1),
        y=y,
        inputs=tuple(force),
        outputs=tuple(tip),
        periodic=True,
        held=False,
    )
    inverse = np.linalg.inv(U[:, driven[0, :, 0]].transpose(1, 0, 2))
    return record, deviation**2 * samples / periods * np.sum(np.abs(inverse) ** 2, axis=2)


def test_the_variance_of_a_line_whose_inputs_are_hardly_distinguished_is_its_own() -> None:
    """What the inputs let in is known: averaged over neighbours such lines were the best known by far."""
    record, true = two_inputs(0)
    measured = md.estimate_response(record)
    ratio = spread_of(measured, relative=False).variance / true[None]
    # 42 lines' noise of four degrees, and the narrower averages where one is more by chance.
    assert np.min(ratio) > 0.5
    assert np.max(ratio) < 6.0
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert line_degrees(measured) == pytest.approx(4.0, rel=0.15)


def test_no_mode_stands_for_a_line_whose_inputs_are_hardly_distinguished() -> None:
    """With averages over neighbours each of ten such responses had one to four modes of a single line."""
    for seed in repeats(range(10), 2):
        record, _ = two_inputs(seed)
        fit = md.fit_response(md.estimate_response(record))
        found = np.sort(np.abs(fit.model.poles)) / 2.0 / np.pi
        assert len(found) == 3
        deviation = fit.uncertainty.natural_hz[np.argsort(np.abs(fit.model.poles))]
        assert np.all(np.abs(found - TWO_INPUTS_HZ) < 4.0 * deviation)


def test_the_likelihood_counts_how_far_inputs_are_distinguished() -> None:
    """Averaged with the noise, it put the pair five of its deviations off."""
    for seed in repeats(range(6), 6):
        record, _ = two_inputs(seed)
        fit = md.fit_response(md.estimate_response(record), states=6, cost="likelihood")
        order = np.argsort(np.abs(fit.model.poles))
        off = np.abs(fit.model.poles)[order] / 2.0 / np.pi - TWO_INPUTS_HZ
        assert np.all(np.abs(off) < 3.5 * fit.uncertainty.natural_hz[order])
