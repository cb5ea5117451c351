"""Records of the gimbal and of the like: one random record, and one cut from a long periodic run."""

import gimbal_record
import numpy as np

from middeck.identification.model.measurement_model import model_response, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import LONG


def test_one_random_record_of_the_gimbal(campaign):
    truth = gimbal_record.response(gimbal_record.SCORED_HZ)
    errors, delays = [], []
    shorter = 1 if LONG else 4  # with less noise, so that it says as much
    for seed in campaign(20, 6):
        record = gimbal_record.random_record(seed, samples=49152 // shorter, noise=0.01 / np.sqrt(shorter))
        model = fit_record(record, states=10, band_hz=(0.1, 60.0)).model
        errors.append(gimbal_record.complex_error(model_response(model, gimbal_record.SCORED_HZ), truth))
        delays.append(model.delay_s[0] - gimbal_record.DELAY_S[0])
    # The frozen case asks for 1.5e-4 in the median and 0.05 ms.
    assert np.median(errors) < 1.5e-4
    assert np.abs(delays).max() < 0.05e-3


def test_a_record_cut_from_a_long_periodic_run_takes_its_start_from_its_samples():
    """20.3 periods of a multisine: local models give a delay of seconds, which no start may keep."""
    rate, period = 128.0, 512
    rng = np.random.default_rng(1)
    f = np.fft.rfftfreq(period, 1.0 / rate)
    on = (f >= 0.5) & (f <= 45.0)
    s = 2j * np.pi * f
    omega = 2.0 * np.pi * np.array([3.0, 8.5, 9.3, 22.0])
    G = np.exp(-0.010 * s) * np.sum(1.0 / (s[:, None] ** 2 + 0.02 * omega * s[:, None] + omega**2), axis=1)
    U = np.where(on, np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    keep = slice(150, 150 + int(20.3 * period))
    u, y = (np.tile(np.fft.irfft(X, n=period), 22)[keep] for X in (U, U * G))
    y = y + 0.01 * y.std() * rng.standard_normal(y.shape)
    ports = (Port("torque", "N m"),), (Port("angle", "rad"),)
    taken = Record(
        sample_hz=rate,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=False,
    )
    fitted = fit_record(taken, states=8, band_hz=(0.5, 45.0))
    deviation = fitted.uncertainty.natural_hz
    order = np.argsort(natural_hz(fitted.model))
    off = np.abs(natural_hz(fitted.model)[order] - omega / (2.0 * np.pi))
    assert np.all(off < 4.0 * deviation[order])
    assert abs(fitted.model.delay_s[0] - 0.010) < 4.0 * fitted.uncertainty.delay_s[0]
