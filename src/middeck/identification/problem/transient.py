r"""The transient of a record: free motion of the model's poles, in the record's discrete Fourier transform.

A record of N samples of free motion, x(n T) = exp(p n T), has on its lines the transform

    (1 - exp(p N T)) / (1 - exp(p T) exp(-s T)),

a geometric series: exact, aliasing and all, also for a continuous model. So whatever the state at either end
of a record, its spectra are Y = G U + sum_m t_m / (1 - exp(p_m T) exp(-s T)) with free t_m for each output
and experiment (Pintelon and Schoukens 2012, sec. 6.3.2).

A sensor drifts, and a pole at zero does not decay: polynomials in time are on the lines as free motion is. Of
a constant there is nothing; a ramp leaves 1/(1 - exp(-s T)), which is always among the terms, also for an
integrator; a parabola, that of a double pole at zero, the square of that. The ramp of an input's sensor comes
through a stable plant as a ramp, a constant and free motion, and is thereby taken care of too.

What is no free motion is short: with a delay, the first samples answer to the input before the record; and a
band-limited input is not its samples' trigonometric polynomial near the ends. Such samples, the first n and
the last m, add n + m terms exp(-s T j): they are thereby left out of the fit. Steady sines that no input
makes, such as hum, are given as their spectra.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data, Transient
from middeck.identification.problem.unknowns_layout import Layout, Point


def transient_columns(
    layout: Layout, point: Point, transient: Transient, data: Data
) -> Complex[np.ndarray, "column line"]:
    """Factors of the unknowns of one experiment's transient in one output: poles, then drift and edges."""
    up, low, _ = _series(point.poles, transient, data.s)
    pairs = layout.pairs
    poles = np.empty((pairs + len(up), len(data.s)), dtype=complex)
    poles[0 : 2 * pairs : 2] = up[:pairs] + low[:pairs]
    poles[1 : 2 * pairs : 2] = 1j * (up[:pairs] - low[:pairs])
    poles[2 * pairs :] = up[pairs:]
    double = layout.options.residuals or bool(layout.rigid_pivot)
    return np.concatenate([poles, data.drift_and_edges[double]])


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
