"""Band-limited noise, whole or in bursts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.signals.excitation.grids import band_lines, whole_samples
from middeck.signals.excitation.limits import Limits, as_large_as_allowed
from middeck.signals.excitation.signal import Excitation

# Share of a burst over which it rises and falls: a hard edge would leave the band.
TAPER = 0.05


def design_noise(
    band_hz: tuple[float, float],
    duration_s: float,
    sample_hz: float,
    limits: Limits | Sequence[Limits],
    rng: np.random.Generator,
    *,
    inputs: int = 1,
    experiments: int = 1,
) -> Excitation:
    """Gaussian noise of even intensity in the band, without repetition; inputs are independent.

    Cut from a period of twice the length, so that its ends do not meet. Where a response is wanted, a
    multisine of the same band and power has no leakage and says more; noise is for records that must not
    repeat. Raises `ConfigError` as `random_multisine`.

    >>> made = design_noise((1.0, 8.0), 16.0, 64.0, Limits(rms=1.0), np.random.default_rng(0))
    >>> made.u.shape, made.periodic
    ((1, 1024, 1), False)
    """
    samples = whole_samples(duration_s, sample_hz)
    u = _gaussian(band_hz, 2 * samples, sample_hz, (experiments, inputs), rng)[:, :samples]
    first, last = band_lines(band_hz, duration_s, sample_hz)
    what = f"Gaussian noise from {band_hz[0]:.6g} to {band_hz[1]:.6g} Hz, {duration_s:.6g} s, not repeated"
    lines = np.arange(first, last + 1)
    return as_large_as_allowed("noise", what, u, lines, limits, sample_hz, periodic=False)


def design_burst(
    band_hz: tuple[float, float],
    period_s: float,
    sample_hz: float,
    limits: Limits | Sequence[Limits],
    rng: np.random.Generator,
    *,
    share: float = 0.5,
    inputs: int = 1,
    experiments: int = 1,
) -> Excitation:
    """Noise for the first ``share`` of a period, then silence, in which the response decays.

    If it has died away at the end, one period has no leakage and needs no steady state before it (Ewins 2000,
    section 3.8). It may also be repeated. Raises `ConfigError` for a share outside (0, 1), and as
    `random_multisine`.
    """
    if not 0.0 < share < 1.0:
        raise ConfigError(f"the burst fills {share} of the period", hint="share between 0 and 1, often 0.5")
    samples = whole_samples(period_s, sample_hz)
    on = max(8, round(share * samples))
    u = np.zeros((experiments, samples, inputs))
    u[:, :on] = _gaussian(band_hz, 2 * samples, sample_hz, (experiments, inputs), rng)[:, :on]
    u[:, :on] *= _window(on)[:, None]
    first, last = band_lines(band_hz, period_s, sample_hz)
    what = f"burst of Gaussian noise from {band_hz[0]:.6g} to {band_hz[1]:.6g} Hz, {on / sample_hz:.6g} s of "
    what += f"each {period_s:.6g} s"
    return as_large_as_allowed("burst random", what, u, np.arange(first, last + 1), limits, sample_hz)


def _gaussian(
    band_hz: tuple[float, float],
    samples: int,
    sample_hz: float,
    shape: tuple[int, int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "experiment sample input"]:
    experiments, inputs = shape
    if experiments < 1 or inputs < 1:
        raise ConfigError(f"{experiments} experiments of {inputs} inputs", hint="one or more of each")
    first, last = band_lines(band_hz, samples / sample_hz, sample_hz)
    parts = rng.standard_normal((2, experiments, last - first + 1, inputs))
    spectrum = np.zeros((experiments, samples // 2 + 1, inputs), dtype=complex)
    spectrum[:, first : last + 1] = parts[0] + 1j * parts[1]
    return np.fft.irfft(spectrum, samples, axis=1)


def _window(samples: int) -> Float[np.ndarray, " sample"]:
    edge = max(1, round(TAPER * samples))
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    return np.concatenate([rise, np.ones(samples - 2 * edge), rise[::-1]])
