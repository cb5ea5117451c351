"""Records of modal plants, simulated exactly: in the frequency domain, padded until motion has decayed."""

import numpy as np

from middeck.signals.ports import Port
from middeck.signals.record import Record

FORCE, TIP = Port("force", "N"), Port("tip", "m")


def response(hz, zeta, phi, delay_s, s):
    """Sum of phi / (s^2 + 2 zeta omega s + omega^2), delayed."""
    w = 2.0 * np.pi * np.asarray(hz)
    z, p = np.asarray(zeta), np.asarray(phi)
    return np.exp(-s * delay_s) * np.sum(p / (s[:, None] ** 2 + 2.0 * z * w * s[:, None] + w**2), axis=1)


def grid(hz, zeta, count, rate):
    """Lines of a record so long that nothing is left of free motion."""
    slowest = float(np.min(np.asarray(zeta) * np.asarray(hz)) * 2.0 * np.pi)
    size = int(2 ** np.ceil(np.log2(count + 40.0 / slowest * rate)))
    return size, np.fft.rfftfreq(size, 1.0 / rate)


def struck(plant, blows, count, rate, *, noise, seed=0, scatter=None):
    """``blows`` are (time [s], width [s], size); ``scatter`` multiplies the residues of each blow."""
    hz, zeta, phi, delay_s = plant
    size, f = grid(hz, zeta, count, rate)
    s = 2j * np.pi * f
    filters = np.where(
        f < 0.4 * rate, 1.0, np.cos(np.clip((f / rate - 0.4) / 0.1, 0.0, 1.0) * np.pi / 2) ** 2
    )
    U, Y = np.zeros(len(f), complex), np.zeros(len(f), complex)
    for k, (time, width, largest) in enumerate(blows):
        X = largest * width * np.exp(-s * time - (f * width) ** 2) * filters * rate
        U += X
        Y += response(hz, zeta, np.asarray(phi) * (1.0 if scatter is None else scatter[k]), delay_s, s) * X
    return _record(U, Y, size, count, rate, noise, seed)


def shaken(plant, count, rate, band_hz, *, noise, seed=0):
    """By band-limited noise, from rest before the record."""
    hz, zeta, phi, delay_s = plant
    size, f = grid(hz, zeta, count, rate)
    rng = np.random.default_rng([seed, 1])
    U = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) * np.sqrt(size)
    U *= (f > band_hz[0]) & (f < band_hz[1])
    return _record(U, response(hz, zeta, phi, delay_s, 2j * np.pi * f) * U, size, count, rate, noise, seed)


def _record(U, Y, size, count, rate, noise, seed):
    u, y = (np.fft.irfft(X, size)[:count] for X in (U, Y))
    y = y + noise * y.std() * np.random.default_rng(seed).standard_normal(count)
    return Record(
        sample_hz=rate,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=(FORCE,),
        outputs=(TIP,),
        periodic=False,
    )
