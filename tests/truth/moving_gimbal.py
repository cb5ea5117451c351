"""The benchmark's gimbal with modes that move in time, at 256 Hz, propagated exactly."""

import dataclasses

import gimbal_model
import gimbal_record
import numpy as np
import scipy.signal

from middeck.signals.excitation.band_noise import design_noise
from middeck.signals.excitation.limits import Limits
from middeck.signals.record import Record

RATE = 256.0
T = 1.0 / RATE
HOLD = 0.5 * T


def motion_of_mode(v, delay, hz, zeta):
    """q'' + 2 zeta w q' + w^2 q = v, v held and late; hz and zeta for each sample, constant by segments.

    In z with q = 2 Re z, q' = 2 Re(lambda z) a step is z' = e z + drive, a recursion of first order; where
    the frequency steps, q and q' go on and z is found anew.
    """
    whole = int(np.floor(delay / T + 1e-9))
    part = delay - whole * T
    padded = np.concatenate([np.zeros(whole + 1), v])
    old, new = padded[: len(v)], padded[1 : len(v) + 1]
    edges = np.flatnonzero((np.diff(hz) != 0.0) | (np.diff(zeta) != 0.0)) + 1
    q, place, rate = np.empty(len(v)), 0.0, 0.0
    for k, end in zip(np.r_[0, edges], np.r_[edges, len(v)], strict=True):
        w = 2.0 * np.pi * hz[k]
        pole = w * (-zeta[k] + 1j * np.sqrt(1.0 - zeta[k] ** 2))
        b = 1.0 / (2j * pole.imag)
        late_gain, early_gain = (np.expm1(pole * h) / pole for h in (T - part, part))
        drive = b * (late_gain * new[k:end] + np.exp(pole * (T - part)) * early_gain * old[k:end])
        e = np.exp(pole * T)
        start = (rate - np.conj(pole) * place) / (2j * pole.imag)
        after = scipy.signal.lfilter([1.0], [1.0, -e], drive, zi=[e * start])[0]
        q[k:end] = 2.0 * np.real(np.concatenate([[start], after[:-1]]))
        place, rate = 2.0 * np.real(after[-1]), 2.0 * np.real(pole * after[-1])
    return q


def record(seed, seconds, *, hz=None, zeta=None, outputs=1, noise=0.01, inputs=1):
    """From rest under white noise of 0.1 to 60 Hz; ``hz``, ``zeta`` for each sample and mode."""
    rng = np.random.default_rng(seed)
    samples = round(seconds * RATE)
    u = design_noise((0.1, 60.0), seconds, RATE, Limits(rms=1.0), rng, inputs=inputs).u[0]
    hz = np.broadcast_to(gimbal_record.MODES_HZ if hz is None else hz, (samples, 5))
    zeta = np.broadcast_to(gimbal_record.ZETA if zeta is None else zeta, (samples, 5))
    phi, psi = gimbal_record.PHI[:outputs], gimbal_record.PSI[:inputs]
    y = np.zeros((samples, outputs))
    for o in range(outputs):
        delay = gimbal_record.DELAY_S[o] - HOLD
        modes = [motion_of_mode(u @ psi[:, m], delay, hz[:, m], zeta[:, m]) for m in range(5)]
        y[:, o] = phi[o] @ np.array(modes)
    rms = noise * np.sqrt(np.mean(y**2, axis=0))
    y = y + rms * rng.standard_normal(y.shape)
    taken = Record(sample_hz=RATE, u=u[None, None], y=y[None, None], inputs=gimbal_record.INPUTS[:inputs],
                   outputs=gimbal_record.OUTPUTS[:outputs], periodic=False)  # fmt: skip
    return taken, rms


def model(*, frequency=0.0, damping=0.0, outputs=1, inputs=1):
    """The model of a perfect test of held inputs, off by these relative errors; phi psi are right."""
    right = gimbal_model.model(outputs, inputs)
    omega = 2.0 * np.pi * gimbal_record.MODES_HZ * (1.0 + np.asarray(frequency))
    zeta = gimbal_record.ZETA * (1.0 + np.asarray(damping)) * np.ones(5)
    poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    shapes = right.shapes * np.imag(right.poles) / np.imag(poles) * np.sinc(omega / (2.0 * np.pi) * T)
    return dataclasses.replace(right, poles=poles, shapes=shapes)
