"""A period that is no whole number of samples, from the phases of the inputs in each period.

Cut into periods of N samples, a signal of period N + d comes d samples later in each: line k turns by
2 pi k d / N, in proportion to its number. Noise of the inputs, and what feedback brings into them, does not.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# Lines that distinguish a turn in proportion to their number from any other.
LINES = 8
# Deviations of the shift, and the turn [rad] that it makes of an input: rounding of computed ones is below.
CERTAIN, TURNED = 8.0, 1e-6
# Share of the turns' square that may be left.
LEFT = 0.25


def length_of_period(u: Float[np.ndarray, "experiment period sample input"]) -> float | None:
    """Samples in a period of the inputs, where they are certainly not those of the record's periods.

    >>> n = np.arange(4 * 64).reshape(1, 4, 64, 1)
    >>> lines = np.arange(1, 17)
    >>> u = np.cos(2.0 * np.pi * n * lines / 64.1 + lines**2).sum(axis=-1, keepdims=True)
    >>> round(length_of_period(u), 1)
    64.1
    """
    periods, samples = u.shape[1:3]
    if periods < 2:
        return None
    U = np.fft.rfft(u, axis=2)[:, :, 1:]
    turned = np.sum(U[:, :-1] * np.conj(U[:, 1:]), axis=(0, 1, 3))
    weight, angle, k = np.abs(turned), np.angle(turned), np.arange(1, samples // 2 + 1)
    if np.count_nonzero(weight > 1e-3 * weight.max(initial=0.0)) < LINES:
        return None
    steep = float(np.sum(weight * k**2))
    slope = float(np.sum(weight * k * angle)) / steep
    left, before = (float(np.sum(weight * each**2)) for each in (angle - slope * k, angle))
    deviation = np.sqrt(left / len(k) / steep)
    turn = abs(slope) * np.sqrt(steep / weight.sum())
    if turn < TURNED or abs(slope) < CERTAIN * deviation or left > LEFT * before:
        return None
    return samples + slope * samples / (2.0 * np.pi)
