"""Periodic test signals."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError


def random_multisine(
    band_hz: tuple[float, float], period_s: float, sample_hz: float, rms: float, rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """One period of equal cosines on every line of the band, phases uniform at random.

    Lines are the multiples of 1/``period_s`` within ``band_hz``, limits included (Pintelon and Schoukens
    2012, section 5.2). The crest factor is near that of noise, 3 to 4. Raises `ConfigError` if the period
    is not a whole number of samples, if the band holds no line, or if it reaches half the sampling rate.

    >>> u = random_multisine((1.0, 8.0), 4.0, 64.0, 0.5, np.random.default_rng(0))
    >>> u.shape, round(float(np.sqrt(np.mean(u**2))), 12)
    ((256,), 0.5)
    """
    samples = round(period_s * sample_hz)
    # 1e-9 of a sample: decimals are not exact in binary.
    if samples < 1 or abs(samples - period_s * sample_hz) > 1e-9 * samples:
        raise ConfigError(
            f"a period of {period_s} s at {sample_hz} Hz is {period_s * sample_hz} samples",
            hint="choose a period that is a whole number of samples",
        )
    first = max(1, int(np.ceil(band_hz[0] * period_s - 1e-9)))
    last = int(np.floor(band_hz[1] * period_s + 1e-9))
    if last < first:
        raise ConfigError(f"no line of 1/{period_s} Hz lies in {band_hz} Hz", hint="use a longer period")
    if 2 * last >= samples:
        raise ConfigError(
            f"{last / period_s} Hz is not below half of {sample_hz} Hz",
            hint="sample faster or narrow the band",
        )
    count = last - first + 1
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    # rms^2 = count amplitude^2 / 2, and irfft turns amplitude * samples / 2 into a cosine of that amplitude.
    amplitude = rms * np.sqrt(2.0 / count)
    spectrum[first : last + 1] = 0.5 * samples * amplitude * np.exp(2j * np.pi * rng.random(count))
    return np.asarray(np.fft.irfft(spectrum, samples))
