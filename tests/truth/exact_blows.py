"""Hammer tests of modal articles, exact: blows are sums of exponentials, as are the responses to them."""

from __future__ import annotations

import numpy as np

from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.signals.ports import Port
from middeck.signals.record import Record

UNITS = {"d": "m", "v": "m/s", "a": "m/s^2"}
# Blows of one second and height: factors and rates of their exponentials.
SHAPES = {
    "half sine": ((-0.5j, 1j * np.pi), (0.5j, -1j * np.pi)),
    "haversine": ((0.5, 0.0), (-0.25, 2j * np.pi), (-0.25, -2j * np.pi)),
}


def exact_blows(
    modes, blows, count, rate, *, shape="haversine", kind="d", noise=1e-3, force_noise=1e-4, seed=0
):
    """Each experiment has its ``blows``: time [s], width [s], size; ``modes``: hz, zeta, phi [output, mode].

    ``noise`` is a share of the rms of each output, ``force_noise`` of the largest force.
    """
    hz, zeta, phi = (np.asarray(x, float) for x in modes)
    poles = 2.0 * np.pi * hz * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    u, y = np.zeros((len(blows), count)), np.zeros((len(blows), count, len(phi)))
    for e, own in enumerate(blows):
        for time, width, size in own:
            t = np.arange(count) / rate - time
            within = np.clip(t, 0.0, width)
            force = size * sum(a * np.exp(g * within / width) for a, g in SHAPES[shape]).real
            force[(t < 0.0) | (t > width)] = 0.0
            u[e] += force
            for m, p in enumerate(poles):
                rates = [(a, g / width) for a, g in SHAPES[shape]]
                q = sum(a * (np.exp(g * within) - np.exp(p * within)) / (g - p) for a, g in rates)
                q = size * q * np.exp(p * np.maximum(t - width, 0.0)) / p.imag
                moved = {"d": q.imag, "v": (p * q).imag, "a": (p**2 * q).imag + force}[kind]
                y[e] += moved[:, None] * phi[:, m]
    rng = np.random.default_rng(seed)
    y += noise * y.std(axis=(0, 1)) * rng.standard_normal(y.shape)
    u += force_noise * u.max() * rng.standard_normal(u.shape)
    outputs = tuple(Port(f"y{o}", UNITS[kind]) for o in range(len(phi)))
    return Record(
        sample_hz=rate,
        u=u[:, None, :, None],
        y=y[:, None],
        inputs=(Port("hammer", "N"),),
        outputs=outputs,
        periodic=False,
    )


def deviations_off(fit, hz, zeta):
    """Errors of natural frequencies and damping ratios in stated deviations: of the mode nearest to each."""
    f, known = natural_hz(fit.model), fit.uncertainty
    near = [int(np.argmin(np.abs(f - own))) for own in hz]
    return np.array(
        [
            (f[near] - hz) / known.natural_hz[near],
            (damping_ratio(fit.model)[near] - zeta) / known.damping[near],
        ]
    )
