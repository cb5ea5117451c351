"""A large record: its order from some lines and principal outputs, its kind from its inputs."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from middeck.identification.model.measurement_model import is_mode
from middeck.identification.record_fit.fit_record import fit_record, is_held
from middeck.identification.record_fit.simulation import record_nrmse
from middeck.identification.record_fit.spectra import as_fitted
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
    said = []
    fitted = fit_record(record, tell=said.append)
    assert fitted.model.sample_hz == 1.0
    assert "sampled, as the inputs drive all" in fitted.order_reason
    assert fitted.model.states == 4
    assert is_mode(fitted.model, 1.0).all()
    at = np.argsort(np.imag(fitted.model.poles))
    off = (np.abs(fitted.model.poles[at]) - np.abs(POLES)) / (2.0 * np.pi * fitted.uncertainty.natural_hz[at])
    assert np.abs(off).max() < 4.0
    np.testing.assert_allclose(fitted.error, NOISE, rtol=0.1)
    assert said[0] == "2 states"
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
