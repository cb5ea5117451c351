"""The simulated gimbal of the benchmark cases: five modes, delays, random-phase multisines, 1 % noise."""

import numpy as np

from middeck.signals.ports import Port
from middeck.signals.record import Record

MODES_HZ = np.array([1.20, 1.70, 7.05, 8.90, 9.35])
ZETA = 0.01
PHI = np.array(
    [[1.00, 0.80, 0.55, 0.60, 0.50], [1.10, 0.55, 0.75, 0.85, 0.35], [-0.10, 0.45, -0.50, -0.35, 0.42]]
)
PSI = np.array([[1.00, 0.80, 0.55, 0.60, 0.50], [-0.15, 0.60, -0.55, -0.30, 0.60]])
DELAY_S = np.array([0.0100, 0.0100, 0.0145])
INPUTS = (Port("gimbal", "N m"), Port("wheel", "N m"))
OUTPUTS = (Port("payload", "rad"), Port("encoder", "rad"), Port("bus", "rad"))
SCORED_HZ = np.geomspace(0.3, 30.0, 4000)


def response(f, outputs=1, inputs=1, extra=()):
    """Closed form, delays exact; ``extra`` holds (frequency, damping, constant) of further modes."""
    s = 2j * np.pi * np.asarray(f, dtype=float)[:, None, None]
    H = np.zeros((len(f), outputs, inputs), dtype=complex)
    modes = [(f0, ZETA, PHI[:outputs, m, None] * PSI[:inputs, m]) for m, f0 in enumerate(MODES_HZ)]
    for f0, zeta, constant in [*modes, *extra]:
        w = 2.0 * np.pi * f0
        H += constant / (s**2 + 2.0 * zeta * w * s + w**2)
    return H * np.exp(-s * DELAY_S[:outputs, None])


def multisine(seed, *, outputs=1, inputs=1, noise=0.01, extra=(), samples=16384, periods=3, hz=(0.1, 60.0)):
    """A record of orthogonal random-phase multisines of equal amplitudes, at 256 Hz."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(samples, 1.0 / 256.0)
    on = (f >= hz[0]) & (f <= hz[1])
    k = np.arange(inputs)
    U = np.zeros((inputs, len(f), inputs), dtype=complex)
    phases = np.exp(2j * np.pi * rng.random((on.sum(), inputs)))
    U[:, on] = phases * np.exp(2j * np.pi * np.outer(k, k) / inputs)[:, None, :]
    H = np.zeros((len(f), outputs, inputs), dtype=complex)
    H[on] = response(f[on], outputs, inputs, extra)
    u, y = (np.fft.irfft(X, n=samples, axis=1) for X in (U, np.einsum("koi,eki->eko", H, U)))
    u, y = (np.repeat(x[:, None] / u.std(), periods, axis=1) for x in (u, y))
    y = y + noise * np.sqrt(np.mean(y**2, axis=(0, 1, 2))) * rng.standard_normal(y.shape)
    return Record(sample_hz=256.0, u=u, y=y, inputs=INPUTS[:inputs], outputs=OUTPUTS[:outputs], periodic=True)


def complex_error(E, truth):
    return float(np.sqrt(np.sum(np.abs(E - truth) ** 2) / np.sum(np.abs(truth) ** 2)))


def random_record(seed, *, samples=49152, noise=0.01, hz=(0.1, 60.0)):
    """One record cut from four times its length of a steady response to band-limited random noise, 256 Hz."""
    rng = np.random.default_rng(seed)
    long = 4 * samples
    f = np.fft.rfftfreq(long, 1.0 / 256.0)
    on = (f >= hz[0]) & (f <= hz[1])
    U = np.zeros(len(f), dtype=complex)
    U[on] = rng.standard_normal(on.sum()) + 1j * rng.standard_normal(on.sum())
    Y = np.zeros(len(f), dtype=complex)
    Y[on] = response(f[on])[:, 0, 0] * U[on]
    u, y = (np.fft.irfft(X, n=long)[samples : 2 * samples] for X in (U, Y))
    u, y = (x[None, None, :, None] / u.std() for x in (u, y))
    y = y + noise * np.sqrt(np.mean(y**2)) * rng.standard_normal(y.shape)
    return Record(sample_hz=256.0, u=u, y=y, inputs=INPUTS[:1], outputs=OUTPUTS[:1], periodic=False)
