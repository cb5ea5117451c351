"""Accelerations whose unit is written as files of measuring systems write it, or is not given."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import middeck as md
from middeck.identification.model.fit_options import is_acceleration, is_rate, is_velocity

RATE_HZ, SAMPLES = 128.0, 2048
OMEGA, ZETA = 2.0 * np.pi * np.array([5.3, 15.4]), np.array([0.01, 0.02])
RESIDUE = np.array([[1.0, -0.6], [0.5, 0.9]])  # [output, mode] of force and displacement


def accelerations(unit: str) -> md.Record:
    """One run of a band-limited force, and the accelerations that it makes with 1 % of noise."""
    rng = np.random.default_rng(6)
    f = np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    s = 2j * np.pi * f[:, None, None]
    H = np.sum(RESIDUE * s**2 / (s**2 + 2.0 * ZETA * OMEGA * s + OMEGA**2), axis=2)
    force = np.where(
        (f > 0.5) & (f < 40.0), rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)), 0.0
    )
    u, y = np.fft.irfft(force, SAMPLES), np.fft.irfft(force[:, None] * H, SAMPLES, axis=0)
    y += 0.01 * np.std(y, axis=0) * rng.standard_normal(y.shape)
    outputs = tuple(md.Port(name, unit) for name in ("near", "far"))
    return md.Record(
        sample_hz=RATE_HZ,
        u=u[None, None, :, None],
        y=y[None, None],
        inputs=(md.Port("force", "N"),),
        outputs=outputs,
        periodic=False,
    )


@pytest.mark.parametrize("unit", ["m/s^2", "M/S2"])
def test_an_acceleration_is_fitted_as_one_however_its_unit_is_written(unit: str) -> None:
    found = md.fit_record(accelerations(unit), states=4, sampled=False, band_hz=(1.0, 30.0))
    assert found.error.max() < 0.012
    poles = found.model.poles[np.argsort(np.abs(found.model.poles))]
    assert np.abs(poles) == pytest.approx(OMEGA, rel=3e-5)
    assert -poles.real / np.abs(poles) == pytest.approx(ZETA, rel=3e-3)


MOTIONS = (
    "m/s", "mm/s", "μm/s", "µm/s^2", "nm/s", "m.s-2", "m·s⁻²", "rad s-1", "mrad/s", "deg/s", "rev/s",
    "arcsec/s", "1/s", "s^-1", "ft/s^2", "strain/s", "metre/second^2", "(rad/s)", "[m/s^2]", "rpm", "urad/s",
    "r/min", "rev/min", "min⁻¹", "m/min", "km/h", "deg/hr", "ips", "rps", "mph", "Gal", "mGal", "mm/min^2",
    "dps", "mdps", "m/ms", "mm/ms^2", "μm/μs", "rad ms^-1", "m/millisecond",
)  # fmt: skip
OTHERS = (
    "N m/s", "Nm/s", "NM/s", "N*m/s", "N/s", "kN/s", "lbf ft/s", "J/s", "W", "kg/s", "kg m/s", "kg m/s^2",
    "kg m^2/s^2", "m^2/s^2", "m^3/s", "l/s", "V/s", "A/s", "counts/s", "K/s", "Pa/s", "Hz/s", "N m s", "m s",
    "l/min", "m^3/h", "kg/h", "min", "h", "m min", "kW h", "N/min", "counts/min", "N/ms", "V/ms", "ms",
)  # fmt: skip


def test_only_lengths_angles_and_strains_over_seconds_are_motion() -> None:
    """A force in kg m/s^2, a power in N m/s and a flow in m^3/s end as a rate does, and are none."""
    assert [unit for unit in MOTIONS if not is_rate(md.Port("tip", unit))] == []
    assert [unit for unit in OTHERS if is_rate(md.Port("tip", unit))] == []


@pytest.mark.parametrize("unit", MOTIONS)
def test_a_unit_is_that_of_a_velocity_or_of_an_acceleration_by_its_power_of_time(unit: str) -> None:
    twice = any(mark in unit for mark in ("2", "²", "Gal"))
    port = md.Port("tip", unit)
    assert (is_velocity(port), is_acceleration(port)) == (not twice, twice)


def test_without_a_unit_the_warning_says_what_it_may_be() -> None:
    """The fit of a displacement leaves more than a tenth of the farther output."""
    found = md.fit_record(accelerations(""), states=4, sampled=False, band_hz=(1.0, 30.0))
    assert found.error.max() > 0.1
    assert any("the output has no unit: give it, or --constants complex" in w for w in found.warnings)


def test_an_acceleration_that_steps_with_a_held_force_is_no_continuous_model() -> None:
    """Without a filter the sample after a step has all of it: off by 13 deviations, and nothing was said."""
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal(2 * SAMPLES), 0.0
    for omega, zeta, share in zip(OMEGA, ZETA, (1.0, -0.7), strict=True):
        b, a, _ = cont2discrete(([share, 0.0, 0.0], [1.0, 2.0 * zeta * omega, omega**2]), 1.0 / RATE_HZ)
        y = y + lfilter(np.ravel(b), a, u)
    y = y + 0.01 * np.std(y) * rng.standard_normal(len(u))
    held = md.Record(
        sample_hz=RATE_HZ,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=(md.Port("force", "N"),),
        outputs=(md.Port("near", "m/s^2"),),
        periodic=False,
        held=True,
    )
    continuous = md.fit_record(held, states=4, sampled=False, band_hz=(1.0, 25.0))
    off = np.abs(np.sort(np.abs(continuous.model.poles)) - OMEGA) / (
        2.0 * np.pi * continuous.uncertainty.natural_hz[np.argsort(np.abs(continuous.model.poles))]
    )
    assert off.max() > 4.0
    assert "sound" not in continuous.standing
    assert any("take a sampled model" in w for w in continuous.warnings)
