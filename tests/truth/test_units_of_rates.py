"""Accelerations whose unit is written as files of measuring systems write it, or is not given."""

from __future__ import annotations

import numpy as np
import pytest

import middeck as md

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


def test_without_a_unit_the_warning_says_what_it_may_be() -> None:
    """The fit of a displacement leaves more than a tenth of the farther output."""
    found = md.fit_record(accelerations(""), states=4, sampled=False, band_hz=(1.0, 30.0))
    assert found.error.max() > 0.1
    assert any("the output has no unit: give it, or --constants complex" in w for w in found.warnings)
