r"""The transient of a record: free motion of the model's poles, in the record's discrete Fourier transform.

A record of N samples of free motion, x(n T) = exp(p n T), has on its lines the transform

    (1 - exp(p N T)) / (1 - exp(p T) exp(-s T)),

a geometric series: exact, aliasing and all, also for a continuous model. So whatever the state at either end
of a record, its spectra are Y = G U + sum_m t_m / (1 - exp(p_m T) exp(-s T)) with free t_m for each output
and experiment (Pintelon and Schoukens 2012, sec. 6.3.2). A double pole at zero adds a constant and a ramp.

What is no free motion is short: with a delay, the first samples answer to the input before the record; and a
band-limited input is not its samples' trigonometric polynomial near the ends. Such samples, the first n and
the last m, add n + m terms exp(-s T j): they are thereby left out of the fit.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.data import Transient
from middeck.identification.fit.layout import Layout, Point

# Edge terms are one and the same, over a narrow band, up to this share.
ALIKE = 1e-9


def transient_columns(
    layout: Layout, point: Point, transient: Transient, s: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "column line"]:
    """Factors of the unknowns of one experiment's transient in one output: poles, then edges."""
    up, low, _ = _series(point.poles, transient, s)
    pairs = layout.pairs
    poles = np.empty((pairs + len(up), len(s)), dtype=complex)
    poles[0 : 2 * pairs : 2] = up[:pairs] + low[:pairs]
    poles[1 : 2 * pairs : 2] = 1j * (up[:pairs] - low[:pairs])
    poles[2 * pairs :] = up[pairs:]
    drift = _drift(transient, s) if layout.with_lower or layout.rigid_pivot else np.zeros((0, len(s)))
    return np.concatenate([poles, drift, _edges(transient, s)])


def transient_slopes(
    layout: Layout,
    point: Point,
    transient: Transient,
    s: Complex[np.ndarray, " line"],
    t: Float[np.ndarray, "experiment column"],
) -> Complex[np.ndarray, "unknown line experiment"]:
    """Derivative of the transients by log sigma and log omega_d, at their unknowns ``t``."""
    up, low, inverse = _series(point.poles, transient, s)
    modes, pairs = len(layout.pair), layout.pairs
    c = np.concatenate(
        [t[:, 0 : 2 * pairs : 2] + 1j * t[:, 1 : 2 * pairs : 2], t[:, 2 * pairs : pairs + modes]], 1
    )
    z = transient.period_s * np.exp(point.poles * transient.period_s)[:, None]
    by_pole = np.einsum("ml,em->mle", z * inverse * up**2, c)
    by_conjugate = np.einsum("ml,em->mle", z[:pairs].conj() * inverse * low[:pairs] ** 2, c[:, :pairs].conj())
    sigma, omega = np.real(point.poles)[:, None, None], np.imag(point.poles)[:pairs, None, None]
    by_sigma = sigma * by_pole
    by_sigma[:pairs] += sigma[:pairs] * by_conjugate
    return np.concatenate([by_sigma, 1j * omega * (by_pole[:pairs] - by_conjugate)])


def _series(
    poles: np.ndarray, transient: Transient, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1/(1 - exp(p T)/z) of each pole and of its conjugate, and 1/z."""
    inverse = np.exp(-s * transient.period_s)
    z = np.exp(poles * transient.period_s)[:, None]
    return 1.0 / (1.0 - z * inverse), 1.0 / (1.0 - z.conj() * inverse), inverse


def _drift(transient: Transient, s: np.ndarray) -> np.ndarray:
    """Free motion of a double pole at zero: a constant, and a ramp."""
    inverse = np.exp(-s * transient.period_s)
    constant = 1.0 / (1.0 - inverse)
    return np.stack([constant, inverse * constant**2])


def _edges(transient: Transient, s: np.ndarray) -> np.ndarray:
    """A basis of the free samples' spectra; they are much alike where the band is narrow."""
    samples = np.concatenate([np.arange(transient.first), -1 - np.arange(transient.last)])
    spectra = np.exp(-s * transient.period_s * samples[:, None])
    if not len(samples):
        return spectra
    _, size, right = np.linalg.svd(spectra.view(float), full_matrices=False)
    return right[size > ALIKE * size[0]].view(complex)
