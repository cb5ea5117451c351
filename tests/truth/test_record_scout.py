"""A large record: its order from some lines and principal outputs, its kind from its inputs."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from middeck.identification.model.measurement_model import is_mode, natural_hz
from middeck.identification.record_fit import reduced_record
from middeck.identification.record_fit.fit_record import fit_record, is_held
from middeck.identification.record_fit.record_spectra import as_fitted
from middeck.identification.record_fit.simulate_record import record_nrmse
from middeck.signals.ports import Port
from middeck.signals.record import Record

POLES = np.array([-0.01 + 0.6j, -0.008 + 1.9j])
NOISE = 0.02


def held(seed, *, samples=1500, outputs=6):
    """Two modes under white noise, given sample by sample; six sensors see them differently."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples)
    motion = np.array([lfilter([0.0, 1.0], [1.0, -np.exp(p)], u) for p in POLES])
    c = rng.standard_normal((outputs, 2)) + 1j * rng.standard_normal((outputs, 2))
    y = np.real(c @ motion).T
    y = y + NOISE * y.std(axis=0) * rng.standard_normal(y.shape)
    ports = (Port("u", "N"),), tuple(Port(f"y{k}", "m") for k in range(outputs))
    return Record(
        sample_hz=1.0,
        u=u[None, None, :, None],
        y=y[None, None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=False,
    )


def test_a_large_record_has_the_order_and_poles_of_its_truth_and_scores_without_offsets():
    record = held(0)
    warnings = []
    fitted = fit_record(record, tell=warnings.append)
    assert fitted.model.sample_hz == 1.0
    assert "sampled, as the inputs drive all" in fitted.order_reason
    assert fitted.model.states == 4
    assert is_mode(fitted.model, 1.0).all()
    at = np.argsort(np.imag(fitted.model.poles))
    off = (np.abs(fitted.model.poles[at]) - np.abs(POLES)) / (2.0 * np.pi * fitted.uncertainty.natural_hz[at])
    assert np.abs(off).max() < 4.0
    np.testing.assert_allclose(fitted.error, NOISE, rtol=0.1)
    assert warnings[0] == "2 states"
    moved = dataclasses.replace(record, y=record.y + 50.0, u=record.u + 1.0)
    assert record_nrmse(fitted.model, moved, state_share=0.25).max() > 10.0 * NOISE
    assert record_nrmse(fitted.model, as_fitted(moved, fitted.model), state_share=0.25).max() < 1.5 * NOISE


@pytest.mark.parametrize(
    ("low_pass", "band_hz", "expected"), [(0, None, True), (1, None, False), (0, (0.0, 0.1), False)]
)
def test_inputs_are_held_where_they_are_driven_to_half_the_rate(low_pass, band_hz, expected):
    record = held(1)
    if low_pass:
        U = np.fft.rfft(record.u, axis=2)
        U[:, :, 500:] = 0.0
        record = dataclasses.replace(record, u=np.fft.irfft(U, 1500, axis=2))
    assert is_held(record, band_hz) == expected


def shaken(seed, *, outputs=4, samples=1000, rate=64.0):
    """Three modes, the last of which one sensor alone sees; each sensor has a delay of its own."""
    rng = np.random.default_rng(seed)
    size = 2 * samples
    f = np.fft.rfftfreq(size, 1.0 / rate)
    U = (rng.standard_normal((len(f), 2)) + 1j * rng.standard_normal((len(f), 2))) * ((f > 0.5) & (f < 28.0))[
        :, None
    ]
    hz, damping, s = np.array([3.0, 7.5, 13.0]), 0.01, 2j * np.pi * f
    C, B = rng.uniform(0.5, 1.5, (outputs, 3)), rng.choice([-1.0, 1.0], (3, 2)) * hz[:, None]
    C[:, 2] = 0.5 * (np.arange(outputs) == 2)
    w = 2.0 * np.pi * hz
    modes = 1.0 / (s[:, None] ** 2 + 2.0 * damping * w * s[:, None] + w**2)
    H = (
        np.einsum("om,km,mi->koi", C, modes, B)
        * np.exp(-np.outer(s, rng.uniform(0.0, 0.05, outputs)))[:, :, None]
    )
    u = np.fft.irfft(U, size, axis=0)[-samples:]
    y = np.fft.irfft(np.einsum("koi,ki->ko", H, U), size, axis=0)[-samples:]
    y = y + NOISE * y.std(axis=0) * rng.standard_normal(y.shape)
    ports = tuple(Port(f"u{k}", "N") for k in range(2)), tuple(Port(f"y{k}", "m") for k in range(outputs))
    return hz, Record(
        sample_hz=rate, u=u[None, None], y=y[None, None], inputs=ports[0], outputs=ports[1], periodic=False
    )


def test_of_many_sensors_a_few_tell_the_order_and_a_mode_that_one_alone_sees_is_found(monkeypatch):
    monkeypatch.setattr(reduced_record, "FEW", 1)
    monkeypatch.setattr(reduced_record, "LARGE", 1000)
    hz, record = shaken(0)
    warnings = []
    fitted = fit_record(record, sampled=False, tell=warnings.append)
    f = natural_hz(fitted.model)
    assert warnings[0] == "2 states"
    of_modes = ["modes that few outputs did not show", "modes that are none, or two"]
    assert warnings[-3:] == ["4 states, on all outputs", *of_modes]
    assert len(f) == len(hz)
    assert np.abs((np.sort(f) - hz) / fitted.uncertainty.natural_hz[np.argsort(f)]).max() < 4.0
    np.testing.assert_allclose(fitted.error, NOISE, rtol=0.15)
