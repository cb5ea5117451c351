"""What a fit behind a hold folds back itself is taken off; a sampled model says what a delay leaves in it.

The truth is made here: residues and poles, a delay of any part of a sample, by sums of geometric series.
"""

import numpy as np
import pytest

from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats

RATE, PERIODS, SAMPLES = 100.0, 4, 125
# Modes [Hz], damping ratios, delay in samples, noise over the output's rms.
NEAR_HALF = ((14.5, 25.9, 35.2), (0.114, 0.09, 0.199), 2.5, 2e-4)
PART_OF_A_SAMPLE = ((4.9, 9.5, 34.0), (0.246, 0.04, 0.05), 0.44, 2e-5)
ONE_NEAR_HALF = ((31.5,), (0.178,), 0.53, 2e-4)
Article = tuple[tuple[float, ...], tuple[float, ...], float, float]


def poles_and_gains(article: Article) -> tuple[np.ndarray, np.ndarray]:
    """Poles of positive frequency, and residues of real modal constants."""
    omega, zeta = 2.0 * np.pi * np.array(article[0]), np.array(article[1])
    poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    return poles, np.array([1.0, -0.7, 0.8])[: len(omega)] * omega / (2j * poles.imag)


def periodic(article: Article, seed: int) -> Record:
    """The steady answer to held commands that repeat, a sum over all modes."""
    rng, (poles, gains), delay, noise = np.random.default_rng(seed), poles_and_gains(article), *article[2:]
    u, period = rng.standard_normal(SAMPLES), 1.0 / RATE
    whole = int(np.ceil(delay))
    part = (whole - delay) * period  # since the last sample
    z = np.exp(2j * np.pi * np.arange(SAMPLES // 2 + 1) / SAMPLES)
    H = np.zeros(len(z))
    for p, g in [*zip(poles, gains, strict=True), *zip(poles.conj(), gains.conj(), strict=True)]:
        moved = np.exp(p * part) * np.expm1(p * period) / (z - np.exp(p * period))
        H = H + g / p * (moved + np.expm1(p * part)) * z**-whole
    y = np.tile(np.fft.irfft(H * np.fft.rfft(u), SAMPLES), PERIODS)
    y += noise * y.std() * rng.standard_normal(len(y))
    return Record(
        sample_hz=RATE,
        u=np.tile(u, PERIODS).reshape(1, PERIODS, SAMPLES, 1),
        y=y.reshape(1, PERIODS, SAMPLES, 1),
        inputs=(Port("command", "N"),),
        outputs=(Port("angle", "rad"),),
        periodic=True,
        held=True,
    )


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("article", "seed"),
    repeats([(a, seed) for seed in range(9) for a in (ONE_NEAR_HALF, NEAR_HALF, PART_OF_A_SAMPLE)]),
)
def test_a_mode_near_half_the_rate_is_where_it_is_behind_the_hold(article: Article, seed: int) -> None:
    """What a first model folded back was off by many deviations of the fit, in silence or with doubts."""
    fit = fit_record(periodic(article, seed), states=2 * len(article[0]), sampled=False)
    assert fit.warnings == ()
    hz, zeta, delay, _ = article
    order = np.argsort(natural_hz(fit.model))
    of = fit.uncertainty
    assert np.all(np.abs(natural_hz(fit.model)[order] - hz) < 4.0 * of.natural_hz[order])
    assert np.all(np.abs(damping_ratio(fit.model)[order] - zeta) < 4.0 * of.damping[order])
    assert abs(fit.model.delay_s[0] - delay / RATE) < 4.0 * of.delay_s[0]


@pytest.mark.parametrize("article", repeats([ONE_NEAR_HALF, PART_OF_A_SAMPLE]))
def test_a_sampled_model_says_that_a_delay_is_lacking(article: Article) -> None:
    fit = fit_record(periodic(article, 1), states=2 * len(article[0]), sampled=True)
    assert any("answers to single samples" in warning for warning in fit.warnings)
    assert "sound" not in fit.standing


@pytest.mark.parametrize("seed", repeats(range(20)))
def test_a_sampled_model_without_a_delay_has_no_such_doubt(seed: int) -> None:
    article = (*ONE_NEAR_HALF[:2], 0.0, ONE_NEAR_HALF[3])
    assert fit_record(periodic(article, seed), states=2, sampled=True).warnings == ()
