"""Band driven by a signal that does not repeat; beyond it the input of a cut record is leakage, or noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# As many sine tapers: their spectra leak with the fourth power of the distance (Riedel and Sidorenko 1995),
# their sum weights nearly all of the record alike, as a sweep asks for, and their mean is smooth over as many
# lines, as noise asks for.
TAPERS = 9
# Power that still counts as driven, of the largest: 20 dB less.
FAINT = 0.01
# Lines over which the floor of a spectrum is averaged, and the most of the largest power that is one.
FLOOR_LINES, FLOOR = 32, 0.03
# Share of the lines that lie lowest, and that have up to twice as much: behind a filter that falls to zero,
# 1.4 times as many.
LOWEST, FLAT = 0.03, 0.05
# Share of a record that fades at either end.
ENDS = 0.1

# Share of half the rate from which the slope of a spectrum is taken, and half the width of averages there.
SLOPE_FROM, WIDE = 0.8, 0.03


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
    power = np.sum(_tapered_power(u) / np.where(size > 0.0, size, 1.0), axis=1)
    lines = np.flatnonzero(power > FAINT * power.max())
    return float(lines[0] * sample_hz / u.shape[1]), float(lines[-1] * sample_hz / u.shape[1])


def floor_variance(u: Float[np.ndarray, "experiment sample input"]) -> Float[np.ndarray, " input"]:
    """Variance of the largest white noise that each input's spectrum has room for.

    Zero for an input that drives all frequencies, or less and less: it has no floor, and shows no noise.
    """
    power = _tapered_power(_faded(u))[2 * TAPERS :]
    if len(power) < FLOOR_LINES:
        return np.zeros(u.shape[2])
    total: np.ndarray = np.cumsum(np.pad(power, ((1, 0), (0, 0))), axis=0)
    smooth = (total[FLOOR_LINES:] - total[:-FLOOR_LINES]) / FLOOR_LINES
    least = np.quantile(smooth, LOWEST, axis=0)
    flat = smooth < 2.0 * least
    level = np.sum(smooth * flat, axis=0) / np.maximum(flat.sum(axis=0), 1)
    floor = (least < FLOOR * smooth.max(axis=0)) & (flat.mean(axis=0) > FLAT)
    return np.where(floor, 2.0 * level / (TAPERS * len(u) * u.shape[1]), 0.0)


def folded_power(
    u: Float[np.ndarray, "experiment sample input"], share: Float[np.ndarray, " line"]
) -> Float[np.ndarray, "line input"]:
    """Power folded back onto lines at a ``share`` of half the rate; for white noise its variance.

    A slope that goes on beyond half the rate as x^-m is folded at x = 1 into x^-m + (2 - x)^-m, near it
    2 cosh(m (1 - x)). No bound: it is too much where a filter's slope steepens beyond half the rate, as most
    do, and too little where it levels off, as behind a filter with a floor in its stop band.
    """
    power = 2.0 * _tapered_power(_faded(u)) / (TAPERS * len(u) * u.shape[1])
    x = np.linspace(0.0, 1.0, len(power))
    top, below = (
        np.mean(power[np.abs(x - at) <= max(WIDE, 1.0 / len(x))], axis=0) for at in (1.0, SLOPE_FROM)
    )
    ratio = np.divide(below, top, out=np.full_like(top, np.inf), where=top > 0.0)
    return 0.5 * top * (2.0 - share[:, None]) ** (-np.arccosh(np.maximum(ratio, 1.0)) / (1.0 - SLOPE_FROM))


def _faded(u: Float[np.ndarray, "experiment sample input"]) -> Float[np.ndarray, "experiment sample input"]:
    """The signal without its mean, its ends tapered with three smooth derivatives, white noise scaled back.

    What leaks through the tapers alone, 1e-4 of the rms, would pass for noise.
    """
    samples = u.shape[1]
    x = (np.arange(samples) + 0.5) / samples
    r = np.clip(np.minimum(x, 1.0 - x) / ENDS, 0.0, 1.0)
    fade = r**4 * (35.0 - 84.0 * r + 70.0 * r**2 - 20.0 * r**3)
    tapers = np.sum(np.sin(np.pi * np.outer(np.arange(1, TAPERS + 1), x)) ** 2, axis=0)
    kept = np.sum(tapers * fade**2) / np.sum(tapers)
    return (u - u.mean(axis=1, keepdims=True)) * (fade / np.sqrt(kept))[:, None]


def _tapered_power(u: Float[np.ndarray, "experiment sample input"]) -> Float[np.ndarray, "line input"]:
    """Sum over experiments and tapers."""
    samples = u.shape[1]
    phase = np.pi * (np.arange(samples) + 0.5) / samples
    power = np.zeros((samples // 2 + 1, u.shape[2]))
    for k in range(1, TAPERS + 1):
        power += np.sum(np.abs(np.fft.rfft(u * np.sin(k * phase)[:, None], axis=1)) ** 2, axis=0)
    return power
