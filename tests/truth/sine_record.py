"""Records of modal plants under sums of sines that share no period: steady and free motion, exactly."""

import numpy as np
from struck_plant import FORCE, TIP, response

from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.signals.ports import Port
from middeck.signals.record import Record

RATE = 100.0


def sines(rng, band_hz, count):
    """Frequencies [Hz], one in each of ``count`` even parts of the band, and complex amplitudes."""
    hz = band_hz[0] + (band_hz[1] - band_hz[0]) * (np.arange(count) + rng.uniform(size=count)) / count
    return hz, rng.standard_normal(count) + 1j * rng.standard_normal(count)


def summed(hz, amplitude, t):
    """Real part of the sum of ``amplitude`` exp(2 pi j ``hz`` t), the times ``t`` even and from zero."""
    block = int(np.sqrt(len(t)))
    begins, within = (np.exp(2j * np.pi * np.outer(part, hz)) for part in (t[::block], t[:block]))
    return np.real((begins * amplitude) @ within.T).ravel()[: len(t)]


def driven(plant, rng, count, band_hz, *, noise, free=1.0):
    """A record of ``count`` samples; ``free`` motion and ``noise`` of the output are shares of its rms."""
    hz, zeta, phi, delay_s = plant
    t = np.arange(count) / RATE
    f, a = sines(rng, band_hz, count // 2)
    u = summed(f, a, t)
    y = summed(f, a * response(hz, zeta, phi, delay_s, 2j * np.pi * f), t)
    omega = 2.0 * np.pi * hz
    poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    begun = rng.standard_normal(len(hz)) + 1j * rng.standard_normal(len(hz))
    y = y + free * y.std() * np.real(np.exp(np.outer(t, poles)) @ begun)
    return record_of(u, y + noise * y.std() * rng.standard_normal(count))


def record_of(u, y, *, sample_hz=RATE, output: Port = TIP):
    """One input and one output, not periodic."""
    u, y = u[None, None, :, None], y[None, None, :, None]
    return Record(sample_hz=sample_hz, u=u, y=y, inputs=(FORCE,), outputs=(output,), periodic=False)


def deviations_off(fit, plant):
    """Frequencies, damping ratios and the delay less the true ones, over their stated deviations."""
    hz, zeta, _, delay_s = plant
    found, spread = natural_hz(fit.model), fit.uncertainty
    at = [int(np.argmin(np.abs(found - f))) for f in hz]
    return np.concatenate(
        [
            (found[at] - hz) / spread.natural_hz[at],
            (damping_ratio(fit.model)[at] - zeta) / spread.damping[at],
            (fit.model.delay_s - delay_s) / spread.delay_s,
        ]
    )
