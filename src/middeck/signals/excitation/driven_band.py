"""Band driven by a signal that does not repeat; beyond it the input of a cut record is leakage."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# As many sine tapers: their spectra leak with the fourth power of the distance (Riedel and Sidorenko 1995),
# their sum hears nearly all of the record alike, as a sweep asks for, and their mean is smooth over as many
# lines, as noise asks for.
TAPERS = 9
# Power that still counts as driven, of the largest: 20 dB less.
FAINT = 0.01


def driven_band(u: Float[np.ndarray, "experiment sample input"], sample_hz: float) -> tuple[float, float]:
    """First and last frequency [Hz] that the inputs drive to a tenth of their strength; (0, 0) for silence.

    >>> t = np.arange(1000) / 100.0
    >>> low, high = driven_band(np.sin(2.0 * np.pi * 20.05 * t)[None, :, None], 100.0)
    >>> 19.0 < low < high < 21.0
    True
    """
    u = u - u.mean(axis=1, keepdims=True)
    size = np.sum(u**2, axis=(0, 1))
    if not size.any():
        return 0.0, 0.0
    samples = u.shape[1]
    phase = np.pi * (np.arange(samples) + 0.5) / samples
    power = np.zeros(samples // 2 + 1)
    for k in range(1, TAPERS + 1):
        U = np.fft.rfft(u * np.sin(k * phase)[:, None], axis=1)
        power += np.sum(np.abs(U) ** 2 / np.where(size > 0.0, size, 1.0), axis=(0, 2))
    lines = np.flatnonzero(power > FAINT * power.max())
    return float(lines[0] * sample_hz / samples), float(lines[-1] * sample_hz / samples)
