"""The kind of a signal, by features that are robust against noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.signals.excitation.signal import line_power

# Kurtosis: 1 for two levels, 1.5 for a sine, 3 for noise.
TWO_LEVELS = 1.15
# A burst is silent for this share of its period, below this share of its rms.
SILENT_SHARE, SILENT_LEVEL = 0.05, 0.05
# Sines of one amplitude at a time have an envelope that is constant but for its jumps.
EVEN_ENVELOPE = 0.05
# Standard deviation of the difference of log power between neighbouring lines: 1.81 for Gaussian noise
# (log of the ratio of two exponential variables), near nothing for chosen amplitudes.
CHOSEN_AMPLITUDES = 0.7


# At the edge of a multisine the power falls by more than this from one line to the next five; a sweep fades.
SHARP = 10.0
# Share of all changes of frequency that the tenth of the largest makes up: steps are few and large.
STEPS = 0.5


def name_kind(
    u: Float[np.ndarray, "experiment sample input"], lines: np.ndarray | None, noise_rms: float = 0.0
) -> str:
    """The kind of one period of each experiment, excited on ``lines``; None for a signal without repetition.

    ``noise_rms`` is that of the period's noise, as a share of the signal's.
    """
    channels = np.moveaxis(u, 2, 1).reshape(-1, u.shape[1])
    size = channels.std(axis=1)
    if not size.any():
        return "silence"
    x = channels[int(np.argmax(size))] / size.max()
    power = line_power(x[None, :, None])[:, 0]
    if np.mean(x**4) < TWO_LEVELS:
        return "binary"
    if power.max() > 0.99 * power.sum():
        return "sine"
    sharp = lines is not None and _sharp(power, lines)
    if not sharp and _quiet_share(x, max(SILENT_LEVEL, 4.0 * noise_rms)) > SILENT_SHARE:
        return "burst random"
    if not sharp and _one_sine_at_a_time(x):
        return "stepped sine" if _steps(x) else "swept sine"
    return "multisine" if lines is not None and _chosen(power[lines]) else "noise"


def _quiet_share(x: Float[np.ndarray, " sample"], level: float) -> float:
    """Longest run of silence as a share of the signal, a run over its ends included."""
    loud = np.flatnonzero(np.abs(x) > level)
    gaps = np.diff(np.concatenate([loud, [loud[0] + len(x)]]))
    return float(gaps.max() - 1) / len(x)


def _sharp(power: Float[np.ndarray, " line"], lines: np.ndarray) -> bool:
    """Whether both edges of the excited lines are cliffs; an edge at zero or Nyquist counts as one."""
    if not len(lines) or (lines[0] <= 1 and lines[-1] >= len(power) - 2):
        return False
    below, above = power[max(0, lines[0] - 5) : lines[0]], power[lines[-1] + 1 : lines[-1] + 6]
    cliff_below = not len(below) or power[lines[0]] > SHARP * below.max()
    return bool(cliff_below and (not len(above) or power[lines[-1]] > SHARP * above.max()))


def _analytic(x: Float[np.ndarray, " sample"]) -> Complex[np.ndarray, " sample"]:
    """The lines above zero alone, doubled (Gabor 1946)."""
    lines = np.fft.fft(x)
    lines[1 : (len(x) + 1) // 2] *= 2.0
    lines[len(x) // 2 + 1 :] = 0.0
    return np.fft.ifft(lines)


def _one_sine_at_a_time(x: Float[np.ndarray, " sample"]) -> bool:
    envelope = np.abs(_analytic(x))
    middle = np.median(envelope)
    return bool(np.median(np.abs(envelope - middle)) <= EVEN_ENVELOPE * middle)


def _steps(x: Float[np.ndarray, " sample"]) -> bool:
    """Whether the frequency stays, and moves at a few samples only; a sweep moves all the time."""
    phase = np.unwrap(np.angle(_analytic(x)))
    # Over stretches, as noise on the phase of single samples is no step.
    ends = np.linspace(0, len(x) - 1, min(201, len(x))).astype(int)
    moves = np.sort(np.abs(np.diff(np.diff(phase[ends]) / np.diff(ends))))
    return bool(np.sum(moves[-len(moves) // 10 :]) > STEPS * np.sum(moves))


def _chosen(power: Float[np.ndarray, " line"]) -> bool:
    """Whether the excited lines have amplitudes that somebody chose."""
    if len(power) < 3:
        return True
    # Quantiles, since a few steps, at the edges of bands, may be large.
    low, high = np.quantile(np.diff(np.log(power)), [0.16, 0.84])
    return bool(high - low < 2.0 * CHOSEN_AMPLITUDES)
