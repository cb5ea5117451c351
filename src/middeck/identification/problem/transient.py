"""The transient of a record: free motion of the model's poles, in the record's discrete Fourier transform.

N samples of free motion, x(n T) = exp(p n T), have the transform (a geometric series, exact)

    (1 - exp(p N T)) / (1 - exp(p T) exp(-s T)).

So, for any state at either end of a record, its spectra are Y = G U + sum_m t_m / (1 - exp(p_m T) exp(-s T))
with free t_m for each output and experiment (Pintelon and Schoukens 2012, sec. 6.3.2).

Drift of a sensor and poles at zero are polynomials in time. A constant leaves nothing on the lines; a ramp
leaves 1/(1 - exp(-s T)), always among the terms; a parabola, of a double pole at zero, its square. These
cover the ramp of an input's sensor too, which leaves a stable plant as a ramp, a constant and free motion.

The rest is short: with a delay the first samples respond to inputs before the record, and a band-limited
input differs from its samples' trigonometric polynomial near the ends. The first n and last m samples
therefore add n + m terms exp(-s T j), which takes them out of the fit, and three alternating tails at each
end (`Transient`) follow what is left beside them. Sines without an input (hum) are given as spectra.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Layout, Point


class FreeMotion(NamedTuple):
    """1/(1 - exp(p T)/z) of each pole and of its conjugate, and their derivatives by p and by conj p."""

    upper: Complex[np.ndarray, "mode line"]
    lower: Complex[np.ndarray, "mode line"]
    upper_slope: Complex[np.ndarray, "mode line"]
    lower_slope: Complex[np.ndarray, "mode line"]


def free_motion(poles: Complex[np.ndarray, " mode"], data: Data) -> FreeMotion:
    """The transforms of free motion on the lines of the data."""
    assert data.transient is not None
    T = data.transient.period_s
    inverse, z = data.a_sample_late, np.exp(poles * T)[:, None]
    first, second = z * inverse, z.conj() * inverse
    up, low = 1.0 / (1.0 - first), 1.0 / (1.0 - second)
    return FreeMotion(up, low, T * first * up**2, T * second * low**2)


def transient_columns(layout: Layout, motion: FreeMotion, data: Data) -> Complex[np.ndarray, "column line"]:
    """Factors of the unknowns of one experiment's transient in one output: poles, then drift and edges."""
    up, low, pairs = motion.upper, motion.lower, layout.pairs
    poles = np.empty((pairs + len(up), len(data.s)), dtype=complex)
    poles[0 : 2 * pairs : 2] = up[:pairs] + low[:pairs]
    poles[1 : 2 * pairs : 2] = 1j * (up[:pairs] - low[:pairs])
    poles[2 * pairs :] = up[pairs:]
    double = layout.options.residuals or bool(layout.rigid_pivot)
    return np.concatenate([poles, data.drift_and_edges(2 if double else 1)])


def transient_slopes(
    layout: Layout, point: Point, motion: FreeMotion, t: Float[np.ndarray, "experiment column"]
) -> Complex[np.ndarray, "unknown line experiment"]:
    """Derivative of the transients by log sigma and log omega_d, at their unknowns ``t``."""
    modes, pairs = len(layout.pair), layout.pairs
    c = np.concatenate(
        [t[:, 0 : 2 * pairs : 2] + 1j * t[:, 1 : 2 * pairs : 2], t[:, 2 * pairs : pairs + modes]], 1
    ).T[:, None]
    by_pole = motion.upper_slope[:, :, None] * c
    by_conjugate = motion.lower_slope[:pairs, :, None] * c[:pairs].conj()
    sigma, omega = np.real(point.poles)[:, None, None], np.imag(point.poles)[:pairs, None, None]
    by_sigma = sigma * by_pole
    by_sigma[:pairs] += sigma[:pairs] * by_conjugate
    return np.concatenate([by_sigma, 1j * omega * (by_pole[:pairs] - by_conjugate)])
