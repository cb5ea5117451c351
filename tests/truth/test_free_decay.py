"""Free decays of oscillators whose frequency and damping against amplitude are known."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from middeck.errors import DataError, FitError
from middeck.identification.free_decay.decay_fit import fit_free_decay
from middeck.identification.free_decay.releases import without_tail

RATE, HZ, ZETA = 100.0, 5.0, 0.004
OMEGA = 2.0 * np.pi * HZ
CUBIC = 0.02  # stiffness beta a^2 / omega^2 at amplitude one


def duffing(rng, pushes, *, seconds=25.0, drag=0.0, noise=1e-3):
    """A record of pushes, each held for two seconds, let go, and left to decay."""
    parts = []
    for push in pushes:

        def rate(t, x):
            force = OMEGA**2 * (x[0] + CUBIC * x[0] ** 3) + 2.0 * ZETA * OMEGA * x[1]
            return [x[1], -force - drag * abs(x[1]) * x[1]]

        t = np.arange(int(seconds * RATE)) / RATE
        free = solve_ivp(rate, (0.0, t[-1]), [push, 0.0], t_eval=t, method="LSODA", rtol=1e-9, atol=1e-11)
        parts += [np.full(int(2.0 * RATE), push), free.y[0]]
    whole = np.concatenate(parts)
    return whole + noise * rng.normal(size=len(whole))


def backbone(a):
    """Frequency of free vibration of amplitude a, by an elliptic integral (Nayfeh and Mook 1979, 2.1)."""
    m = CUBIC * a**2 / (2.0 * (1.0 + CUBIC * a**2))
    return HZ * np.sqrt(1.0 + CUBIC * a**2) * np.pi / 2.0 / ellipk(m)


def damping_of(a, drag):
    """Power lost over a cycle, of the drag and the damper, over the change of energy with amplitude."""
    w = 2.0 * np.pi * backbone(a)
    lost = ZETA * OMEGA * w**2 * a**2 + drag * 4.0 / (3.0 * np.pi) * (w * a) ** 3
    return lost / (OMEGA**2 * (a**2 + CUBIC * a**4)) / w


def test_frequency_follows_the_backbone_and_damping_the_drag():
    drag = 0.01
    samples = duffing(np.random.default_rng(1), (1.0, -0.8, 0.9, -1.0), drag=drag, seconds=20.0)
    found = fit_free_decay(samples, RATE)
    assert len(found.decays) == 4
    assert found.one_exponential_rms > 10.0 * found.residual_rms.max()
    middle = (found.amplitude > 0.06) & (found.amplitude < 0.7)
    a = found.amplitude[middle]
    damping = damping_of(a, drag)
    damped = backbone(a) * np.sqrt(1.0 - damping**2)
    np.testing.assert_allclose(found.frequency_hz[middle], damped, rtol=5e-5)
    np.testing.assert_allclose(found.damping[middle], damping, rtol=0.02)
    assert (
        np.sqrt(np.mean(((found.frequency_hz[middle] - damped) / found.frequency_std_hz[middle]) ** 2)) < 3.0
    )
    assert np.sqrt(np.mean(((found.damping[middle] - damping) / found.damping_std[middle]) ** 2)) < 3.0


def test_one_exponential_where_one_is_true():
    rng, t = np.random.default_rng(2), np.arange(3000) / RATE
    free = [
        a * np.exp(-ZETA * OMEGA * t) * np.cos(OMEGA * t + p) for a, p in ((2.0, 0.3), (1.5, 2), (1.8, 4))
    ]
    samples = np.concatenate(free) + 0.02 * rng.normal(size=9000)
    found = fit_free_decay(samples, RATE, decays=[slice(0, 3000), slice(3000, 6000), slice(6000, 9000)])
    assert found.coefficients == 1
    assert np.all(np.abs(found.frequency_hz - HZ) < 4.0 * found.frequency_std_hz)
    assert np.all(np.abs(found.damping - ZETA) < 4.0 * found.damping_std)
    np.testing.assert_allclose(found.residual_rms, 0.02, rtol=0.05)


def test_one_decay_alone_has_no_deviation():
    t = np.arange(3000) / RATE
    samples = np.exp(-ZETA * OMEGA * t) * np.cos(OMEGA * t) + 1e-3 * np.random.default_rng(3).normal(
        size=3000
    )
    found = fit_free_decay(samples, RATE, decays=[slice(0, 3000)])
    assert np.all(np.isinf(found.frequency_std_hz))
    np.testing.assert_allclose(found.damping, ZETA, rtol=2e-3)


def test_the_unit_of_the_samples_does_not_matter():
    samples = duffing(np.random.default_rng(4), (1.0, -0.9), drag=0.01, seconds=12.0)
    first, second = fit_free_decay(samples, RATE), fit_free_decay(1e-6 * samples, RATE)
    assert len(first.decays) == 2
    assert second.decays == first.decays
    np.testing.assert_allclose(second.frequency_hz, first.frequency_hz, rtol=1e-6)
    np.testing.assert_allclose(second.amplitude, 1e-6 * first.amplitude, rtol=1e-6)


def test_records_without_a_decay_are_refused():
    t = np.arange(3000) / RATE
    grown = np.exp(ZETA * OMEGA * t) * np.cos(OMEGA * t)
    with pytest.raises(FitError, match="does not fall"):
        fit_free_decay(grown, RATE, decays=[slice(0, 3000)])
    with pytest.raises(DataError, match="not a finite number"):
        fit_free_decay(np.full(100, np.nan), RATE)
    with pytest.raises(DataError, match="no free decay"):
        fit_free_decay(np.linspace(0.0, 1.0, 500), RATE)


@pytest.mark.parametrize(("seconds", "noise"), [(60.0, 0.02), (60.0, 0.1), (20.0, 0.1)])
def test_a_tail_of_noise_is_cut_off(seconds: float, noise: float) -> None:
    """Of records that went on long after the decay the frequency was off by a factor of ten, in silence."""
    rng, hz, zeta, sample_hz = np.random.default_rng([8, int(seconds)]), 7.0, 0.02, 200.0
    t = np.arange(int(seconds * sample_hz)) / sample_hz
    omega = 2.0 * np.pi * hz
    one = np.exp(-zeta * omega * t) * np.cos(omega * np.sqrt(1.0 - zeta**2) * t)
    y = np.tile(one, 3) + noise * rng.standard_normal(3 * len(t))
    decays = [slice(k * len(t), (k + 1) * len(t)) for k in range(3)]
    found = fit_free_decay(y, sample_hz, decays=decays)
    assert all(d.stop - d.start < 8.0 * sample_hz for d in found.decays)
    truth = (hz * np.sqrt(1.0 - zeta**2), zeta / np.sqrt(1.0 - zeta**2))
    np.testing.assert_allclose(found.frequency_hz, truth[0], rtol=1e-3)
    np.testing.assert_allclose(found.damping, truth[1], rtol=0.1)


def test_a_decay_without_a_tail_is_kept_whole() -> None:
    t = np.arange(4000) / 200.0
    for law in (np.exp(-0.4 * t), 1.0 / (1.0 + t), np.maximum(1.0 - t / 21.0, 0.0)):
        assert without_tail(law * np.cos(44.0 * t), slice(0, 4000), 28.6) == slice(0, 4000)


@pytest.mark.parametrize(("share", "warned"), [(0.0, False), (0.3, True)])
def test_another_mode_in_the_record_is_reported(share: float, warned: bool) -> None:
    """Its deviations are then five times too small for the damping."""
    t, rng = np.arange(2000) / 200.0, np.random.default_rng(4)
    decays = [
        np.exp(-0.01 * 2 * np.pi * 7 * t) * np.cos(2 * np.pi * 7 * t + k)
        + share * np.exp(-0.01 * 2 * np.pi * 23 * t) * np.cos(2 * np.pi * 23 * t + 2 * k)
        + 0.01 * rng.standard_normal(len(t))
        for k in range(3)
    ]
    parts = [slice(2000 * k, 2000 * (k + 1)) for k in range(3)]
    found = fit_free_decay(np.concatenate(decays), 200.0, decays=parts)
    assert bool(found.warnings) is warned
    assert not warned or "near 23" in found.warnings[0]
