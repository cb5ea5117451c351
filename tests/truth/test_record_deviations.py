"""Deviations of a record's fit where its weights are not those of the noise: a campaign of records."""

import numpy as np
import pytest
import scipy.stats
from scipy.signal import lfilter

from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.sensor_or_force_noise import noise_variance
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats

# rad per sample: two modes of 0.8 and 1.5 %, the first where the coloured noise is strong.
OMEGA, ZETA = np.array([0.15, 0.43]), np.array([0.008, 0.015])
POLES = OMEGA * (-ZETA + 1j * np.sqrt(1.0 - ZETA**2))
BEFORE = 2000


def a_record(seed, *, noise, colour, samples=1000):
    """White input held over samples; noise of a first-order process with its pole at ``colour``."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples + BEFORE)
    y = 0.3 * u
    for p, c in zip(np.exp(POLES), (0.2 + 0.1j, -0.15 + 0.05j), strict=True):
        y = y + 2.0 * np.real(c * lfilter([0.0, 1.0], [1.0, -p], u.astype(complex)))
    e = lfilter([1.0], [1.0, -colour], rng.standard_normal(len(u))) * np.sqrt(1.0 - colour**2)
    u, y = (x[None, None, BEFORE:, None] for x in (u, y + noise * y.std() * e))
    return Record(
        sample_hz=1.0, u=u, y=y, inputs=(Port("u", "N m"),), outputs=(Port("y", "rad"),), periodic=False
    )


# By default the held-out samples choose the weights, and choose flat ones here; it is slow, so fewer seeds.
@pytest.mark.parametrize(
    ("weighting", "noise", "colour", "runs"),
    repeats([("flat", 0.05, 0.9, 100), (None, 0.05, 0.9, 40), ("flat", 0.03, 0.0, 100)]),
)
def test_intervals_cover_whatever_noise_the_weights_assume(weighting, noise, colour, runs, campaign):
    z = []
    for seed in campaign(runs):
        record = a_record(seed, noise=noise, colour=colour)
        fitted = fit_record(record, states=4, sampled=True, weighting=weighting)
        near = [int(np.argmin(np.abs(natural_hz(fitted.model) - f))) for f in OMEGA / (2.0 * np.pi)]
        z += list(
            (natural_hz(fitted.model)[near] - OMEGA / (2.0 * np.pi)) / fitted.uncertainty.natural_hz[near]
        )
        z += list((damping_ratio(fitted.model)[near] - ZETA) / fitted.uncertainty.damping[near])
    # n unit normals: the rms that has probability 0.99 (chi-square), a tenth wider for estimated noise;
    # with the weights taken for the noise it is 1.9 in coloured noise.
    low, high = np.sqrt(scipy.stats.chi2([len(z)] * 2).ppf([0.005, 0.995]) / len(z))
    assert 0.9 * low < np.sqrt(np.mean(np.square(z))) < 1.1 * high
    # Intervals of 95 % are to cover 90 to 99 %: what a binomial count falls below, or above, in one
    # campaign of 200.
    count = int(np.sum(np.abs(z) < 1.96))
    assert scipy.stats.binom.ppf(0.005, len(z), 0.90) <= count <= scipy.stats.binom.ppf(0.995, len(z), 0.99)


def test_lines_that_a_fit_follows_do_not_make_the_noise_seem_less():
    rng = np.random.default_rng(0)
    left = np.ones((1, 499, 40))
    left[:, 240:260] = 0.3
    r = rng.standard_normal((1, 499, 40)) + 1j * rng.standard_normal((1, 499, 40))
    r *= np.sqrt(left)
    v = noise_variance(r, None, left)
    # 40 experiments times 31 lines of a Hann window: the average scatters by 4 %, twice that for less left.
    np.testing.assert_allclose(v / 2.0, 1.0, atol=0.3)
    # Without the count of what the fit follows it would be half.
    assert noise_variance(r)[0, 250, 0] < 1.2
