"""Hammer tests with accelerometers against exact motion: the force is linear between fine steps."""

import numpy as np
import pytest
import scipy.signal as ss

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.fit_of_blows import fit_impact
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse

RATE, FINE = 500.0, 16
HZ, ZETA = np.array([20.7, 31.1, 48.6, 93.1]), np.array([0.0105, 0.014, 0.008, 0.02])
PHI = np.array([1.0, -0.7, 1.2, 0.6])


def accelerations(force, hz, zeta):
    """Exact for a force that is linear from each fine step to the next: p'' = f - 2 zeta w p' - w^2 p."""
    step, w = 1.0 / (RATE * FINE), 2.0 * np.pi * hz
    pole = w * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    grown = np.exp(pole * step)
    last = (grown - 1.0 - pole * step) / pole**2 / step
    motion = ss.lfilter([last, (grown - 1.0) / pole - last], [1.0, -grown], force.astype(complex))
    return force + np.imag(pole**2 * motion) / np.imag(pole)


def a_test(*, blows, seconds, before_s, noise, force_noise, seed=0):
    """One blow of 22 ms in each experiment, ``before_s`` after the trigger."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * RATE) * FINE) / (RATE * FINE)
    u, y = [], []
    for size in blows:
        phase = (time - before_s - rng.uniform(0.0, 1.0 / RATE)) / 0.022
        force = size * np.sin(np.pi * np.clip(phase, 0.0, 1.0)) ** 2
        moved = sum(p * accelerations(force, f, z) for p, f, z in zip(PHI, HZ, ZETA, strict=True))
        u.append(force[::FINE])
        y.append(moved[::FINE])
    u, y = (np.array(x)[:, None, :, None] for x in (u, y))
    u, y = (x + s * x.std() * rng.standard_normal(x.shape) for s, x in ((force_noise, u), (noise, y)))
    ports = (Port("hammer", "N"),), (Port("tip", "m/s^2"),)
    return Record(sample_hz=RATE, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=False)


def test_modes_in_the_band_are_right_and_quiet_beside_one_above_it():
    """Free motion of four modes followed the response up to the blow: residues were 20 times their size."""
    record = a_test(blows=(50.0, 42.0, 60.0), seconds=1.2, before_s=0.1, noise=0.01, force_noise=0.003)
    fit = fit_impact(average_blows(record, band_hz=(2.0, 60.0)), states=8)
    order = np.argsort(natural_hz(fit.model))
    within = order[:3]
    assert fit.warnings == ()
    assert [fit.standing[m] for m in order] == ["sound"] * 3 + ["outside"]
    assert "stand for all modes beyond it" in fit.order_reason
    of = fit.uncertainty
    assert np.all(np.abs(natural_hz(fit.model)[within] - HZ[:3]) < 4.0 * of.natural_hz[within])
    assert np.all(np.abs(damping_ratio(fit.model)[within] - ZETA[:3]) < 4.0 * of.damping[within])
    residue = np.abs(fit.model.shapes[0, within] * fit.model.participation[within, 0])
    true = np.abs(PHI[:3] * np.pi * HZ[:3] / np.sqrt(1.0 - ZETA[:3] ** 2))
    assert residue == pytest.approx(true, rel=0.02)


def test_a_lead_is_what_was_recorded_or_rest():
    """An experiment that rings at its beginning has no rest before it."""
    record = a_test(blows=(50.0, 42.0), seconds=1.0, before_s=0.1, noise=1e-3, force_noise=1e-4)
    test = average_blows(record, band_hz=(2.0, 60.0))
    assert test.before.shape == (2, test.blocks.u.shape[2] // 4, 1)
    time = np.arange(record.y.shape[2]) / RATE
    rings = 0.05 * record.y.max() * np.exp(-3.0 * time) * np.sin(2.0 * np.pi * HZ[0] * time)
    ringing = Record(
        sample_hz=RATE,
        u=record.u,
        y=record.y + rings[:, None],
        inputs=record.inputs,
        outputs=record.outputs,
        periodic=False,
    )
    assert average_blows(ringing, band_hz=(2.0, 60.0)).before.shape[1] < 25


def test_little_noise_of_a_blow_makes_no_gain_too_small():
    """Transients take up most of a blow that comes soon, and as much of the noise under its window."""
    record = a_test(blows=(50.0, 42.0, 60.0), seconds=1.2, before_s=0.1, noise=0.002, force_noise=3e-3)
    test = average_blows(record, band_hz=(2.0, 60.0))
    noise = test.rest[..., None]
    fit = fit_record(test.blocks, states=8, band_hz=(2.0, 60.0), input_noise=noise, sampled=False)
    assert not any("makes gains too small" in w for w in fit.warnings)


@pytest.mark.parametrize(("beside_hz", "told"), [(49.4, True), (62.0, False)])
def test_a_pair_just_outside_the_band_is_not_read_as_a_mode_in_silence(beside_hz: float, *, told: bool):
    """It stands for what lies further away, too: it was 7 deviations off, and no warning said so."""
    hz = np.array([12.8, 27.3, beside_hz, 66.0, 97.0, 134.0])
    f, w, rng = np.arange(5.0, 48.01, 0.125), 2.0 * np.pi * hz, np.random.default_rng(5)
    s = 2j * np.pi * f[:, None]
    H = np.sum(np.array([0.7, -0.9, 0.8, 0.9, 0.7, -0.8]) * w * s / (s**2 + 0.02 * w * s + w**2), axis=1)
    noise = 1e-4 * H.std() * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
    response = FrequencyResponse(
        frequency_hz=f,
        H=(H + noise)[:, None, None],
        inputs=(Port("hammer", "N"),),
        outputs=(Port("tip", "m/s"),),
        variance=np.full((len(f), 1, 1), 2e-8 * H.std() ** 2),
        hold_s=0.0,
    )
    fit = fit_response(response, states=8)
    nearest = np.argmin(np.abs(natural_hz(fit.model) - beside_hz))
    error_hz = abs(natural_hz(fit.model)[nearest] - beside_hz)
    assert not told or error_hz > 4.0 * fit.uncertainty.natural_hz[nearest]
    assert any("outside the band" in text for text in fit.warnings) == told
